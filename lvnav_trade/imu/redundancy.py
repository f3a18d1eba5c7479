"""Redundant IMUs: parity test and mid-value selection."""

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field
from scipy.special import ndtr, ndtri

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Floats

# Numbers of lattice points: for sorted values, and for integrated values.
MANY, FEW = 16384, 128
_GRID = np.linspace(-8.0, 8.0, 129)


class ParityCard(units.Card):
    """Parity test of the IMUs of an array. A failed IMU is excluded for the rest of the flight, or only reported."""

    false_alarm: units.Share = Field(
        1e-3,
        gt=0.0,
        lt=1.0,
        description="largest probability of an alarm in a run without faults",
    )
    window: units.TimeConstant = Field(1.0, description="time over which increments are summed for a test")
    after_detection: Literal["exclude", "report", "hand_over"] = Field(
        "exclude",
        description="exclude: exclude the failed IMU; report: only log the disagreement, because two IMUs do not show"
        " which has failed; hand_over: exclude the prime IMU, whichever has failed (selection: prime)",
    )


class MedianModel(NamedTuple):
    """Statistical linearisation of the median of n readings.

    gains : (n,). Linear gains of the reading errors.
    mean : Mean of the median.
    lasting : Variance of the part that is constant over samples.
    white : Variance of the part that is new in every sample.
    """

    gains: Floats
    mean: float
    lasting: float
    white: float


@lru_cache(maxsize=8)
def _normals(dimension: int, count: int) -> Floats:
    """Return quasi-random normal numbers (2 count, dimension).

    A lattice of powers of the generalised golden ratio (Roberts), and its mirror image so that the mean is zero.
    """
    # root of x^(dimension + 1) = x + 1, by fixed-point iteration
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimension + 1.0))
    steps = root ** -np.arange(1.0, dimension + 1.0)
    lattice = np.mod(0.5 + np.outer(np.arange(1, count + 1), steps), 1.0)
    points = ndtri(lattice)
    return np.concatenate([points, -points])


def _below_probabilities(below: Floats) -> Floats:
    """Return the probabilities (n + 1, ...) that 0 to n of n independent readings lie below a value.

    Poisson binomial distribution by recursion.

    Parameters
    ----------
    below : (n, ...)
        Probability that each reading lies below the value.
    """
    counts = np.zeros((len(below) + 1, *below.shape[1:]))
    counts[0] = 1.0
    for probability in below:
        counts[1:] = counts[1:] * (1.0 - probability) + counts[:-1] * probability
        counts[0] = counts[0] * (1.0 - probability)
    return counts


def _ranks(n: int) -> tuple[int, int]:
    """Return the ranks (from 0) of the two middle readings, which are the same for odd n."""
    return (n - 1) // 2, n // 2


def _integration_points(mean: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Return integration points (k, m), rising, and the probabilities (n, k, m) that readings lie below them."""
    spread = sigma[:, None, None]
    points = mean[:, None] + spread * _GRID[:, None]
    x = np.sort(points.reshape(-1, mean.shape[1]), axis=0)
    return x, ndtr((x - mean[:, None]) / spread)


def _expected(mean: Floats, sigma: Floats) -> Floats:
    """Return the mean (m,) of the median of n normal readings.

    It is the lower end of the range plus the integral of the probability that the median lies above.

    Parameters
    ----------
    mean : (n, m)
        Means of the readings.
    sigma : (n,)
        Their standard deviations.
    """
    x, below = _integration_points(mean, sigma)
    counts = _below_probabilities(below)
    total = np.zeros(mean.shape[1])
    for rank in _ranks(len(mean)):
        above = counts[: rank + 1].sum(axis=0)
        trapezoids = 0.5 * (above[1:] + above[:-1]) * np.diff(x, axis=0)
        total += 0.5 * (x[0] + np.sum(trapezoids, axis=0))
    return total


def _gains(mean: Floats, sigma: Floats) -> Floats:
    """Return the probability (n,) that each of n normal readings is the median.

    Parameters
    ----------
    mean, sigma : (n,)
        Means and standard deviations of the readings.
    """
    _, below = _integration_points(mean[:, None], sigma)
    below = below[..., 0]
    probability = np.zeros(mean.size)
    for k in range(mean.size):
        counts = _below_probabilities(np.delete(below, k, axis=0))
        density = 0.5 * sum(counts[rank] for rank in _ranks(mean.size))
        trapezoids = 0.5 * (density[1:] + density[:-1]) * np.diff(below[k])
        probability[k] = np.sum(trapezoids)
    return np.asarray(probability / probability.sum())  # the sum is one but for the integration error


def middle(mean: Floats, white: Floats, lasting: Floats) -> MedianModel:
    """Return the statistics of the median of n independent normal readings.

    Parameters
    ----------
    mean : (n,)
        Known errors of the readings, in the unit of the readings.
    white : (n,)
        Sigma of the white noise in a sample, > 0.
    lasting : (n,)
        Sigma of the errors that are constant over samples.

    Notes
    -----
    Statistical linearisation (Gelb, Applied Optimal Estimation, 6.2). The best linear gain of a reading, Cov(median, e)
    / Var(e), is the probability that it is the median (Stein's lemma). The residual of the linearisation is
    uncorrelated with the errors. Its lasting part is the residual of the median averaged over white noise.
    """
    n = mean.size
    sigma = np.hypot(white, lasting)
    gains = _gains(mean, sigma)
    errors = sigma * _normals(n, MANY)
    sorted_readings = np.sort(mean + errors, axis=1)
    median = sorted_readings[:, list(_ranks(n))].mean(axis=1)
    total = float(np.var(median - errors @ gains))
    # the lasting part of the residual is its mean over the white noise
    constant = lasting * _normals(n, FEW)
    averaged = _expected((mean + constant).T, white) - constant @ gains
    constant_part = float(np.var(averaged))
    return MedianModel(
        gains=gains,
        mean=float(_expected(mean[:, None], sigma)[0]),
        lasting=float(np.sum((gains * lasting) ** 2)) + min(constant_part, total),
        white=float(np.sum((gains * white) ** 2)) + max(0.0, total - constant_part),
    )
