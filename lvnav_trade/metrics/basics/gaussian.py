"""Probability that a Gaussian vector of up to three components stays within a sphere, and the other way round."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special

from lvnav_trade.records import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)
_REACH = 9.0
"""Sigmas: beyond them lies 2e-19 of a Gaussian."""


def norm_probability(mean: ArrayLike, covariance: ArrayLike, limit: float) -> float:
    """Return P(|x| < limit) for x Gaussian with mean (k,) and covariance (k, k), k at most 3; exact to about 1e-9.

    The square of the norm is a weighted sum of non-central chi-squares. In the principal axes the axis of largest sigma
    is integrated in closed form, the others by Gauss-Legendre quadrature over the sphere, in an angle in which the
    integrand is smooth at its edge. The result is linear covariance's statement about a requirement.
    """
    if not limit > 0.0:
        return 0.0
    variance, axes = np.linalg.eigh(np.atleast_2d(np.asarray(covariance, dtype=float)))
    sigma = np.sqrt(np.maximum(0.0, variance))  # growing
    centre = axes.T @ np.atleast_1d(np.asarray(mean, dtype=float))
    left, weight = np.array([limit**2]), np.array([1.0])
    for k in range(len(sigma) - 1):
        left, weight = _slice(left, weight, float(centre[k]), float(sigma[k]))
    return float(np.clip(np.sum(weight * _between(np.sqrt(left), float(centre[-1]), float(sigma[-1]))), 0.0, 1.0))


def _slice(left: Floats, weight: Floats, centre: float, sigma: float) -> tuple[Floats, Floats]:
    """Integrate over one axis: return what the nodes leave of the squared radius, and their weights."""
    radius = np.sqrt(left)
    if sigma == 0.0:
        inside = np.abs(centre) < radius
        return np.maximum(left - centre**2, 0.0)[inside], weight[inside]
    low = np.maximum(-radius, centre - _REACH * sigma)
    high = np.minimum(radius, centre + _REACH * sigma)
    some = high > low
    low, high, left, weight = low[some], high[some], left[some], weight[some]
    angle = 0.5 * np.pi * _NODES
    half = 0.5 * (high - low)[:, None]
    x = 0.5 * (high + low)[:, None] + half * np.sin(angle)
    density = np.exp(-0.5 * ((x - centre) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
    step = half * np.cos(angle) * (0.5 * np.pi * _WEIGHTS)
    remaining = np.maximum(left[:, None] - x**2, 0.0)
    return remaining.ravel(), (weight[:, None] * density * step).ravel()


def _between(radius: Floats, centre: float, sigma: float) -> Floats:
    """Return the probability of the last axis within +- radius."""
    if sigma == 0.0:
        return (np.abs(centre) < radius).astype(float)
    found: Floats = special.ndtr((radius - centre) / sigma) - special.ndtr((-radius - centre) / sigma)
    return found


def norm_quantile(mean: ArrayLike, covariance: ArrayLike, probability: float) -> float:
    """Return the limit that |x| stays below with the probability, by bisection; 0 for a vector without size."""
    size = float(np.sqrt(np.sum(np.square(mean)) + np.trace(np.atleast_2d(np.asarray(covariance, dtype=float)))))
    if size == 0.0:
        return 0.0
    high = 2.0 * size
    while norm_probability(mean, covariance, high) < probability:
        high *= 2.0
    return float(
        optimize.brentq(lambda limit: norm_probability(mean, covariance, limit) - probability, 0.0, high, rtol=1e-9)
    )
