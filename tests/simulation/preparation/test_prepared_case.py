"""A case made ready: how many rows an epoch has, and the ticks of its history."""

from __future__ import annotations

import numpy as np

from tests.building import case, prepare_hop
from tests.simulation.preparation.test_sensors import radar


def test_an_epoch_has_at_most_two_rows_for_each_satellite_and_one_for_each_scalar_of_a_sensor():
    tight, altimeter = case(), prepare_hop(radar())
    most = int(tight.signals.n_used.max())
    assert (tight.n_row, altimeter.n_row) == (2 * most, 2 * most + 1)


def test_the_ticks_of_the_history_are_the_ends_of_its_windows():
    prepared_case = case()
    dt = prepared_case.unit.dt
    assert (
        np.abs(prepared_case.hist_tick * dt - (prepared_case.t_hist - prepared_case.t_hist[0])).max() <= 0.5 * dt + 1e-9
    )
    np.testing.assert_array_equal(prepared_case.reference.r_i[prepared_case.hist_tick], prepared_case.record.r)
