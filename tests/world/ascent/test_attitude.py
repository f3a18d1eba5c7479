"""Roll programme and body axes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.frames import matrices, unit
from lvnav_trade.world.ascent.attitude import ascent_attitude, roll_angle, smoothsteps
from lvnav_trade.world.ascent.steering_law import smoothstep
from lvnav_trade.world.ascent.vehicle import Roll

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
