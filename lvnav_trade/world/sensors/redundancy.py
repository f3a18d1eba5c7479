"""Redundant IMUs: parity test, and the middle value of several readings."""

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.special import ndtr, ndtri

from lvnav_trade import units
from lvnav_trade.records import Floats

# Points of a lattice: where a value is sorted, and where one is integrated.
MANY, FEW = 16384, 128
_GRID = np.linspace(-8.0, 8.0, 129)


class ParityCard(units.Card):
    """Test of the units of a set against each other; one that has failed is left out for the rest of the flight, or the
    failure is reported.
    """

    false_alarm: units.Share = Field(
        1e-3, gt=0.0, lt=1.0, description="largest probability that a flight without faults has an alarm"
    )
    window: units.TimeConstant = Field(1.0, description="time over which increments are summed for a test")
    after_detection: Literal["exclude", "report"] = Field(
        "exclude",
        description="exclude: leave out the IMU that has failed; report: log that they disagree and exclude none, as "
        "two IMUs do not show which has failed",
    )


class Middle(NamedTuple):
    """The middle one of several readings, as statistical linearisation has it: gains (n,) by which errors enter; mean;
    variance of what lasts and of what is new in every sample.
    """

    gains: Floats
    mean: float
    lasting: float
    white: float


@lru_cache(maxsize=8)
def _normals(dimension: int, count: int) -> Floats:
    """Return points (2 count, dimension) that stand for independent normal numbers: a lattice of powers of the
    generalised golden ratio (Roberts), and its mirror image.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimension + 1.0))
    steps = root ** -np.arange(1.0, dimension + 1.0)
    found = ndtri(np.mod(0.5 + np.outer(np.arange(1, count + 1), steps), 1.0))
    return np.concatenate([found, -found])


def _counts(below: Floats) -> Floats:
    """Return the probabilities (n + 1, ...) that so many of n independent readings lie below, by that of each."""
    found = np.zeros((len(below) + 1, *below.shape[1:]))
    found[0] = 1.0
    for one in below:
        found[1:] = found[1:] * (1.0 - one) + found[:-1] * one
        found[0] = found[0] * (1.0 - one)
    return found


def _ranks(n: int) -> tuple[int, int]:
    """Return the ranks (from 0) of the middle one, or of the middle two."""
    return (n - 1) // 2, n // 2


def _places(mean: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Return places (k, m) in rising order and the probabilities (n, k, m) that readings lie below; mean (n, m)."""
    x = np.sort((mean[:, None] + sigma[:, None, None] * _GRID[:, None]).reshape(-1, mean.shape[1]), axis=0)
    return x, ndtr((x - mean[:, None]) / sigma[:, None, None])


def _expected(mean: Floats, sigma: Floats) -> Floats:
    """Return the mean (m,) of the middle one of n normal readings, mean (n, m), sigma (n,): the integral of how
    probably it lies above.
    """
    x, below = _places(mean, sigma)
    counts, total = _counts(below), np.zeros(mean.shape[1])
    for rank in _ranks(len(mean)):
        above = counts[: rank + 1].sum(axis=0)
        total += 0.5 * (x[0] + np.sum(0.5 * (above[1:] + above[:-1]) * np.diff(x, axis=0), axis=0))
    return total


def _gains(mean: Floats, sigma: Floats) -> Floats:
    """Return the probability (n,) that each of n normal readings is the middle one."""
    _, below = _places(mean[:, None], sigma)
    below, found = below[..., 0], np.zeros(mean.size)
    for own in range(mean.size):
        counts = _counts(np.delete(below, own, axis=0))
        at = 0.5 * sum(counts[rank] for rank in _ranks(mean.size))
        found[own] = np.sum(0.5 * (at[1:] + at[:-1]) * np.diff(below[own]))
    return np.asarray(found / found.sum())  # one of them is the middle


def middle(mean: Floats, white: Floats, lasting: Floats) -> Middle:
    """Return the statistics of the middle of n independent normal readings (Gelb, Applied Optimal Estimation, 6.2).

    The best linear gain of a reading, Cov(middle, e) / Var(e), is the probability that it is the middle one (Stein).
    What is left beside is uncorrelated; its part that lasts is that of the mean over white noise alone.

    Parameters
    ----------
    mean, white, lasting
        (n,) known error, sigma of white noise in a sample (> 0), and of errors that last, one unit of measure.
    """
    n, sigma = mean.size, np.hypot(white, lasting)
    gains, errors = _gains(mean, sigma), sigma * _normals(n, MANY)
    left = np.sort(mean + errors, axis=1)[:, list(_ranks(n))].mean(axis=1) - errors @ gains
    held = lasting * _normals(n, FEW)
    of_held = _expected((mean + held).T, white) - held @ gains
    beside, kept = float(np.var(left)), float(np.var(of_held))
    return Middle(
        gains,
        float(_expected(mean[:, None], sigma)[0]),
        float(np.sum((gains * lasting) ** 2)) + min(kept, beside),
        float(np.sum((gains * white) ** 2)) + max(0.0, beside - kept),
    )
