"""Bounds and verdicts of checks."""

from __future__ import annotations

import numpy as np
from scipy import stats

from lvnav_trade.covariance.selfcheck.check import CheckResult
from tests.covariance.diagnostics.checked import failed


def test_all_statistics_of_a_campaign_fail_by_chance_once_in_a_hundred():
    """A thousand campaigns of twenty normals each; five sigma of the binomial."""
    rng = np.random.default_rng(1)
    n = 1000
    lost = sum(
        bool(failed(CheckResult("draws", "x", figure, distribution=stats.norm()) for figure in rng.standard_normal(20)))
        for _ in range(n)
    )
    assert abs(lost - 0.01 * n) < 5.0 * np.sqrt(0.01 * n)


def test_a_figure_that_is_no_number_has_failed_and_what_was_not_checked_has_not():
    assert CheckResult("Jacobian", "x", float("nan"), upper_limit=1.0).verdict == "failed"
    assert CheckResult("Jacobian", "x", reason="why").verdict == "not checked"
