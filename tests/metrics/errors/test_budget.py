"""Error sources, largest first."""

from __future__ import annotations

import copy

import pytest

from lvnav_trade.metrics import METRICS


def test_the_budget_names_the_largest_source_first(good):
    found = METRICS["budget"](good)
    assert found.source.iloc[0] == "gyro bias"
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)


def test_a_source_of_a_billionth_is_zero_and_the_rest_is_unchanged(good):
    table = good.budget.copy()
    chosen = (table.source == "gyro bias") & (table.axis == "3d")
    assert chosen.any()
    table.loc[chosen, ["sigma_si", "share_ratio"]] = [1e-12, 1e-10]
    changed, before = copy.copy(good), METRICS["budget"](good)
    changed.budget, changed.cache = table, {}
    found = METRICS["budget"](changed)
    small = found.source == "gyro bias"
    assert (found[small][["sigma", "share_ratio"]] == 0.0).all(axis=None)
    others = before[before.source != "gyro bias"].reset_index(drop=True)
    assert found[~small].reset_index(drop=True).equals(others)
