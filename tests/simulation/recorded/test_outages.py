"""Outages: solutions are withheld, and the filter knows the error that grows meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.recorded.outages import outage, with_outage
from lvnav_trade.simulation.recorded.recorded_flight import log_replay
from tests.building import with_fields
from tests.simulation.recorded.test_recorded_flight_flight import drive

__all__ = ["drive"]


@pytest.fixture(scope="module")
def prepared_case(drive):
    scenario, log, card, aligned, _ = drive
    return log_replay(scenario, log, card, aligned).prepared_case


def test_nothing_is_measured_in_an_outage_and_all_else_is(prepared_case):
    run = run_block(with_outage(prepared_case, 30.0, 45.0), 0, 0, 1)
    inside = (run.t_epoch >= 30.0 - 1e-9) & (run.t_epoch <= 45.0 + 1e-9)
    assert not run.n_row[0, inside].any()
    assert (run.n_row[0, ~inside] == 6).all()


def test_the_error_at_the_end_is_that_of_the_run_and_its_covariance_has_the_solutions_noise(prepared_case):
    found = outage(prepared_case, 30.0, 15.0)
    run = run_block(with_outage(prepared_case, 30.0, 45.0), 0, 0, 1)
    at = int(np.argmin(np.abs(run.t - 45.0)))
    np.testing.assert_allclose(found.error, run.err[0, at, 3:9], rtol=1e-9)
    own = run.sigma[0, at, 3:9] ** 2 + np.repeat([0.05**2, 0.3**2], 3)
    np.testing.assert_allclose(found.sigma**2, own, rtol=1e-6)
    assert found.square == pytest.approx(float(found.error @ np.linalg.inv(found.covariance) @ found.error) / 6.0)
    assert not found.has_failed


@pytest.mark.parametrize("changes", [
    {"feedback": "open"},
    {"delay_compensation": {"kind": "buffered", "delay": "0.5 s"}},
    {"logic": {}, "feedback": "open"},
    {"update": "joseph", "feedback": "direct"},
])  # fmt: skip
def test_the_policies_of_a_filter_hold_on_a_log(drive, changes):
    scenario, log, card, aligned, _ = drive
    if "delay_compensation" in changes:
        late = scenario.receiver.model_copy(update={"latency": 0.5})
        scenario = scenario.model_copy(update={"receiver": late})
    fields = {f"filter.{key}": value for key, value in changes.items()}
    prepared_case = log_replay(with_fields(scenario, **fields), log, card, aligned).prepared_case
    run = run_block(prepared_case, 0, 0, 1)
    late = run.t > 30.0
    assert run.failed[0] == 0
    sigma = np.hypot(run.sigma[0, late, 6:9], 0.3)
    assert np.mean(run.err[0, late, 6:9] ** 2 / sigma**2) < 2.0
    found = outage(prepared_case, 30.0, 15.0)
    assert found.square < 4.0


def test_an_outage_beyond_the_log_is_none(prepared_case):
    assert outage(prepared_case, 110.0, 15.0) is None
    assert outage(prepared_case, 500.0, 15.0) is None
