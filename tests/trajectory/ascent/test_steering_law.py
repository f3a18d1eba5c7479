"""Laws of steering and the attitude of an ascent."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices, unit
from lvnav_trade.trajectory.ascent.steering_law import (
    Steering,
    ascent_attitude,
    direction,
    directions,
    roll_angle,
    smoothstep,
    smoothsteps,
)
from lvnav_trade.trajectory.ascent.vehicle_cards import Roll

RADIUS = 6.5e6
SPEED = 3000.0


def steering(**changes):
    base = Steering(
        np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.0, 8.0, 8.0, math.radians(5.0), 16.0, 10.0,
        np.array([100.0]), np.array([[0.0, 0.0, 1.0]]), np.array([0.5]), np.array([-1e-3]),
    )  # fmt: skip
    return base._replace(**changes)


def state(t):
    """A circular-like path in the equatorial plane."""
    angle = SPEED * t / RADIUS
    r = (RADIUS * math.cos(angle), RADIUS * math.sin(angle), 0.0)
    return r, (-SPEED * math.sin(angle), SPEED * math.cos(angle), 0.0)


def test_the_smoothstep_has_no_slope_and_no_curvature_at_its_ends():
    h = 1e-4
    for x in (0.0, 1.0):
        assert abs(smoothstep(x + h) - smoothstep(x - h)) < 20 * h**3
    assert smoothstep(0.5) == 0.5
    assert (smoothstep(-1.0), smoothstep(2.0)) == (0.0, 1.0)


def test_before_the_kick_the_thrust_is_up():
    assert direction(0.0, *state(0.0), steering()) == pytest.approx((1.0, 0.0, 0.0), abs=1e-15)


def test_the_kick_tilts_by_its_angle():
    x = np.array(direction(16.0, *state(0.0), steering(theta0=-7.292115e-5 * 16.0)))
    assert math.degrees(math.acos(x[0])) == pytest.approx(5.0, abs=1e-6)


def test_in_the_gravity_turn_the_thrust_is_along_the_earth_relative_velocity():
    r, v = state(50.0)
    w = np.array(v) - np.cross([0.0, 0.0, 7.292115e-5], r)
    assert direction(50.0, r, v, steering()) == pytest.approx(tuple(w / np.linalg.norm(w)), abs=1e-14)


def test_the_linear_tangent_law_gives_its_elevation():
    t = 300.0
    r, v = state(t)
    x = np.array(direction(t, r, v, steering()))
    up = np.array(r) / RADIUS
    assert math.tan(math.asin(x @ up)) == pytest.approx(0.5 - 1e-3 * 200.0, abs=1e-12)


def test_the_direction_is_unit_and_its_rate_does_not_jump():
    t = np.arange(0.0, 200.0, 0.01)
    y = np.array([[*r, *v] for r, v in map(state, t)])
    x = directions(t, y, steering())
    assert np.allclose(np.linalg.norm(x, axis=1), 1.0, atol=1e-14)
    # Turns here by up to 12 deg/s^2 through the blends; a jump of rate of 0.2 deg/s would show as 3e-5.
    assert np.max(np.abs(np.diff(x, n=2, axis=0))) < 3e-5


ROLL = Roll(pad="60 deg", flight="-20 deg", start="5 s", rate="4 deg/s")


def test_roll_goes_from_the_pad_angle_to_the_flight_angle_within_its_rate():
    t = np.arange(-60.0, 100.0, 0.01)
    angle = roll_angle(ROLL, t)
    assert np.all(angle[t <= 5.0] == math.radians(60.0))
    assert angle[-1] == pytest.approx(math.radians(-20.0))
    assert np.max(np.abs(np.diff(angle))) / 0.01 == pytest.approx(math.radians(4.0), rel=1e-4)


def test_a_roll_of_nothing_stays():
    assert np.all(roll_angle(Roll(), np.array([-1.0, 50.0])) == 0.0)


def test_steps_of_an_array_are_those_of_the_kernel():
    x = np.linspace(-0.5, 1.5, 41)
    assert np.allclose(smoothsteps(x), [smoothstep(value) for value in x], atol=1e-15)


def test_zero_roll_has_the_y_axis_to_the_right_and_z_downrange_on_the_pad():
    # Up is x, downrange y, right z of a frame that does not turn noticeably in 10 s.
    t = np.linspace(0.0, 10.0, 41)
    up = np.broadcast_to([1.0, 0.0, 0.0], (41, 3))
    q = ascent_attitude(t, up, np.array([0.0, 0.0, -1.0]), 0.0, Roll())(0.0)
    x, y, z = matrices(unit(q)).T
    assert np.allclose([x, y, z], [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], atol=1e-12)
