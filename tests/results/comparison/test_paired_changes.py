"""Pairs of runs: bounds hold as often as they say, against published examples and simulations."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.comparison.paired_changes import (
    exceedance_change,
    fitted_quantile_change,
    quantile_change,
    rms_change,
    verdict,
)

SIGMA = np.array([1.0, 0.5, 0.3])


def norms(rng, n, correlation, factor):
    """Return norms of Gaussian errors of two cases whose draws are so correlated; the second is `factor` larger."""
    first, other = rng.standard_normal((2, n, 3))
    second = correlation * first + np.sqrt(1.0 - correlation**2) * other
    return np.linalg.norm(first * SIGMA, axis=1), factor * np.linalg.norm(second * SIGMA, axis=1)


def discordant(both, first, second, neither):
    """Return two truth values per pair from a table of pairs."""
    counts = [both, first, second, neither]
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


def test_bounds_on_paired_fractions_are_those_of_tango():
    # Airway hyper-responsiveness before and after transplantation, n = 21, in Fagerland, Lydersen and Laake (2014),
    # Statistics in Medicine 33: Tango's score interval of the difference is (-0.517, -0.026).
    before, after = discordant(1, 1, 7, 12)
    found = exceedance_change(after, before, 0.025, 0.025)
    assert (found.low, found.high) == (pytest.approx(-0.517, abs=5e-4), pytest.approx(-0.026, abs=5e-4))


def test_without_a_discordant_pair_the_bounds_are_those_of_the_closed_form():
    none = np.zeros(200, dtype=bool)
    found = exceedance_change(none, none, 0.05, 0.05)
    z2 = 1.6448536269514722**2
    assert found.high == pytest.approx(z2 / (200 + z2), rel=1e-6)
    assert found.low == -found.high


def test_bounds_on_fractions_mirror_when_the_cases_change_places():
    first, second = discordant(5, 3, 11, 181)
    there, back = exceedance_change(first, second, 0.05, 0.1), exceedance_change(second, first, 0.1, 0.05)
    assert (there.low, there.high) == (pytest.approx(-back.high), pytest.approx(-back.low))
    assert there.change == pytest.approx(0.04)
    assert there.low < 0.04 < there.high


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.999])
@pytest.mark.parametrize("n", [20, 100])
def test_bounds_on_a_change_of_rms_hold_as_often_as_they_say(n, correlation):
    rng = np.random.default_rng(n)
    trials, low, high = 2000, 0, 0
    for _ in range(trials):
        found = rms_change(*norms(rng, n, correlation, 1.05), True, 0.05, 0.05)
        low, high = low + (found.low <= 0.05), high + (found.high >= 0.05)
    # 95 % each; 2000 trials have a standard deviation of 0.5 %, and 20 runs of a skewed error cost 1 %.
    assert 0.93 < low / trials < 0.97
    assert 0.93 < high / trials < 0.97


def test_five_percent_of_rms_is_decided_with_under_a_hundred_runs_where_pairing_counts():
    found = rms_change(*norms(np.random.default_rng(1), 80, 0.999, 1.05), True, 0.05, 0.05)
    assert verdict(found.low, found.high, 0.02) == "worse"
    assert found.effective_runs > 50 * 80
    alone = rms_change(*norms(np.random.default_rng(1), 80, 0.0, 1.05), True, 0.05, 0.05)
    assert verdict(alone.low, alone.high, 0.02) == "undecided"


def test_effective_runs_are_those_of_the_ratio_of_variances():
    # Squares of Gaussians correlated by r have correlation r^2: pairing divides the variance of the difference of two
    # equal mean squares by 1 - r^2, which is worth 1 / (1 - r^2) times the runs.
    first, second = np.random.default_rng(3).multivariate_normal([0, 0], [[1, 0.9], [0.9, 1]], 20000).T
    assert rms_change(first, second, True, 0.05, 0.05).effective_runs == pytest.approx(20000 / (1 - 0.81), rel=0.05)


def test_the_same_runs_have_no_change_and_no_doubt():
    error = np.abs(np.random.default_rng(2).standard_normal(8))
    found = rms_change(error, error, True, 0.05, 0.05)
    assert (found.change, found.low, found.high, found.effective_runs) == (0.0, 0.0, 0.0, np.inf)


def test_a_change_in_units_is_the_change_of_the_ratio_times_the_size():
    pair = norms(np.random.default_rng(4), 400, 0.99, 1.02)
    ratio, units = (rms_change(*pair, relative, 0.05, 0.05) for relative in (True, False))
    assert units.change == pytest.approx(ratio.change * ratio.base)
    assert units.low == pytest.approx(ratio.low * ratio.base, rel=0.05)


def test_one_run_gives_no_bound():
    found = rms_change(np.array([1.0]), np.array([2.0]), True, 0.05, 0.05)
    assert found.change == pytest.approx(1.0)
    assert np.isnan([found.low, found.high]).all()
    assert verdict(found.low, found.high, 0.05) == "undecided"


@pytest.mark.parametrize("correlation", [0.0, 0.99])
def test_bounds_on_a_change_of_quantile_hold_at_least_as_often_as_they_say(correlation):
    rng = np.random.default_rng(5)
    trials, low, high = 150, 0, 0
    for _ in range(trials):
        found = quantile_change(*norms(rng, 120, correlation, 1.05), 0.95, True, 0.05, 0.05)
        low, high = low + (found.low <= 0.05), high + (found.high >= 0.05)
    assert min(low, high) / trials > 0.90  # 95 %, less three standard deviations of 150 trials


def test_a_quantile_with_too_few_runs_beyond_it_has_no_bound():
    pair = norms(np.random.default_rng(6), 99, 0.5, 1.0)
    assert np.isnan(quantile_change(*pair, 0.95, True, 0.05, 0.05).low)
    assert np.isfinite(quantile_change(*norms(np.random.default_rng(6), 100, 0.5, 1.0), 0.95, True, 0.05, 0.05).low)


def test_a_quantile_is_the_order_statistic_and_its_bounds_are_the_same_at_every_look():
    base, candidate = np.arange(1.0, 201.0), 2.0 * np.arange(1.0, 201.0)
    found = quantile_change(base, candidate, 0.9, True, 0.05, 0.05)
    assert (found.base, found.candidate, found.change) == (180.0, 360.0, 1.0)
    assert (found.low, found.high) == (1.0, 1.0)
    again = quantile_change(base, candidate[::-1].copy(), 0.9, True, 0.05, 0.05)
    assert again == quantile_change(base, candidate[::-1].copy(), 0.9, True, 0.05, 0.05)
    assert again.low < again.high


@pytest.mark.parametrize(
    ("low", "high", "word"), [(0.06, 0.2, "worse"), (-0.1, 0.04, "not worse"), (0.01, 0.06, "undecided")]
)
def test_a_verdict_holds_the_bounds_against_the_smallest_effect_of_interest(low, high, word):
    assert verdict(low, high, 0.05) == word


P = 0.9973


@pytest.mark.parametrize("sigma", [(1.0, 0.5, 0.3), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (3.0, 1.0, 0.1)])
def test_a_fitted_quantile_is_that_of_the_errors(sigma):
    rng = np.random.default_rng(4)
    errors = np.linalg.norm(rng.standard_normal((1_000_000, 3)) * sigma, axis=1)
    found = fitted_quantile_change(errors, errors, P, True, 0.05, 0.05)
    # exact for equal components and for one, else up to 4 % low, in base and candidate alike
    error = 0.01 if len({*sigma} - {0.0}) == 1 else 0.04
    assert found.base == pytest.approx(np.quantile(errors, P), rel=error)
    assert found.change == 0.0


@pytest.mark.parametrize("correlation", [0.0, 0.99])
def test_bounds_on_a_change_of_a_fitted_quantile_hold_as_often_as_they_say(correlation):
    rng, trials, low, high = np.random.default_rng(5), 1000, 0, 0
    for _ in range(trials):
        found = fitted_quantile_change(*norms(rng, 100, correlation, 1.05), P, True, 0.05, 0.05)
        low, high = low + (found.low <= 0.05), high + (found.high >= 0.05)
    # 95 % each; 1000 trials have a standard deviation of 0.7 %
    assert 0.92 < low / trials < 0.98
    assert 0.92 < high / trials < 0.98


def test_a_small_change_of_a_far_quantile_is_decided_with_a_hundred_pairs():
    pair = norms(np.random.default_rng(6), 100, 0.999, 1.0)
    found = fitted_quantile_change(*pair, P, True, 0.05, 0.05)
    assert verdict(found.low, found.high, 0.05) == "not worse"
    worse = fitted_quantile_change(pair[0], 1.1 * pair[1], P, True, 0.05, 0.05)
    assert verdict(worse.low, worse.high, 0.05) == "worse"
    # counted runs say nothing of it
    limit = 10.0 * pair[0].max()
    counted = exceedance_change(pair[0] >= limit, pair[1] >= limit, 0.05, 0.05)
    assert verdict(counted.low, counted.high, 1.0 - P) == "undecided"
