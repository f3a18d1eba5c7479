"""Where a few runs look at linear covariance: events, and the first measurement after a gap."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics import confirming_runs as module
from lvnav_trade.covariance.diagnostics.confirming_runs import gaps, spot_check
from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import loaded, prepare_hop

T = np.arange(-10.0, 101.0)


def history(measured):
    """Return a history of a second's step with measurements at the epochs that `measured` says."""
    return SimpleNamespace(t=T, t_epoch=T, n_row=np.where(measured, 6, 0))


def test_a_gap_ends_with_the_first_measurement_after_it_that_before_the_first_of_all_too():
    assert gaps(history((T >= 0.0) & ((T <= 30.0) | (T >= 50.0)))) == (
        ("first measurement at 0 s", -10.0, 0.0),
        ("first measurement at 50 s", 30.0, 50.0),
    )


def test_a_slow_filter_has_no_gaps_between_its_updates():
    tenth = np.arange(T.size) % 10 == 0
    assert gaps(history(tenth)) == ()
    assert gaps(history(tenth & (np.abs(T - 40.0) > 25.0))) == (("first measurement at 70 s", 10.0, 70.0),)


def test_without_a_measurement_there_is_no_gap():
    assert gaps(history(np.zeros(T.size, dtype=bool))) == ()


def test_its_runs_are_the_first_of_the_campaign():
    prepared_case = prepare_hop(loaded("base.filter=filters/loose"))
    found = spot_check(prepared_case, covariance(prepared_case), {"liftoff": 0.0, "beyond": 1e4}, 7, 8)
    assert found.events == ("liftoff",)
    at = int(np.argmin(np.abs(prepared_case.t_hist)))
    np.testing.assert_array_equal(found.event_error[:, 0, :9], run_block(prepared_case, 7, 0, 8).err[:, at, :9])


@pytest.mark.parametrize(("scale", "runs"), [(1.0, 16), (0.25, 32)])
def test_the_other_half_is_flown_where_the_first_does_not_fit(scale, runs):
    prepared_case = prepare_hop(loaded("base.filter=filters/loose"))
    history = covariance(prepared_case)
    scaled = history._replace(true_sigma=scale * history.true_sigma, mean=scale * history.mean)
    found = spot_check(prepared_case, scaled, {"end": 5.0}, 1, 32)
    np.testing.assert_array_equal(found.runs, np.arange(runs))
    at = int(np.argmin(np.abs(prepared_case.t_hist - 5.0)))
    np.testing.assert_array_equal(found.event_error[:, 0, :9], run_block(prepared_case, 1, 0, runs).err[:, at, :9])


def block(errors):
    """Return some runs' errors (n_run, 1 event, 9), and a covariance of one in each, about a mean of two."""
    history = SimpleNamespace(t=T, true_sigma=np.ones((T.size, 9)), mean=np.full((T.size, 9), 2.0))
    return SimpleNamespace(t_event=np.array([40.0]), event_error=errors), history


def test_draws_of_the_covariance_are_seldom_suspect_and_twice_their_size_mostly():
    """Nine independent errors: at most the level by the chi-square and the level by the largest."""
    rng, counts = np.random.default_rng(3), {}
    for scale in (1.0, 2.0):
        z = scale * rng.normal(size=(400, 16, 1, 9))
        counts[scale] = np.mean([module._is_suspect(*block(2.0 + one)) for one in z])
    assert 0.1 < counts[1.0] < 2.0 * module.SUSPICION_LEVEL
    assert counts[2.0] == 1.0


def test_a_run_that_failed_is_suspect():
    errors = 2.0 + np.random.default_rng(4).normal(size=(16, 1, 9)) * 0.9
    assert not module._is_suspect(*block(errors))
    errors[3] = np.nan
    assert module._is_suspect(*block(errors))
