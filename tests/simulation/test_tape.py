"""A tape of a run holds what was sensed, measured and estimated, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.simulation.montecarlo import record_run, run_block
from tests.export.cases import prepared_of


@pytest.fixture(scope="module")
def prepared_case():
    return prepared_of({"measurements": "ranges", "correction": "closed"})


def test_the_tape_ends_where_the_run_ends(prepared_case):
    tape, block = record_run(prepared_case, 4, 3).tape, run_block(prepared_case, 4, 3, 1, uses_lanes=False)
    assert prepared_case.schedule.hist[-1] == prepared_case.t_hist.size - 1
    error = np.linalg.norm(prepared_case.record.r[-1] - tape.estimates_after.nav[-1, 7:10])
    assert error == pytest.approx(np.linalg.norm(block.err[0, -1, 6:9]), rel=1e-12)
    bias = next(at for at, out in enumerate(prepared_case.outputs) if out.quantity == "gyro_bias")
    np.testing.assert_array_equal(
        np.sqrt(np.diagonal(tape.estimates_after.P[-1])[bias : bias + 3]), block.sigma[0, -1, bias : bias + 3]
    )


def test_increments_are_those_of_the_unit_with_its_errors(prepared_case):
    tape = record_run(prepared_case, 4, 3).tape
    apart = tape.increments - np.hstack([prepared_case.unit.dtheta, prepared_case.unit.dvel])
    white = prepared_case.unit.white[:6]
    measured = np.std(np.diff(apart, axis=0), axis=0) / np.sqrt(2.0)
    np.testing.assert_allclose(measured, white, rtol=0.05)


def test_ranges_are_those_of_the_epoch(prepared_case):
    tape = record_run(prepared_case, 4, 3).tape
    used, n_used = prepared_case.signals.satellite_by_slot[5], prepared_case.signals.n_used[5]
    apart = tape.ranges[5, :n_used, 0] - prepared_case.signals.range[5, used[:n_used]]
    assert np.ptp(apart) < 10.0 * prepared_case.signals.sigma[5].max() * 5.0
    assert np.isfinite(tape.ranges).all()
