"""Probability within a sphere against closed forms and against draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.metrics.basics.gaussian import norm_probability, norm_quantile


@pytest.mark.parametrize("limit", [0.3, 1.0, 2.0, 4.0])
def test_equal_sigmas_give_maxwells_distribution(limit):
    assert norm_probability(np.zeros(3), np.eye(3), limit) == pytest.approx(stats.maxwell.cdf(limit), abs=1e-9)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_mean_gives_the_non_central_chi_square(k):
    mean = np.array([1.0, -0.5, 2.0])[:k]
    expected = stats.ncx2.cdf(2.5**2 / 0.49, k, mean @ mean / 0.49)
    assert norm_probability(mean, 0.49 * np.eye(k), 2.5) == pytest.approx(expected, abs=1e-9)


def test_one_axis_is_the_normal_distribution():
    expected = stats.norm.cdf(1.0, 0.2, 0.7) - stats.norm.cdf(-1.0, 0.2, 0.7)
    assert norm_probability([0.2], [[0.49]], 1.0) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("mean", "sigma"),
    [((0.0, 0.0, 0.0), (1.0, 0.3, 0.05)), ((0.4, -0.2, 0.1), (0.2, 1.0, 0.6)), ((1.0, 0.0, 0.5), (0.01, 0.5, 0.0))],
)
def test_a_million_draws_agree(mean, sigma):
    """Sampling error of a probability from a million draws: at most 5e-4 one sigma; four of them."""
    draw = np.random.default_rng(11)
    turn = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    covariance = turn @ np.diag(np.square(sigma)) @ turn.T
    x = turn @ np.array(mean) + (draw.standard_normal((1_000_000, 3)) * np.array(sigma)) @ turn.T
    size = np.linalg.norm(x, axis=1)
    for limit in (0.6, 1.1, 2.0):
        found = norm_probability(turn @ np.array(mean), covariance, limit)
        assert found == pytest.approx(np.mean(size < limit), abs=2e-3)


def test_the_quantile_is_the_inverse():
    covariance = np.diag([4.0, 1.0, 0.01])
    limit = norm_quantile([0.5, 0.0, 0.0], covariance, 0.95)
    assert norm_probability([0.5, 0.0, 0.0], covariance, limit) == pytest.approx(0.95, abs=1e-8)


def test_nothing_is_within_no_limit_and_no_error_within_any():
    assert norm_probability(np.zeros(3), np.eye(3), 0.0) == 0.0
    assert norm_probability(np.zeros(3), np.zeros((3, 3)), 1e-9) == 1.0
    assert norm_quantile(np.zeros(3), np.zeros((3, 3)), 0.5) == 0.0
