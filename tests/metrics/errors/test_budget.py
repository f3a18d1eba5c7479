"""Error sources, largest first."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics import METRICS


def test_the_budget_names_the_largest_source_first(good):
    found = METRICS["budget"](good)
    assert found.source.iloc[0] == "gyro bias"
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)
