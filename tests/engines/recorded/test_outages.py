"""Outages: solutions are withheld, and the filter knows the error that grows meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.recorded.flight import replayed
from lvnav_trade.engines.recorded.outages import outage, with_outage
from lvnav_trade.engines.simulate.montecarlo import run_block
from tests.engines.recorded.test_flight import drive

__all__ = ["drive"]


@pytest.fixture(scope="module")
def prepared(drive):
    scenario, log, card, aligned, _ = drive
    return replayed(scenario, log, card, aligned)


def test_nothing_is_measured_in_an_outage_and_all_else_is(prepared):
    run = run_block(with_outage(prepared, 30.0, 45.0), 0, 0, 1)
    inside = (run.t_epoch >= 30.0 - 1e-9) & (run.t_epoch <= 45.0 + 1e-9)
    assert not run.n_row[0, inside].any()
    assert (run.n_row[0, ~inside] == 6).all()


def test_the_error_at_the_end_is_that_of_the_run_and_its_covariance_has_the_solutions_noise(prepared):
    found = outage(prepared, 30.0, 15.0)
    run = run_block(with_outage(prepared, 30.0, 45.0), 0, 0, 1)
    at = int(np.argmin(np.abs(run.t - 45.0)))
    np.testing.assert_allclose(found.error, run.err[0, at, 3:9], rtol=1e-9)
    own = run.sigma[0, at, 3:9] ** 2 + np.repeat([0.05**2, 0.3**2], 3)
    np.testing.assert_allclose(found.sigma**2, own, rtol=1e-6)
    assert found.square == pytest.approx(float(found.error @ np.linalg.inv(found.covariance) @ found.error) / 6.0)
    assert not found.failed


def test_an_outage_beyond_the_log_is_none(prepared):
    assert outage(prepared, 110.0, 15.0) is None
    assert outage(prepared, 500.0, 15.0) is None
