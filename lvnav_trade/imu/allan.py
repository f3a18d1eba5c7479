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
    """Return the Allan deviation (n,) of white noise, density / sqrt(tau).

    Parameters
    ----------
    density : float
        Root PSD (rad/sqrt(s) or m/s/sqrt(s)).
    tau : (n,) s
        Averaging times.
    """
    root_tau = np.sqrt(tau)
    return np.asarray(density / root_tau)


def random_walk(density: float, tau: Floats) -> Floats:
    """Return the Allan deviation (n,) of a random walk, density sqrt(tau / 3).

    Parameters
    ----------
    density : float
        Root PSD of its rate (rad/s/sqrt(s) or m/s^2/sqrt(s)).
    tau : (n,) s
        Averaging times.
    """
    root_tau = np.sqrt(tau / 3.0)
    return np.asarray(density * root_tau)


def gauss_markov(process: Process, tau: Floats) -> Floats:
    """Return the Allan deviation (n,) of a Gauss-Markov process, by the equation of the module.

    Parameters
    ----------
    process : Process
    tau : (n,) s
        Averaging times.
    """
    x = np.asarray(tau) / process.time_constant
    # series x^2 / 3 - x^3 / 4 of the bracket for small x, where the difference loses all digits
    series = x * (1.0 / 3.0 - 0.25 * x)
    large_x = np.maximum(x, 1e-3)
    closed_form = 1.0 / large_x * _bracket(large_x)
    is_small = x < 1e-3
    relative_variance = 2.0 * np.where(is_small, series, closed_form)
    return np.asarray(process.sigma * np.sqrt(relative_variance))


def _bracket(x: Floats) -> Floats:
    """Return the bracket of the Allan variance of a Gauss-Markov process, as in the module's equation."""
    first_decay = np.exp(-x)
    second_decay = np.exp(-2.0 * x)
    numerator = 3.0 - 4.0 * first_decay + second_decay
    return 1.0 - numerator / (2.0 * x)


def combined_deviation(*deviations: Floats) -> Floats:
    """Return the Allan deviation of the sum of independent processes: the root sum of squares."""
    variances = np.square(deviations)
    total_variance = np.sum(variances, axis=0)
    return np.asarray(np.sqrt(total_variance))


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
    start = np.zeros((1, *rates.shape[1:]))
    rate_sums = np.cumsum(rates, axis=0)
    angle = np.concatenate([start, rate_sums]) * dt
    deviations = []
    for factor in factors:
        first = angle[: -2 * factor]
        middle = angle[factor:-factor]
        last = angle[2 * factor :]
        second_difference = last - 2.0 * middle + first
        square = second_difference * second_difference
        variance = 0.5 * np.mean(square, axis=0)
        tau = factor * dt
        deviations.append(np.sqrt(variance) / tau)
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

    def processes(x: Floats) -> list[Process]:
        log_sigmas = x[:count]
        log_times = x[count:]
        result = []
        for log_sigma, log_time in zip(log_sigmas, log_times, strict=True):
            sigma = float(np.exp(log_sigma))
            time_constant = float(np.exp(log_time))
            result.append(Process(sigma, time_constant))
        return result

    def log_misfit(x: Floats) -> Floats:
        deviations = [gauss_markov(process, tau) for process in processes(x)]
        relative_deviation = combined_deviation(*deviations) / FLOOR
        return np.asarray(np.log(relative_deviation))

    # unknowns: logarithms of the sigmas (relative to B), then of the time constants (s)
    edges = np.geomspace(shortest, longest, count + 1)
    peaks = np.sqrt(edges[1:] * edges[:-1])
    log_time_constants = np.log(peaks / 1.89)
    log_sigmas = np.full(count, math.log(0.8))
    guess = np.concatenate([log_sigmas, log_time_constants])
    low = np.full(2 * count, -8.0)
    low[count:] = math.log(0.1 * shortest)
    high = np.full(2 * count, 3.0)
    high[count:] = math.log(10.0 * longest)
    solution = least_squares(log_misfit, guess, bounds=(low, high))
    unit_processes = processes(solution.x)
    sorted_processes = sorted(unit_processes, key=lambda process: process.time_constant)
    scaled_processes = []
    for process in sorted_processes:
        sigma = instability * process.sigma
        scaled_processes.append(Process(sigma, process.time_constant))
    return tuple(scaled_processes)


def autocovariance(processes: Sequence[Process], lags: Floats) -> Floats:
    """Return the autocovariance (n,) of the sum of independent Gauss-Markov processes: sum of s^2 exp(-|lag| / T).

    Parameters
    ----------
    processes : sequence of Process
    lags : (n,) s
    """
    lags = np.abs(np.asarray(lags, dtype=float))
    terms = []
    for process in processes:
        decay = np.exp(-lags / process.time_constant)
        terms.append(process.sigma**2 * decay)
    return np.asarray(sum(terms))


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

    lags = np.arange(order + 1) * np.float64(dt)
    covariance = autocovariance(processes, lags)
    variance = covariance[0]
    lag_covariance = covariance[1:]
    coefficients = np.asarray(solve_toeplitz(covariance[:-1], lag_covariance))
    driving_variance = float(variance - coefficients @ lag_covariance)
    return coefficients, math.sqrt(driving_variance)
