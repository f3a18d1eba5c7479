"""Allan deviation of an IMU: closed forms of its error processes, deviation of a data stream, Gauss-Markov fits.

Over a time tau (IEEE 952-1997, annex C): white noise of root density N has N / sqrt(tau), flicker noise of bias
instability B the floor B sqrt(2 ln 2 / pi), a random walk of root density K has K sqrt(tau / 3), and a first-order
Gauss-Markov process of one-sigma s and time constant T, with x = tau / T,

    2 s^2 / x (1 - (3 - 4 exp(-x) + exp(-2 x)) / (2 x))        squared, at most 0.618 s at 1.89 T.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats

FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Floor of the Allan deviation of flicker noise over its coefficient B, 0.664."""


class Process(NamedTuple):
    """A first-order Gauss-Markov process.

    sigma : rad/s or m/s^2. Standard deviation.
    time_constant : s.
    """

    sigma: float
    time_constant: float


def white(density: float, tau: Floats) -> Floats:
    """Return the Allan deviation (n,) of white noise with root PSD `density` at averaging times tau (n,) s."""
    return np.asarray(density / np.sqrt(tau))


def random_walk(density: float, tau: Floats) -> Floats:
    """Return the Allan deviation (n,) of a random walk with root PSD `density` at averaging times tau (n,) s."""
    return np.asarray(density * np.sqrt(tau / 3.0))


def gauss_markov(process: Process, tau: Floats) -> Floats:
    """Return the Allan deviation (n,) of a Gauss-Markov process at averaging times tau (n,) s."""
    x = np.asarray(tau) / process.time_constant
    # series x^2 / 3 - x^3 / 4 of the bracket for small x, where the difference loses all digits
    bracket = np.where(x < 1e-3, x * (1.0 / 3.0 - 0.25 * x), 1.0 / np.maximum(x, 1e-3) * _bracket(np.maximum(x, 1e-3)))
    return np.asarray(process.sigma * np.sqrt(2.0 * bracket))


def _bracket(x: Floats) -> Floats:
    return 1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)


def together(*parts: Floats) -> Floats:
    """Return the Allan deviation of the sum of independent processes: the root sum of squares."""
    return np.asarray(np.sqrt(np.sum(np.square(parts), axis=0)))


def overlapping(rates: Floats, dt: float, factors: Sequence[int]) -> Floats:
    """Return the overlapping Allan deviation of a data stream, (n_factor, ...).

    Parameters
    ----------
    rates : (n, ...)
        Successive rates, each the mean over dt.
    dt : float
        Sampling interval (s).
    factors : sequence of int
        Averaging times in samples, each below n / 2.
    """
    angle = np.concatenate([np.zeros((1, *rates.shape[1:])), np.cumsum(rates, axis=0)]) * dt
    deviations = []
    for factor in factors:
        second = angle[2 * factor :] - 2.0 * angle[factor:-factor] + angle[: -2 * factor]
        deviations.append(np.sqrt(0.5 * np.mean(second * second, axis=0)) / (factor * dt))
    return np.array(deviations)


def fit_floor(instability: float, count: int, shortest: float, longest: float) -> tuple[Process, ...]:
    """Return Gauss-Markov processes whose total Allan deviation approximates the floor of a bias instability.

    Parameters
    ----------
    instability : float
        Coefficient B (rad/s or m/s^2) of IEEE 952.
    count : int
        Number of processes.
    shortest, longest : float
        Averaging times (s) between which the deviation is flat.

    Returns
    -------
    tuple of Process
        In order of time constant.

    Notes
    -----
    Least squares of the logarithm of the deviation. White noise and rate random walk of the IMU are separate processes,
    so that only the flat part is fitted. A process peaks at 1.89 time constants; the initial guess spreads the peaks
    evenly over the logarithm of time.
    """
    from scipy.optimize import least_squares  # the import takes 0.3 s in every worker, and few IMUs need it

    tau = np.geomspace(shortest, longest, 60)
    edges = np.geomspace(shortest, longest, count + 1)
    times = np.sqrt(edges[1:] * edges[:-1]) / 1.89

    def processes(x: Floats) -> list[Process]:
        return [Process(float(np.exp(s)), float(np.exp(t))) for s, t in zip(x[:count], x[count:], strict=True)]

    def misses(x: Floats) -> Floats:
        return np.asarray(np.log(together(*(gauss_markov(process, tau) for process in processes(x))) / FLOOR))

    start = np.concatenate([np.full(count, math.log(0.8)), np.log(times)])
    low = np.full(2 * count, -8.0)
    high = np.full(2 * count, 3.0)
    low[count:], high[count:] = math.log(0.1 * shortest), math.log(10.0 * longest)
    fitted = processes(least_squares(misses, start, bounds=(low, high)).x)
    return tuple(Process(instability * p.sigma, p.time_constant) for p in sorted(fitted, key=lambda p: p[1]))


def autocovariance(processes: Sequence[Process], lags: Floats) -> Floats:
    """Return the autocovariance of the sum of Gauss-Markov processes at lags (n,) s."""
    lags = np.abs(np.asarray(lags, dtype=float))
    return np.asarray(sum(p.sigma**2 * np.exp(-lags / p.time_constant) for p in processes))


def autoregressive(processes: Sequence[Process], order: int, dt: float) -> tuple[Floats, float]:
    """Return the autoregressive model with the autocovariance of a sum of Gauss-Markov processes (Yule-Walker).

    Parameters
    ----------
    processes : sequence of Process
    order : int
        Order of the model; the autocovariance agrees up to this lag.
    dt : float
        Step of the model (s).

    Returns
    -------
    (order,) array, float
        Coefficients, and sigma of the driving noise.
    """
    from scipy.linalg import solve_toeplitz

    covariance = autocovariance(processes, np.arange(order + 1) * np.float64(dt))
    coefficients = np.asarray(solve_toeplitz(covariance[:-1], covariance[1:]))
    return coefficients, math.sqrt(float(covariance[0] - coefficients @ covariance[1:]))
