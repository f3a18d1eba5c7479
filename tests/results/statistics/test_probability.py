"""Exact binomial, chi-square and Holm against tables and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results.statistics.probability import (
    holm,
    is_demonstrated,
    norm_probability,
    norm_quantile,
    rms_interval,
    runs_needed,
    success_bounds,
)

RUNS_TABLE = {
    # probability: {confidence: runs for 0, 1, 2, 5 failures}; exact binomial
    0.95: {0.5: (14, 34, 54, 114), 0.9: (45, 77, 105, 184), 0.95: (59, 93, 124, 208)},
    0.99: {0.5: (69, 168, 268, 567), 0.9: (230, 388, 531, 926), 0.95: (299, 473, 628, 1049)},
    0.9973: {0.5: (257, 622, 991, 2100), 0.9: (852, 1440, 1970, 3433), 0.95: (1109, 1756, 2330, 3891)},
    0.99865: {0.5: (514, 1243, 1981, 4200), 0.9: (1705, 2880, 3941, 6868), 0.95: (2218, 3513, 4662, 7785)},
}


@pytest.mark.parametrize("probability", RUNS_TABLE)
def test_runs_needed_reproduce_the_exact_binomial_table(probability):
    for confidence, expected in RUNS_TABLE[probability].items():
        found = tuple(runs_needed(failures, probability, confidence) for failures in (0, 1, 2, 5))
        assert found == expected


def test_one_run_less_than_needed_does_not_show_it():
    assert is_demonstrated(852, 0, 0.9973, 0.9)
    assert not is_demonstrated(851, 0, 0.9973, 0.9)


def test_lower_bound_without_failures_is_the_root_of_the_remaining_doubt():
    """P^n = 1 - C."""
    assert success_bounds(45, 0, 0.9)[0] == pytest.approx(0.1 ** (1 / 45), rel=1e-12)


def test_bound_and_needed_runs_agree_at_every_count():
    for failures in range(4):
        for runs in range(failures + 1, 250):
            assert (success_bounds(runs, failures, 0.9)[0] >= 0.95) == is_demonstrated(runs, failures, 0.95, 0.9)


def test_the_rms_interval_is_the_known_one():
    """The 95 % half-width of a sigma from 1000 runs is 4.4 %, from 100 runs about 13.9 % (a mean of both sides)."""
    for runs, half in ((100, 0.139), (1000, 0.044), (10000, 0.014)):
        low, high = rms_interval(1.0, runs)
        assert (high - low) / 2 == pytest.approx(half, rel=0.04)


def test_holm_is_the_textbook_case():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])


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
