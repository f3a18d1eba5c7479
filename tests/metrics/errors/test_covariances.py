"""The Gaussian that linear covariance says of an error, and where it says nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.metrics.errors.covariances import agreement, by_case, gaussian, reach
from lvnav_trade.store import load
from tests import synthetic

AT_END = 1.0 + 0.01 * 99.5  # growth of the sigmas of the fine unit at injection


def test_a_norm_has_three_components_and_an_axis_one(good):
    case = next(iter(good.labels))
    assert gaussian(good, case, "injection", "velocity", "3d").covariance.shape == (3, 3)
    roll = gaussian(good, case, "injection", "attitude", "roll")
    np.testing.assert_allclose(roll.covariance, [[(AT_END * 1e-3) ** 2]], rtol=1e-12)
    assert gaussian(good, case, "injection", "velocity", "radial") is None


def test_the_sources_sum_to_the_whole(good):
    found = gaussian(good, next(iter(good.labels)), "injection", "position", "3d")
    np.testing.assert_allclose(sum(found.sources.values()), found.covariance, rtol=1e-12)


def test_a_case_without_a_gate_is_described_everywhere(good):
    found = reach(good, next(iter(good.labels)))
    assert (found.applies, found.rejected, found.reason) == (True, 0.0, "")


def test_the_mean_error_belongs_to_the_gaussian(good):
    found = gaussian(good, next(iter(good.labels)), "injection", "position", "3d")
    np.testing.assert_allclose(found.mean, AT_END * synthetic.MEAN[6:9], rtol=1e-12)


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
