"""One axis of a turning launcher against closed forms: nozzle, body, gust, shaped command, filter, thrusters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import welch

from lvnav_trade.trajectory.guided.axis import (
    body_step,
    command_step,
    filter_gain,
    gust_output,
    gust_step,
    lag_step,
    lateral_force,
    nozzle_step,
    thruster_sense,
)

TAU, LIMIT = 0.035, math.radians(25.0)


def test_a_nozzle_answers_a_small_step_as_a_first_order_lag():
    command = 0.9 * LIMIT * TAU  # below what the rate limit slows
    angle = 0.0
    for k in range(1, 40):
        angle = nozzle_step(angle, command, TAU, LIMIT, 0.005)
        assert angle == pytest.approx(command * (1.0 - math.exp(-0.005 * k / TAU)), abs=1e-15)


@pytest.mark.parametrize("h", [0.005, 0.05, 1.0])
def test_a_nozzle_answers_a_large_step_at_its_rate_limit_and_then_as_a_lag(h):
    command, knee = 10.0 * LIMIT * TAU, LIMIT * TAU
    fast = (command - knee) / LIMIT
    expected = LIMIT * h if h <= fast else command - knee * math.exp(-(h - fast) / TAU)
    assert nozzle_step(0.0, command, TAU, LIMIT, h) == pytest.approx(expected, rel=1e-14)
    assert nozzle_step(0.0, -command, TAU, LIMIT, h) == pytest.approx(-expected, rel=1e-14)


def test_a_nozzle_never_moves_faster_than_its_limit_nor_beyond_its_command():
    rng = np.random.Generator(np.random.PCG64(3))
    angle, h = 0.0, 0.005
    for command in rng.normal(0.0, 0.05, 2000):
        after = nozzle_step(angle, command, TAU, LIMIT, h)
        assert abs(after - angle) <= LIMIT * h * (1.0 + 1e-12)
        assert min(angle, command) - 1e-15 <= after <= max(angle, command) + 1e-15
        angle = after


def test_two_half_steps_of_a_nozzle_are_one_step():
    for command in (0.005, 0.03, 0.3, -0.2):
        mid = nozzle_step(0.01, command, TAU, LIMIT, 0.02)
        assert nozzle_step(mid, command, TAU, LIMIT, 0.02) == pytest.approx(
            nozzle_step(0.01, command, TAU, LIMIT, 0.04), abs=1e-15
        )


def test_a_shaped_command_answers_a_step_as_a_critically_damped_lag():
    value, slope, tau = 0.0, 0.0, 0.5
    for k in range(1, 200):
        value, slope = command_step(value, slope, 0.02, tau, 0.01)
        x = 0.01 * k / tau
        assert value == pytest.approx(0.02 * (1.0 - (1.0 + x) * math.exp(-x)), abs=1e-14)
        assert slope == pytest.approx(0.02 * x / tau * math.exp(-x), abs=1e-14)


def test_a_first_order_lag_reaches_63_percent_after_its_time_constant():
    assert lag_step(0.0, 5.0, 2.0, 2.0) == pytest.approx(5.0 * 0.6321205588285577, rel=1e-14)


def test_an_unstable_body_falls_away_as_a_hyperbolic_cosine():
    # angle'' = moment * airspeed * angle without nozzle, wind and lateral force: the aerodynamic moment alone
    moment, airspeed, h = 0.004, 600.0, 0.0025
    c = (10.0, 0.0, moment, 0.0, airspeed, 0.0, 0.0)
    angle, rate, drift = 0.01, 0.0, 0.0
    for _ in range(800):
        angle, rate, _ = body_step(angle, rate, drift, 0.0, 0.0, 0.0, c, h)
    growth = math.sqrt(moment * airspeed)
    assert angle == pytest.approx(0.01 * math.cosh(2.0 * growth), rel=1e-9)
    assert rate == pytest.approx(0.01 * growth * math.sinh(2.0 * growth), rel=1e-9)


def test_a_body_follows_the_equations_of_motion_of_an_independent_integrator():
    c = (12.0, 33.0, 0.004, 0.04, 600.0, 12.0, 0.003)

    def push(t):
        return 0.01 * math.sin(3.0 * t)

    def slope(t, y):
        air = c[4] * y[0] - y[2] + c[5]
        return [y[1], c[6] - c[0] * push(t) + c[2] * air, c[1] * (push(t) + y[0]) + c[3] * air]

    end = solve_ivp(slope, (0.0, 2.0), [0.01, -0.02, 1.0], rtol=1e-12, atol=1e-14).y[:, -1]
    y, h = (0.01, -0.02, 1.0), 0.0025
    for k in range(800):
        y = body_step(*y, push(k * h), push((k + 0.5) * h), push((k + 1) * h), c, h)
    np.testing.assert_allclose(y, end, rtol=1e-8)


def test_a_nozzle_turns_the_body_back_and_pushes_it_on():
    c = (10.0, 30.0, 0.0, 0.0, 100.0, 0.0, 0.0)
    _, rate, drift = body_step(0.0, 0.0, 0.0, 0.01, 0.01, 0.01, c, 0.001)
    assert rate == pytest.approx(-10.0 * 0.01 * 0.001, rel=1e-12)
    assert drift == pytest.approx(30.0 * 0.01 * 0.001, rel=1e-5)  # less what the turning body takes off
    assert lateral_force(0.0, 0.0, 0.01, c) == pytest.approx(0.3)


def test_wind_from_the_side_turns_an_unstable_body_with_it():
    # Air that moves with the nose's direction hits the body from behind that side: force along it, ahead of the centre.
    c = (10.0, 30.0, 0.002, 0.05, 500.0, 8.0, 0.0)
    _, rate, drift = body_step(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, c, 0.001)
    assert rate == pytest.approx(0.002 * 8.0 * 0.001, rel=1e-4)
    assert drift == pytest.approx(0.05 * 8.0 * 0.001, rel=1e-3)


def stepped(x):
    """The linear map of a gust's step (2, 2) and of its draws (2, 2)."""
    state = np.array([gust_step(a, b, x, 0.0, 0.0) for a, b in ((1.0, 0.0), (0.0, 1.0))]).T
    draws = np.array([gust_step(0.0, 0.0, x, a, b) for a, b in ((1.0, 0.0), (0.0, 1.0))]).T
    return state, draws


@pytest.mark.parametrize("x", [1e-5, 1e-3, 0.05, 1.0, 8.0])
def test_a_gust_keeps_unit_variance_and_the_dryden_correlation_over_any_step(x):
    # Transverse correlation over a distance r: exp(-r / L) (1 - r / 2 L).
    state, draws = stepped(x)
    steady = np.array([[1.0, math.sqrt(0.5)], [math.sqrt(0.5), 1.0]])
    np.testing.assert_allclose(state @ steady @ state.T + draws @ draws.T, steady, atol=1e-12)
    out = np.array([gust_output(1.0, 0.0), gust_output(0.0, 1.0)])
    assert out @ steady @ out == pytest.approx(1.0, abs=1e-14)
    assert out @ state @ steady @ out == pytest.approx(math.exp(-x) * (1.0 - 0.5 * x), abs=1e-12)


def test_the_spectrum_of_a_gust_is_that_of_dryden(record_property):
    # One-sided density at f for V / L = a: (2 / a) (1 + 3 (w / a)^2) / (1 + (w / a)^2)^2, w = 2 pi f (MIL-F-8785C).
    rng = np.random.Generator(np.random.PCG64(5))
    a, rate, n = 1.2, 50.0, 400_000
    draws, values, y = rng.standard_normal((n, 2)), np.empty(n), (0.0, 0.0)
    for k in range(n):
        y = gust_step(*y, a / rate, draws[k, 0], draws[k, 1])
        values[k] = gust_output(*y)
    f, density = welch(values, rate, nperseg=4096)
    w = 2.0 * np.pi * f / a
    theory = 2.0 / a * (1.0 + 3.0 * w**2) / (1.0 + w**2) ** 2
    band = (f > 0.03) & (f < 5.0)
    ratio = density[band] / theory[band]
    record_property("Dryden spectrum, computed over closed form", f"{ratio.mean():.3f}")
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)  # 190 segments, 400 frequencies: 0.5 %
    assert ratio.std() < 3.0 / math.sqrt(2 * n / 4096)


def test_the_filter_settles_at_the_closed_form_and_its_errors_are_what_it_says(record_property):
    # p / r = (-x + sqrt(x^2 + 4 x)) / 2 with x = q / r: the scalar random walk's steady posterior.
    x, noise, n = 0.0205, 1.0, 100_000
    rng = np.random.Generator(np.random.PCG64(7))
    walk, seen = math.sqrt(x) * rng.standard_normal(n), rng.standard_normal(n)
    truth = estimate = 0.0
    variance, errors = noise, np.empty(n)
    for k in range(n):
        truth += walk[k]
        variance, gain = filter_gain(variance, x, noise)
        estimate += gain * (truth + seen[k] - estimate)
        errors[k] = estimate - truth
    closed = 0.5 * (math.sqrt(x * x + 4.0 * x) - x)
    assert variance == pytest.approx(closed, rel=1e-12)
    assert gain == pytest.approx(closed, rel=1e-12)
    record_property("random-walk filter: simulated over closed-form sigma", f"{errors.std() / math.sqrt(closed):.4f}")
    # the error's correlation time is 1 / gain steps, so there are about n gain / 2 independent ones: 3 sigma
    assert errors[100:].std() == pytest.approx(math.sqrt(closed), rel=3.0 / math.sqrt(n * closed))


def test_a_measurement_without_noise_is_taken_whole():
    assert filter_gain(0.0, 1e-6, 0.0) == (0.0, 1.0)
    assert filter_gain(0.0, 0.0, 0.0)[1] == 1.0


@pytest.mark.parametrize(
    ("state", "error", "sense"),
    [(0, 0.9, 0), (0, 1.1, -1), (0, -1.1, 1), (-1, 0.5, -1), (-1, 0.2, 0), (-1, -0.5, 0), (1, -0.5, 1), (1, -0.2, 0)],
)
def test_thrusters_open_outside_the_dead_band_and_close_within_part_of_it(state, error, sense):
    assert thruster_sense(float(state), error, 1.0, 0.3) == sense
