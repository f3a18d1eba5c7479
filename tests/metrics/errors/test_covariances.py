"""The Gaussian that linear covariance says of an error, and where it says nothing."""

from __future__ import annotations

import numpy as np

from lvnav_trade.metrics.errors.covariances import gaussian, reach
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
