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
