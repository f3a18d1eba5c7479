"""Allan deviation of an inertial unit: closed forms of its processes, the deviation of a stream, Gauss-Markov fits.

Over a time tau (IEEE 952-1997, annex C): white noise of root density N has N / sqrt(tau), flicker noise of bias
instability B the floor B sqrt(2 ln 2 / pi), a random walk of root density K has K sqrt(tau / 3), and a first-order
Gauss-Markov process of one-sigma s and time constant T, with x = tau / T,

    2 s^2 / x (1 - (3 - 4 exp(-x) + exp(-2 x)) / (2 x))        squared, at most 0.618 s at 1.89 T.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Floats

FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)


class Process(NamedTuple):
    """A first-order Gauss-Markov process: one-sigma (SI of the sensor), time constant (s)."""

    sigma: float
    time_constant: float


def white(density: float, tau: Floats) -> Floats:
    """Return the Allan deviation of white noise of a root density, (n,), over tau (n,) s."""
    return np.asarray(density / np.sqrt(tau))


def random_walk(density: float, tau: Floats) -> Floats:
    """Return the Allan deviation of a random walk of a root density, (n,), over tau (n,) s."""
    return np.asarray(density * np.sqrt(tau / 3.0))


def gauss_markov(process: Process, tau: Floats) -> Floats:
    """Return the Allan deviation of a Gauss-Markov process, (n,), over tau (n,) s."""
    x = np.asarray(tau) / process.time_constant
    # of a small x the bracket is x^2 / 3 - x^3 / 4: the difference would lose all digits
    bracket = np.where(x < 1e-3, x * (1.0 / 3.0 - 0.25 * x), 1.0 / np.maximum(x, 1e-3) * _bracket(np.maximum(x, 1e-3)))
    return np.asarray(process.sigma * np.sqrt(2.0 * bracket))


def _bracket(x: Floats) -> Floats:
    return 1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)


def together(*parts: Floats) -> Floats:
    """Return the Allan deviation of independent processes from theirs."""
    return np.asarray(np.sqrt(np.sum(np.square(parts), axis=0)))


def overlapping(rates: Floats, dt: float, factors: Sequence[int]) -> Floats:
    """Return the overlapping Allan deviation of rates (n, ...) that are means over dt s each, over factor dt, as
    (n_factor, ...); factors below n / 2.
    """
    angle = np.concatenate([np.zeros((1, *rates.shape[1:])), np.cumsum(rates, axis=0)]) * dt
    found = []
    for factor in factors:
        second = angle[2 * factor :] - 2.0 * angle[factor:-factor] + angle[: -2 * factor]
        found.append(np.sqrt(0.5 * np.mean(second * second, axis=0)) / (factor * dt))
    return np.array(found)


def fit_floor(instability: float, count: int, shortest: float, longest: float) -> tuple[Process, ...]:
    """Return `count` Gauss-Markov processes whose Allan deviations together come nearest to the floor of a bias
    instability (SI), between averaging times `shortest` and `longest` (s), by least squares of the logarithm.

    White noise and random walk of a unit are processes of their own, so only the flat part is fitted. The peak of one
    process is at 1.89 of its time constant; the start has the peaks evenly spread over the logarithm of time.
    """
    from scipy.optimize import least_squares  # 0.3 s of every process, for few units

    tau = np.geomspace(shortest, longest, 60)
    edges = np.geomspace(shortest, longest, count + 1)
    times = np.sqrt(edges[1:] * edges[:-1]) / 1.89

    def processes(x: Floats) -> list[Process]:
        return [Process(float(np.exp(s)), float(np.exp(t))) for s, t in zip(x[:count], x[count:], strict=True)]

    def misses(x: Floats) -> Floats:
        return np.asarray(np.log(together(*(gauss_markov(one, tau) for one in processes(x))) / FLOOR))

    start = np.concatenate([np.full(count, math.log(0.8)), np.log(times)])
    low, high = np.full(2 * count, -8.0), np.full(2 * count, 3.0)
    low[count:], high[count:] = math.log(0.1 * shortest), math.log(10.0 * longest)
    found = processes(least_squares(misses, start, bounds=(low, high)).x)
    return tuple(Process(instability * one.sigma, one.time_constant) for one in sorted(found, key=lambda p: p[1]))


def autocovariance(processes: Sequence[Process], lags: Floats) -> Floats:
    """Return the autocovariance of the sum of Gauss-Markov processes at lags (n,) s."""
    lags = np.abs(np.asarray(lags, dtype=float))
    return np.asarray(sum(one.sigma**2 * np.exp(-lags / one.time_constant) for one in processes))


def autoregressive(processes: Sequence[Process], order: int, dt: float) -> tuple[Floats, float]:
    """Return coefficients (order,) and one-sigma of the driving noise of the autoregressive process of steps of dt s
    whose autocovariance is that of Gauss-Markov processes up to `order` steps (Yule-Walker equations).
    """
    from scipy.linalg import solve_toeplitz

    covariance = autocovariance(processes, np.arange(order + 1) * np.float64(dt))
    coefficients = np.asarray(solve_toeplitz(covariance[:-1], covariance[1:]))
    return coefficients, math.sqrt(float(covariance[0] - coefficients @ covariance[1:]))
