"""Control variates change no expectation, and narrow the interval where linear theory holds."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.errors.control_variates import controlled, controlled_rms

M, N = 12, 120
TRUTH = np.random.default_rng(0).standard_normal((M, 3)) * np.linspace(2.0, 0.1, M)[:, None]


def flights(rng, bend=0.0, noise=0.5, n=N):
    """Return errors that follow the draws linearly, bent by a square, with noise; and the draws."""
    draws = rng.standard_normal((n, M))
    error = draws @ TRUTH + noise * rng.standard_normal((n, 3))
    return error + bend * (draws[:, :3] ** 2), draws


def mean_square(bend=0.0, noise=0.5):
    """Return E |error|^2 in closed form: E u^4 = 3, E u^3 = 0."""
    return float((TRUTH**2).sum() + 3 * noise**2 + 9.0 * bend**2)


@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_the_mean_square_is_unbiased_whether_or_not_the_error_is_linear(bend):
    rng = np.random.default_rng(1)
    trials = 1500
    found = np.array([controlled_rms(*flights(rng, bend)).rms ** 2 for _ in range(trials)])
    assert abs(found.mean() - mean_square(bend)) < 3.5 * found.std() / np.sqrt(trials)
    assert found.std() / np.sqrt(trials) < 0.005 * mean_square(bend)


def test_fitting_on_the_same_runs_would_be_biased():
    """The reason for folds: a slope that knows its own draws takes off part of the noise."""
    rng = np.random.default_rng(2)
    found = []
    for _ in range(1000):
        error, draws = flights(rng, noise=5.0, n=40)
        slope = np.linalg.lstsq(draws, error, rcond=None)[0]
        control = ((draws @ slope) ** 2).sum(axis=1) - (slope**2).sum()
        found.append((error**2).sum(axis=1).mean() - control.mean())
    found = np.array(found)
    assert abs(found.mean() - mean_square(noise=5.0)) > 5.0 * found.std() / np.sqrt(len(found))


@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_the_interval_holds_as_often_as_it_says(bend):
    rng = np.random.default_rng(3)
    trials = 1500
    truth = np.sqrt(mean_square(bend))
    inside = [(one := controlled_rms(*flights(rng, bend))).low <= truth <= one.high for _ in range(trials)]
    assert 0.92 < np.mean(inside) < 0.975  # 95 %; the standard deviation of 1500 trials is 0.6 %


def test_effective_runs_are_those_by_which_the_variance_falls():
    rng = np.random.default_rng(4)
    pairs = [flights(rng) for _ in range(1500)]
    plain = np.var([(error**2).sum(axis=1).mean() for error, _ in pairs])
    reduced = [controlled_rms(*pair) for pair in pairs]
    gain = plain / np.var([one.rms**2 for one in reduced])
    assert gain > 5.0
    assert np.median([one.effective_runs for one in reduced]) / N == pytest.approx(gain, rel=0.2)


def test_draws_that_explain_nothing_cost_little():
    rng = np.random.default_rng(5)
    found = [controlled_rms(rng.standard_normal((N, 3)), rng.standard_normal((N, M))) for _ in range(300)]
    assert np.mean([one.effective_runs for one in found]) > 0.9 * N
    assert np.mean([one.known for one in found]) < 0.15


def test_results_give_the_plain_and_the_controlled_error_side_by_side(good):
    found = controlled(good).set_index(["case", "metric"])
    row = found.loc[("imu=fine", "velocity_error_3d")]
    assert (row.runs, row.unit, row.event) == (199, "m/s", "injection")
    assert row.controlled_low < row.controlled_rms < row.controlled_high
    assert row.controlled_high - row.controlled_low < 0.7 * (row.high - row.low)
    assert row.controlled_low < row.lincov < row.controlled_high
    assert row.effective_runs > 2 * row.runs
    assert 0.7 < row.known_share_ratio < 1.0


def test_without_runs_there_is_nothing_to_control(alone):
    assert controlled(alone).empty
