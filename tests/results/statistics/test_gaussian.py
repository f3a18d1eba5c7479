"""Linear covariance's Gaussian at an event, and the moment of a phase that keeps a bound least."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.gaussian import formal_covariance, gaussian, worst_time_gaussian
from tests import synthetic

CASE = "aaaaaaaaaaaa"


@pytest.fixture(scope="module")
def good(alone):
    return alone


def test_the_gaussian_of_an_axis_is_the_margin_of_that_of_three(good):
    whole, east = (gaussian(good, CASE, "injection", "velocity", axis) for axis in ("3d", "east"))
    sigma = synthetic.SIGMA[3:6] * (1.0 + 0.01 * synthetic.EVENTS["injection"])
    np.testing.assert_allclose(np.diag(whole.covariance), sigma**2, rtol=1e-12)
    assert east.covariance.tolist() == [[whole.covariance[1, 1]]]
    assert east.mean.tolist() == [whole.mean[1]]
    assert gaussian(good, CASE, "injection", "velocity", "up") is None
    assert gaussian(good, CASE, "touchdown", "velocity", "3d") is None


def test_the_filter_of_matched_results_assumes_what_is_true(good):
    true = gaussian(good, CASE, "injection", "velocity", "3d").covariance
    np.testing.assert_allclose(formal_covariance(good, CASE, "injection", "velocity"), true, rtol=1e-12)


def test_the_worst_moment_of_a_growing_error_is_the_end_of_the_phase(good):
    law, at = worst_time_gaussian(CaseTables(good, CASE), "velocity", "north", "liftoff to injection", 0.2)
    sigma = synthetic.SIGMA[3] * (1.0 + 0.01 * synthetic.EVENTS["injection"])
    assert law.covariance[0, 0] == pytest.approx(sigma**2, rel=1e-9)
    assert at == "injection"
    assert worst_time_gaussian(CaseTables(good, CASE), "velocity", "north", "liftoff to touchdown", 0.2) is None
