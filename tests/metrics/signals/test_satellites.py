"""Satellites in view, and errors around an outage."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics import METRICS


def test_satellites_vanish_during_the_outage(good):
    found = METRICS["in_view"](good)
    assert set(found.tracked_count[found.t_s.between(60, 74.5)]) == {0}
    assert set(found.above_count) == {8}


def test_growth_over_an_outage_is_end_over_before(alone):
    found = METRICS["outages"](alone).iloc[0]
    assert found.growth_ratio == pytest.approx(1.75 / 1.60)
    assert (found.t_start_s, found.t_end_s) == (60.0, 75.0)


def test_the_worst_error_lies_between_the_start_and_ten_seconds_after_the_end(alone):
    found = METRICS["outages"](alone)
    row = found[(found.case == "imu=fine") & (found.metric == "velocity_error")].iloc[0]
    assert row.worst == pytest.approx(row.before * 1.85 / 1.60)  # the error grows by 1 % a second


def test_before_a_fault_of_a_moment_is_the_time_before_it(alone):
    jump = type(alone)(alone.folder)
    events = alone.events.copy()
    events.loc[events.kind == "fault", ["t_s", "t_end_s"]] = 60.0
    jump._read["events"] = events
    assert METRICS["outages"](jump).iloc[0].growth_ratio == pytest.approx(1.60 / 1.59)
