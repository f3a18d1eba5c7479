"""Where a few runs look at linear covariance: events, and the first measurement after a gap."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from lvnav_trade.engines.analysis.spot_check import gaps, spot_check
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.simulate.montecarlo import run_block
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
    prepared = prepare_hop(loaded("base.filter=filters/loose"))
    found = spot_check(prepared, covariance(prepared), {"liftoff": 0.0, "beyond": 1e4}, 7, 8)
    assert found.events == ("liftoff",)
    at = int(np.argmin(np.abs(prepared.t_hist)))
    np.testing.assert_array_equal(found.event_error[:, 0, :9], run_block(prepared, 7, 0, 8).err[:, at, :9])
