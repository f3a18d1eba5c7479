"""Allan deviations: closed forms against simulated streams, fits of the flat part, autoregressive models."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from lvnav_trade.imu.allan import (
    FLOOR,
    Process,
    autocovariance,
    autoregressive,
    combined_deviation,
    fit_floor,
    gauss_markov,
    overlapping,
    random_walk,
    white,
)


def test_a_gauss_markov_process_peaks_where_the_standard_says():
    tau = np.geomspace(1.0, 1000.0, 20001)
    found = gauss_markov(Process(2.0, 20.0), tau)
    at = int(np.argmax(found))
    assert tau[at] / 20.0 == pytest.approx(1.89, rel=3e-3)  # IEEE 952-1997, figure C.6: 0.437 q sqrt(T) at 1.89 T
    assert found[at] == pytest.approx(0.437 * 2.0 * math.sqrt(2.0), rel=2e-3)


def test_a_gauss_markov_process_is_a_random_walk_over_short_and_white_noise_over_long_times():
    one, density = Process(3.0, 50.0), 3.0 * math.sqrt(2.0 / 50.0)
    short, long = np.array([1e-4, 1e-2, 0.2]), np.array([5e4, 5e5])
    np.testing.assert_allclose(gauss_markov(one, short), random_walk(density, short), rtol=3e-3)
    np.testing.assert_allclose(gauss_markov(one, long), white(density * 50.0, long), rtol=1e-3)
    both = gauss_markov(one, np.array([0.0499999, 0.0500001]))  # where the series takes over
    assert both[0] == pytest.approx(both[1], rel=1e-5)


def streams(n=400_000, dt=0.1):
    """White noise, a random walk and a Gauss-Markov process of 20 s as rates over dt, with their closed forms."""
    rng, decay = np.random.default_rng(4), math.exp(-dt / 20.0)
    noise = rng.standard_normal((3, n))
    markov = lfilter([math.sqrt(1.0 - decay**2)], [1.0, -decay], noise[2])
    return np.stack([0.3 / math.sqrt(dt) * noise[0], 0.02 * math.sqrt(dt) * np.cumsum(noise[1]), markov], axis=1)


def test_the_overlapping_deviation_of_a_stream_is_its_closed_form():
    factors = [10, 40, 160, 640]
    tau = 0.1 * np.array(factors)
    expected = np.stack([white(0.3, tau), random_walk(0.02, tau), gauss_markov(Process(1.0, 20.0), tau)], axis=1)
    # 600 intervals of the longest time: 3 % a deviation, two of three within, and half a step of the discrete stream
    np.testing.assert_allclose(overlapping(streams(), 0.1, factors), expected, rtol=0.12)


def test_the_overlapping_deviation_of_a_few_rates_is_that_of_its_definition():
    rates, dt = np.array([1.0, 3.0, 2.0, 5.0, 4.0]), 2.0
    means = np.convolve(rates, [0.5, 0.5], "valid")  # over two steps
    pairs = [(means[k + 2] - means[k]) ** 2 for k in range(2)]
    assert overlapping(rates, dt, [2])[0] == pytest.approx(math.sqrt(0.5 * np.mean(pairs)), rel=1e-14)


@pytest.mark.parametrize(("count", "within"), [(2, 0.2), (3, 0.05), (4, 0.012), (5, 0.003)])
def test_processes_together_are_the_floor(count, within):
    found, tau = fit_floor(5e-8, count, 1.0, 1000.0), np.geomspace(1.0, 1000.0, 200)
    level = combined_deviation(*(gauss_markov(one, tau) for one in found)) / (5e-8 * FLOOR)
    assert np.abs(level - 1.0).max() < within
    assert [one.time_constant for one in found] == sorted(one.time_constant for one in found)


def test_an_autoregressive_model_of_one_step_is_the_gauss_markov_process():
    coefficients, noise = autoregressive([Process(2.0, 5.0)], 1, 0.1)
    assert coefficients[0] == pytest.approx(math.exp(-0.02), rel=1e-12)
    assert noise == pytest.approx(2.0 * math.sqrt(1.0 - math.exp(-0.04)), rel=1e-9)


def test_an_autoregressive_model_has_the_autocovariance_that_it_was_fitted_to():
    processes, order, dt = fit_floor(1.0, 3, 1.0, 100.0), 3, 0.5
    coefficients, noise = autoregressive(processes, order, dt)
    response = lfilter([noise], [1.0, *(-coefficients)], np.eye(1, 40_000)[0])  # its autocovariance is the model's
    found = [response[: response.size - lag] @ response[lag:] for lag in range(order + 1)]
    np.testing.assert_allclose(found, autocovariance(processes, dt * np.arange(order + 1)), rtol=1e-6)


def _deviation(covariance, factors):
    """Return the Allan deviation of a process with steps of 1 s from its autocovariance (2 max + 1,)."""
    found = []
    for m in factors:
        lags = np.arange(1, 2 * m)
        mean = m * covariance[0] + 2.0 * np.sum((m - lags[: m - 1]) * covariance[1:m])  # m^2 variance of a mean
        found.append((mean - np.sum((m - np.abs(m - lags)) * covariance[1 : 2 * m])) / m**2)
    return np.sqrt(found)


def _autoregressive_misfit(order):
    """Return how far the best autoregressive process is from the floor between 1 s and 1000 s (logarithm)."""
    factors = np.unique(np.round(np.geomspace(1, 1000, 16)).astype(int))

    def misses(x):
        coefficients = np.zeros(0)
        for reflection in np.tanh(x[:order]):  # any of them is stable (Levinson's recursion)
            coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        response = np.abs(np.fft.rfft(np.append(1.0, -coefficients), 1 << 14)) ** -2
        covariance = np.fft.irfft(np.exp(2.0 * x[order]) * response)
        return np.log(_deviation(covariance, factors) / FLOOR)

    start = np.append(np.arctanh(np.append(0.96, 1.0 / (np.arange(2, order + 1) + 0.5))), -1.0)
    return np.abs(least_squares(misses, start).fun).max()


def test_the_deviation_from_an_autocovariance_is_the_closed_form():
    lags, factors, fine = np.arange(2001), [100, 300, 1000], Process(1.0, 200.0)
    found = _deviation(autocovariance([fine], lags), factors)
    np.testing.assert_allclose(found, gauss_markov(fine, np.array(factors, dtype=float)), rtol=2e-3)


@pytest.mark.parametrize("order", [2, 3, 5])
def test_two_processes_are_nearer_to_the_floor_than_an_autoregressive_one_of_higher_order(order):
    tau = np.geomspace(1.0, 1000.0, 60)
    two = np.log(combined_deviation(*(gauss_markov(one, tau) for one in fit_floor(1.0, 2, 1.0, 1000.0))) / FLOOR)
    assert 0.15 < np.abs(two).max() < 0.20
    assert 0.25 < _autoregressive_misfit(order) < 0.65
