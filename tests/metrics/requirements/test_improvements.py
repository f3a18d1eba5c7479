"""Linear covariance's verdict and the source that would turn it."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.basics.gaussian import norm_probability, norm_quantile
from lvnav_trade.metrics.errors.covariances import reach
from lvnav_trade.metrics.requirements.improvements import expected, improvements
from lvnav_trade.store import load
from tests import synthetic

AT_END = 1.0 + 0.01 * 99.5  # growth of the sigmas of the fine unit at injection


def test_the_expected_probability_is_that_of_the_gaussian_of_the_case(good):
    row = expected(good).set_index(["requirement", "case"]).loc["tight bound", "imu=fine"]
    sigma, mean = AT_END * synthetic.SIGMA[6:9], AT_END * synthetic.MEAN[6:9]
    assert row.expected_probability == pytest.approx(norm_probability(mean, np.diag(sigma**2), 4.0), abs=1e-9)
    assert row.verdict == "violated"
    assert row.limit == "4 m"


def test_a_lever_meets_the_requirement_exactly(tmp_path):
    """The limit is the quantile of the error with the larger source at 0.4 of its sigma: the factor must be 0.4."""
    sigma, mean = AT_END * synthetic.SIGMA[6:9], AT_END * synthetic.MEAN[6:9]
    limit = norm_quantile(mean, np.diag(sigma**2) * (0.25 + 0.75 * 0.4**2), 0.9)
    campaign = synthetic.CAMPAIGN.replace("below: 4.0 m,", f"below: {limit!r} m,")
    tables = load(synthetic.results(tmp_path, n_run=80, campaign=campaign))
    found = improvements(tables).set_index(["requirement", "case"])
    row = found.loc["tight bound", "imu=fine"]
    assert row.source == "gyro bias"
    assert row.factor_ratio == pytest.approx(0.4, abs=2e-4)
    assert row.share_ratio == pytest.approx(0.75 * (sigma @ sigma) / (sigma @ sigma + mean @ mean), rel=1e-9)
    worse = found.loc["tight bound", "imu=coarse"]
    assert (worse.source, worse.remark) != ("gyro bias", "")


def test_where_nothing_need_be_better_it_says_so(good):
    row = improvements(good).set_index(["requirement", "case"]).loc["rare", "imu=fine"]
    assert row.verdict == "undecided"
    assert row.remark == "linear covariance expects it to be met as it is"


def test_a_gate_that_rejects_too_much_takes_the_verdict_away(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=0, rejects=0.03))
    assert not reach(tables, "aaaaaaaaaaaa").applies
    assert reach(tables, "aaaaaaaaaaaa").reason == "the gate rejects 3 % of good rows at 51 s"
    assert set(expected(tables).verdict) == {"not applicable"}
    assert improvements(tables).empty


def test_where_no_realistic_factor_would_do_it_says_so(good):
    row = improvements(good).set_index(["requirement", "case"]).loc["tight bound", "imu=coarse"]
    assert row.source == ""
    assert row.remark == "not even all error sources together, each times 0.05, would do"
