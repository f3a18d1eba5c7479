"""Arrays of a run: their room, and that of eight runs in lanes."""

from __future__ import annotations

import pytest

from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.simulation.run_arrays import new_work
from tests.building import INERTIAL, case


@pytest.mark.parametrize("lanes", [False, True])
def test_rows_have_the_room_that_the_case_asks_for_and_no_array_is_empty(lanes):
    """A lane view of no length has no type that the compiled flight knows."""
    prepared_case = case(INERTIAL)
    (work, _), end = new_work(prepared_case, lanes), (WIDTH,) if lanes else ()
    assert work.H.shape == (prepared_case.n_row, prepared_case.model.entry.shape[1], *end)
    assert work.err.shape == work.sigma.shape == (prepared_case.t_hist.size, len(prepared_case.outputs), *end)
    assert all(
        work._asdict()[name].shape[0] >= 1
        for name in ("correlated_errors", "extra", "par", "true_par", "sensor_measurements")
    )
