"""Linear covariance of unaided navigation against formulas.

Gravitation and its gradient are kept out by flying 1e10 m from the Earth (gradient 8e-16 1/s^2: over 100 s it acts on
an error by 4e-12), the turning of the body by an attitude that stands still in frame i. What is left is the linear
covariance's own arithmetic, held to 1e-6.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.earth import GM, J2, SEMI_MAJOR, gravity_gradient, gravity_j4
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, flight, loaded, prepare_hop, with_fields

G, DEG_H = 9.80665, math.pi / 180.0 / 3600.0
SECONDS, FORCE = 100.0, 20.0
DELTA_V = FORCE * SECONDS
NOWHERE = {"tilt": "0 rad", "heading": "0 rad", "position": "0 m", "velocity": "0 m/s"}


def still(t):
    """Attitude of a body whose axes are those of frame i."""
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))


@lru_cache(maxsize=4)
def thrusting(force=FORCE):
    """Constant force along x, far from the Earth, for 100 s."""
    there = {"r": np.array([0.0, 1e10, 1e9]), "v": np.array([10.0, 0.0, 0.0])}
    return flight([(SECONDS, lambda t: np.array([force, 0.0, 0.0]))], still, **there)


def at_end(gyro=None, accel=None, initial=None, rate="100 Hz", trajectory=None, frame="inertial", history=1.0):
    """Covariance of a purely inertial case that has these errors and no others."""
    scenario = loaded(INERTIAL)
    imu = with_fields(scenario.imu, rate=rate, gyro=gyro or {}, accel=accel or {})
    scenario = scenario.model_copy(
        update={"imu": imu, "initial": with_fields(scenario.initial, **{**NOWHERE, **(initial or {})}), "frame": frame}
    )
    scenario = with_fields(scenario)
    return covariance(prepare_hop(scenario, trajectory or thrusting(), history=history))


def sigma(cov, quantity, axis):
    return cov.true_sigma[-1, {"attitude": 0, "velocity": 3, "position": 6}[quantity] + "xyz".index(axis)]


t = SECONDS
HALF = 0.5 * t**2
CASES = {
    "accelerometer bias gives b t and b t^2 / 2": (
        {"accel": {"bias_repeatability": "1 mg"}},
        {"velocity y": 1e-3 * G * t, "position y": 1e-3 * G * HALF},
    ),
    "scale factor gives k delta-v and k f t^2 / 2": (
        {"accel": {"scale_factor": "500 ppm"}},
        {"velocity x": 5e-4 * DELTA_V, "position x": 5e-4 * FORCE * HALF},
    ),
    "misalignment gives m delta-v across the thrust": (
        {"accel": {"misalignment": "1 mrad"}},
        {"velocity y": 1e-3 * DELTA_V, "position z": 1e-3 * FORCE * HALF},
    ),
    "nonlinearity gives its fraction of f^2 over full scale": (
        {"accel": {"nonlinearity": "300 ppm", "full_scale": "100 m/s^2"}},
        {"velocity x": 3e-6 * FORCE * DELTA_V},
    ),
    "gyro bias gives w t, g w t^2 / 2 and g w t^3 / 6": (
        {"gyro": {"bias_repeatability": "1 deg/h"}},
        {"attitude z": DEG_H * t, "velocity y": FORCE * DEG_H * HALF, "position y": FORCE * DEG_H * t**3 / 6},
    ),
    "g-sensitivity is a gyro bias of its own times the force": (
        {"gyro": {"g_sensitivity": "1 deg/h/g"}},
        {"attitude x": DEG_H / G * FORCE * t, "position z": FORCE * DEG_H / G * FORCE * t**3 / 6},
    ),
    "tilt gives tilt times delta-v": (
        {"initial": {"tilt": "1 mrad", "heading": "1 mrad"}},
        {"attitude z": 1e-3, "velocity y": 1e-3 * DELTA_V, "position z": 1e-3 * FORCE * HALF},
    ),
    "velocity error gives v t": (
        {"initial": {"velocity": "0.1 m/s"}},
        {"velocity x": 0.1, "position z": 0.1 * t},
    ),
    "position error stays": ({"initial": {"position": "7 m"}}, {"position x": 7.0}),
    "velocity random walk gives N sqrt(t) and N sqrt(t^3 / 3)": (
        {"accel": {"random_walk": "0.001 m/s**1.5"}},
        {"velocity x": 1e-3 * t**0.5, "position x": 1e-3 * (t**3 / 3) ** 0.5},
    ),
    "angle random walk gives N sqrt(t) and f N sqrt(t^3 / 3)": (
        {"gyro": {"random_walk": "1e-5 rad/s**0.5"}},
        {"attitude y": 1e-5 * t**0.5, "velocity z": FORCE * 1e-5 * (t**3 / 3) ** 0.5},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_unaided_error_growth_is_the_formula(name):
    errors, expected = CASES[name]
    cov = at_end(**errors)
    found = {state: sigma(cov, *state.split()) for state in expected}
    assert found == pytest.approx(expected, rel=1e-6)


def test_what_thrust_does_not_excite_stays_without_error():
    # the splines of the truth leave 1e-9 of the force across the thrust
    cov = at_end(accel={"scale_factor": "500 ppm"})
    assert sigma(cov, "velocity", "y") < 1e-7
    cov = at_end(gyro={"bias_repeatability": "1 deg/h"})
    assert sigma(cov, "velocity", "x") < 1e-7


def test_rate_random_walks_give_k_sqrt_t_cubed_over_three():
    """A walk that acts a window late leaves 1.5 windows of 100 s: covariance at 10 Hz, 0.075 % of sigma."""
    cov = at_end(gyro={"rate_random_walk": "1e-7 rad/s**1.5"}, accel={"rate_random_walk": "1e-5 m/s**2.5"})
    assert sigma(cov, "attitude", "x") == pytest.approx(1e-7 * (t**3 / 3) ** 0.5, rel=1e-3)
    assert sigma(cov, "velocity", "x") == pytest.approx(1e-5 * (t**3 / 3) ** 0.5, rel=1e-3)
    assert sigma(cov, "position", "x") == pytest.approx(1e-5 * (t**5 / 20) ** 0.5, rel=2e-3)


def test_bias_instability_integrates_as_a_gauss_markov_process():
    """Variance of the integral: 2 sigma^2 tau (t - tau (1 - exp(-t / tau))); windows of 0.1 s leave (0.1 / tau)^2."""
    s, tau = 1e-4, 10.0
    cov = at_end(accel={"bias_instability": "1e-4 m/s**2", "instability_time": "10 s"})
    expected = s * math.sqrt(2.0 * tau * (t - tau * (1.0 - math.exp(-t / tau))))
    assert sigma(cov, "velocity", "y") == pytest.approx(expected, rel=1e-3)


def test_quantisation_leaves_a_uniform_remainder_that_does_not_grow():
    cov = at_end(gyro={"quantisation": "1e-6 rad"}, accel={"quantisation": "1 mm/s"})
    assert sigma(cov, "attitude", "z") == pytest.approx(1e-6 / math.sqrt(12.0), rel=1e-6)
    # the remainder of angle acts on 20 m/s^2 for as long as it is held, a window of 0.1 s: 1e-3 of the velocity's own
    assert sigma(cov, "velocity", "x") == pytest.approx(1e-3 / math.sqrt(12.0), rel=1e-3)


def test_a_temperature_ramp_is_a_mean_and_no_spread():
    """Bias 1 mg t / 50 s up to 50 s, then 1 mg: velocity is its integral, with the sign of truth minus estimate."""
    ramp = {"start": "0 s", "end": "50 s", "amplitude": ["0 mg", "1 mg", "0 mg"]}
    cov = at_end(accel={"temperature": ramp})
    assert cov.mean[-1, 4] == pytest.approx(-1e-3 * G * 75.0, rel=1e-6)
    assert cov.true_sigma[-1, 4] == 0.0


@pytest.fixture(scope="module")
def hovering():
    """At rest in frame i on the Earth's equator, held by a constant force, for 30 minutes; a slow unit will do."""
    r = np.array([SEMI_MAJOR, 0.0, 0.0])
    hold = -np.array(gravity_j4(*r))
    return flight([(1800.0, lambda t: hold)], still, r=r, v=np.zeros(3))


def test_a_level_position_error_swings_with_schulers_period_and_a_vertical_one_diverges(hovering):
    """84.4 min; the divergence rate is that of the gradient, sqrt(2 g / R): 570 s and, with J2, a thousandth less."""
    cov = at_end(initial={"position": "10 m"}, rate="10 Hz", trajectory=hovering, history=60.0)
    level = 2.0 * math.pi / (84.4 * 60.0)
    # rounding of 84.4 to its last digit is 6e-4 of the phase, 2.2 rad at the end; J2 takes as much again
    assert cov.true_sigma[:, 8] == pytest.approx(10.0 * np.abs(np.cos(level * cov.t)), abs=10.0 * 2.2 * 2.5e-3)
    xx, _, _, yy, _, zz = gravity_gradient(SEMI_MAJOR, 0.0, 0.0)
    assert math.sqrt(xx) == pytest.approx(math.sqrt(2.0 * GM / SEMI_MAJOR**3), rel=3.0 * J2)
    assert cov.true_sigma[:, 6] == pytest.approx(10.0 * np.cosh(math.sqrt(xx) * cov.t), rel=1e-5)
    assert cov.true_sigma[:, 7] == pytest.approx(10.0 * np.abs(np.cos(math.sqrt(-yy) * cov.t)), abs=1e-4)
    assert cov.true_sigma[:, 8] == pytest.approx(10.0 * np.abs(np.cos(math.sqrt(-zz) * cov.t)), abs=1e-4)


def test_an_error_of_velocity_in_a_circular_orbit_runs_ahead_by_three_times_its_distance():
    """Clohessy and Wiltshire: after a revolution the along-track error is 3 P dv, radial and cross-track are back."""
    radius = SEMI_MAJOR + 500e3
    n = math.sqrt(GM / radius**3)
    period = 2.0 * math.pi / n
    orbit = flight(
        [(period, lambda t: np.zeros(3))], still, r=np.array([radius, 0.0, 0.0]), v=np.array([0.0, n * radius, 0.0])
    )
    cov = at_end(initial={"velocity": "0.01 m/s"}, rate="10 Hz", trajectory=orbit, frame="orbital", history=60.0)
    # J2 changes mean motion and distance by 1.5 J2 (a / r)^2, 1.4e-3, over three revolutions' worth of angle
    assert cov.true_sigma[-1, 7] == pytest.approx(3.0 * period * 0.01, rel=5e-3)
    assert cov.true_sigma[-1, 6] < 0.02 * cov.true_sigma[-1, 7]
    # Half of what J2 adds to the cross-track frequency is in the gradient, half in the lower mean radius of an orbit
    # that starts with the velocity of a circle without J2.
    phase = 2.0 * math.pi * 4.5 * J2 * (SEMI_MAJOR / radius) ** 2
    assert cov.true_sigma[-1, 8] == pytest.approx(math.sin(phase) * 0.01 / n, rel=0.01)


def test_monte_carlo_grows_by_the_same_formulas():
    """All constant errors at once, 800 runs: the ratio of sigmas lies within five of its own sigmas, 5 / sqrt(1600)."""
    scenario = loaded(INERTIAL)
    imu = with_fields(scenario.imu, rate="100 Hz", gyro={"bias_repeatability": "1 deg/h"}, accel={
        "bias_repeatability": "1 mg", "scale_factor": "500 ppm", "misalignment": "1 mrad"
    })  # fmt: skip
    scenario = scenario.model_copy(update={"imu": imu, "initial": with_fields(scenario.initial, **NOWHERE)})
    err = run_block(prepare_hop(with_fields(scenario, frame="inertial"), thrusting()), 3, 0, 800).err[:, -1]
    drift = FORCE * DEG_H
    expected = {
        2: DEG_H * t,
        3: math.hypot(1e-3 * G * t, 5e-4 * DELTA_V),
        4: math.hypot(1e-3 * G * t, 1e-3 * DELTA_V, drift * t**2 / 2),
        7: math.hypot(1e-3 * G * t**2 / 2, 1e-3 * FORCE * t**2 / 2, drift * t**3 / 6),
    }
    for state, value in expected.items():
        assert np.sqrt(np.mean(err[:, state] ** 2)) / value == pytest.approx(1.0, abs=5.0 / math.sqrt(1600.0))
