"""Budgets, contributions, sensitivities, observability, nonlinearity: what the tables hold, in the units of people."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.errors.diagnostics import (
    contributions,
    is_position_bias,
    nonlinearity,
    observability,
    observed,
    sensitivity,
)
from tests import synthetic
from tests.vehicle_tables import tables


def test_contributions_of_all_sources_and_bins_sum_to_one(good):
    total = contributions(good).groupby(["case", "metric"]).share_ratio.sum()
    assert len(total) == 6
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_a_frozen_sigma_of_ten_times_is_the_closed_form(good):
    rows = sensitivity(good).set_index(["case", "metric", "source", "factor_ratio"])
    one, ten = (rows.loc["imu=fine", "attitude_error", "gyro bias", f] for f in (1.0, 10.0))
    assert ten.frozen == pytest.approx(one.frozen * np.sqrt(0.25 + 0.75 * 100.0), rel=1e-12)
    assert ten.retuned == pytest.approx(synthetic.RETUNED * ten.frozen, rel=1e-12)
    assert ten.unit == "mrad"


def test_the_smallest_singular_values_come_first(good):
    row = observability(good).iloc[0]
    assert (row.rank_count, row.state_count) == (4, 5)
    assert (row.smallest_ratio, row.second_ratio, row.third_ratio) == (1e-5, 0.2, 1.0)


def test_nonlinearity_stands_at_every_event(good):
    assert list(nonlinearity(good).event) == 2 * list(synthetic.EVENTS)


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


def test_ranks_are_counted_over_all_stretches():
    row = observed(tables()).iloc[0]
    assert (row.stretches, row.states, row.least_rank, row.least_rank_with_information) == (2, 3, 3, 2)
    assert row.smallest_ratio == 2e-3
    assert row.position_against_bias_ratio == 0.5
    assert row.weakest == "+1.00 gyro bias x"


def test_directions_in_which_a_position_trades_with_its_bias_are_known_by_their_words():
    assert is_position_bias("+1.00 position bias x, -0.80 position north")
    assert not is_position_bias("+1.00 position north")
    assert not is_position_bias("+1.00 position bias x, +0.60 gyro bias x")
