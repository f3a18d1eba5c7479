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
    constant_variance : Variance of the part that is constant over samples.
    white_variance : Variance of the part that is new in every sample.
    """

    gains: Floats
    mean: float
    constant_variance: float
    white_variance: float


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
    numbers = np.arange(1, count + 1)
    offsets = 0.5 + np.outer(numbers, steps)
    lattice = np.mod(offsets, 1.0)
    points = ndtri(lattice)
    return np.concatenate([points, -points])


def _below_probabilities(probabilities: Floats) -> Floats:
    """Return the probabilities (n + 1, ...) that 0 to n of n independent readings lie below a value.

    Poisson binomial distribution by recursion.

    Parameters
    ----------
    probabilities : (n, ...)
        Probability that each reading lies below the value.
    """
    counts = np.zeros((len(probabilities) + 1, *probabilities.shape[1:]))
    counts[0] = 1.0
    for probability in probabilities:
        complement = 1.0 - probability
        counts[1:] = counts[1:] * complement + counts[:-1] * probability
        counts[0] = counts[0] * complement
    return counts


def _ranks(n: int) -> tuple[int, int]:
    """Return the ranks (from 0) of the two middle readings, which are the same for odd n."""
    lower = (n - 1) // 2
    upper = n // 2
    return lower, upper


def _integration_points(mean: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Return integration points (k, m), rising, and the probabilities (n, k, m) that readings lie below them."""
    spread = sigma[:, None, None]
    centre = mean[:, None]
    points = centre + spread * _GRID[:, None]
    n_column = mean.shape[1]
    x = np.sort(points.reshape(-1, n_column), axis=0)
    normalised_points = (x - centre) / spread
    return x, ndtr(normalised_points)


def _mean_median(mean: Floats, sigma: Floats) -> Floats:
    """Return the mean (m,) of the median of n normal readings.

    It is the lower end of the range plus the integral of the probability that the median lies above.

    Parameters
    ----------
    mean : (n, m)
        Means of the readings.
    sigma : (n,)
        Their standard deviations.
    """
    x, probabilities = _integration_points(mean, sigma)
    counts = _below_probabilities(probabilities)
    total = np.zeros(mean.shape[1])
    for rank in _ranks(len(mean)):
        exceedance = counts[: rank + 1].sum(axis=0)
        mean_height = 0.5 * (exceedance[1:] + exceedance[:-1])
        trapezoids = mean_height * np.diff(x, axis=0)
        integral = np.sum(trapezoids, axis=0)
        total += 0.5 * (x[0] + integral)
    return total


def _gains(mean: Floats, sigma: Floats) -> Floats:
    """Return the probability (n,) that each of n normal readings is the median.

    Parameters
    ----------
    mean, sigma : (n,)
        Means and standard deviations of the readings.
    """
    _, probabilities = _integration_points(mean[:, None], sigma)
    probabilities = probabilities[..., 0]
    n = mean.size
    probability = np.zeros(n)
    for k in range(n):
        other_probabilities = np.delete(probabilities, k, axis=0)
        counts = _below_probabilities(other_probabilities)
        density = 0.5 * sum(counts[rank] for rank in _ranks(n))
        mean_height = 0.5 * (density[1:] + density[:-1])
        trapezoids = mean_height * np.diff(probabilities[k])
        probability[k] = np.sum(trapezoids)
    total = probability.sum()  # one but for the integration error
    return np.asarray(probability / total)


def median_model(mean: Floats, white_sigma: Floats, constant_sigma: Floats) -> MedianModel:
    """Return the statistics of the median of n independent normal readings.

    Parameters
    ----------
    mean : (n,)
        Known errors of the readings, in the unit of the readings.
    white_sigma : (n,)
        Sigma of the white noise in a sample, > 0.
    constant_sigma : (n,)
        Sigma of the errors that are constant over samples.

    Notes
    -----
    Statistical linearisation (Gelb, Applied Optimal Estimation, 6.2). The best linear gain of a reading, Cov(median, e)
    / Var(e), is the probability that it is the median (Stein's lemma). The residual of the linearisation is
    uncorrelated with the errors. Its constant part is the residual of the median averaged over white noise.
    """
    n = mean.size
    sigma = np.hypot(white_sigma, constant_sigma)
    gains = _gains(mean, sigma)
    errors = sigma * _normals(n, MANY)
    sorted_readings = np.sort(mean + errors, axis=1)
    middle_ranks = list(_ranks(n))
    median = sorted_readings[:, middle_ranks].mean(axis=1)
    residual = median - errors @ gains
    total = float(np.var(residual))
    # the constant part of the residual is its mean over the white noise
    constant = constant_sigma * _normals(n, FEW)
    mean_median = _mean_median((mean + constant).T, white_sigma)
    mean_residual = mean_median - constant @ gains
    constant_part = float(np.var(mean_residual))
    white_part = max(0.0, total - constant_part)
    linear_constant = float(np.sum((gains * constant_sigma) ** 2))
    linear_white = float(np.sum((gains * white_sigma) ** 2))
    median_mean = _mean_median(mean[:, None], sigma)
    return MedianModel(
        gains=gains,
        mean=float(median_mean[0]),
        constant_variance=linear_constant + min(constant_part, total),
        white_variance=linear_white + white_part,
    )
