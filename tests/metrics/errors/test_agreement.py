"""Runs drawn from the covariance agree with it; others do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.metrics.errors.agreement import agreement, by_case
from lvnav_trade.store import load
from tests import synthetic


def test_agreement_has_the_columns_that_users_rely_on(good):
    assert list(agreement(good).columns) == [
        "case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree",
    ]  # fmt: skip


def test_runs_drawn_from_the_covariance_agree_with_it(good):
    assert len(agreement(good)) == 2 * 3 * 9
    assert set(by_case(good).verdict) == {"agree"}


def test_runs_drawn_too_large_disagree_and_the_worst_state_is_named(wrong):
    found = by_case(wrong)
    assert set(found.verdict) == {"disagree"}
    assert set(found.source) == {"gyro bias"}
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)
    assert (found.outside_count == 27).all()
    assert found.ratio.iloc[0] == pytest.approx(1.6, rel=0.35)
    assert found.event.iloc[0] in synthetic.EVENTS


def test_the_bounds_are_bonferronis(good):
    """27 rows, 199 runs, no mean: sqrt(chi2.ppf(0.005 / 27, 199) / 199)."""
    row = agreement(good).iloc[0]
    assert row.low == pytest.approx(np.sqrt(stats.chi2.ppf(0.01 / 27 / 2, 199) / 199), rel=1e-12)


def test_without_runs_nothing_is_claimed(alone):
    assert set(agreement(alone).agree) == {"no runs"}
    assert set(by_case(alone).verdict) == {"no runs"}


def test_where_the_gate_rejects_too_much_neither_agreement_nor_disagreement_is_claimed(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=40, wrong=1.6, rejects=0.02))
    assert set(agreement(tables).agree) == {"not applicable"}
    found = by_case(tables)
    assert set(found.verdict) == {"not applicable"}
    assert found.reason.iloc[0] == "the gate rejects 2 % of good rows at 51 s"


def test_a_gate_that_rejects_one_row_in_a_hundred_changes_no_verdict(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=40, rejects=0.01))
    assert set(by_case(tables).verdict) == {"agree"}
