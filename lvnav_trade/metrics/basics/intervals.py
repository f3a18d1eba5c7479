"""Intervals: chi-square for mean squares, exact binomial for fractions of runs, Holm for many tests."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from lvnav_trade.records import Floats


def rms_interval(rms: ArrayLike, freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return (low, high) of the true root mean square at confidence 1 - alpha; NaN where there is no freedom."""
    low, high = ratio_interval(freedom, alpha)
    return np.asarray(rms) / high, np.asarray(rms) / low


def ratio_interval(freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return (low, high) between which sample RMS / true RMS lies with probability 1 - alpha."""
    low, high = mean_square_interval(freedom, alpha)
    return np.sqrt(low), np.sqrt(high)


def mean_square_interval(freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return (low, high) between which chi-square / freedom lies with probability 1 - alpha."""
    given = np.asarray(freedom, dtype=float)
    usable = np.where(given > 0, given, np.nan)
    low, high = (np.asarray(stats.chi2.ppf(p, usable) / usable) for p in (alpha / 2.0, 1.0 - alpha / 2.0))
    return low, high


def success_bounds(runs: int, failures: int, confidence: float) -> tuple[float, float]:
    """Return the one-sided lower and the one-sided upper Clopper-Pearson bound on the probability of success."""
    good = runs - failures
    low = float(stats.beta.ppf(1.0 - confidence, good, failures + 1)) if good else 0.0
    high = float(stats.beta.ppf(confidence, good + 1, failures)) if failures else 1.0
    return low, high


def success_verdict(runs: int, failures: int, probability: float, confidence: float) -> str:
    """Return "met" or "violated" where the bounds show it of a probability of success, else "undecided"."""
    low, high = success_bounds(runs, failures, confidence)
    if runs and low >= probability:
        return "met"
    return "violated" if high < probability else "undecided"


def shows(runs: int, failures: int, probability: float, confidence: float) -> bool:
    """Whether so few failures show at that confidence that success has at least that probability."""
    return runs > failures and float(stats.binom.cdf(failures, runs, 1.0 - probability)) <= 1.0 - confidence


def runs_needed(failures: int, probability: float, confidence: float) -> int:
    """Return the smallest number of runs with which so many failures still show the probability of success."""
    high = max(2, 2 * (failures + 1))
    while not shows(high, failures, probability, confidence):
        high *= 2
    low = high // 2 if high > 2 else 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if shows(middle, failures, probability, confidence) else (middle, high)
    return high


def holm(p_values: ArrayLike) -> Floats:
    """Return p-values adjusted by Holm's step-down method: at most alpha of all families have one below alpha."""
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p)))), 1.0)
    return adjusted
