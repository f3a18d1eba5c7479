"""Bounds and verdicts of checks."""

from __future__ import annotations

import numpy as np
from scipy import stats

from lvnav_trade.covariance.selfcheck.check import CheckResult, set_bounds


def test_all_statistics_of_a_campaign_fail_by_chance_once_in_a_hundred():
    """A thousand campaigns of twenty normals each; five sigma of the binomial. All campaigns have the same bounds."""
    bounded = set_bounds([CheckResult("draws", "x", distribution=stats.norm())] * 20)
    n = 1000
    draws = np.random.default_rng(1).standard_normal((n, 20))
    lost = sum(
        any(check._replace(figure=figure).verdict == "failed" for check, figure in zip(bounded, campaign, strict=True))
        for campaign in draws
    )
    assert abs(lost - 0.01 * n) < 5.0 * np.sqrt(0.01 * n)


def test_a_figure_that_is_no_number_has_failed_and_what_was_not_checked_has_not():
    assert CheckResult("Jacobian", "x", float("nan"), upper_limit=1.0).verdict == "failed"
    assert CheckResult("Jacobian", "x", reason="why").verdict == "not checked"
