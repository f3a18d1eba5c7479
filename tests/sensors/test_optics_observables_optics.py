"""Axes along a boresight, angles between directions, the Earth as a vehicle sees it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices, unit
from lvnav_trade.sensors.optics import angle, boresight_faults, boresight_quaternion, earth_disc
from lvnav_trade.sensors.sensor import FlightView

BORESIGHT = (1.0, 2.0, -2.0)
RADIUS = 6.4e6


@pytest.mark.parametrize("boresight", [BORESIGHT, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -3.0)])
def test_its_axes_are_right_handed_with_the_boresight_for_the_third(boresight):
    C_s_b = matrices(boresight_quaternion(boresight)[None])[0]
    np.testing.assert_allclose(C_s_b @ C_s_b.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(C_s_b) == pytest.approx(1.0)
    np.testing.assert_allclose(C_s_b[:, 2], unit(np.array(boresight)), atol=1e-14)


def test_a_boresight_without_a_direction_is_reported():
    assert list(boresight_faults((0.0, 0.0, 0.0))) == ["boresight (0.0, 0.0, 0.0) has no direction"]
    assert list(boresight_faults(BORESIGHT)) == []


def test_an_angle_is_between_zero_and_half_a_turn():
    one, other = np.eye(3), np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(angle(one, other), [0.0, math.pi / 2.0, math.pi])


@pytest.mark.parametrize("height", [0.0, 4e5, 3.6e7])
def test_a_line_at_the_angle_of_the_limb_touches_the_sphere(height):
    one, r_i = np.zeros(1), (RADIUS + height) * unit(np.array([[1.0, -2.0, 0.5]]))
    flight = FlightView(one, r_i, np.zeros((1, 3)), np.zeros((1, 4)), one + height, one, np.zeros((1, 3)), "")
    down, limb = earth_disc(flight)
    side = unit(np.cross(down, [0.0, 0.0, 1.0]))
    line = np.cos(limb) * down + np.sin(limb) * side
    closest = np.linalg.norm(r_i - np.sum(r_i * line) * line)
    assert closest == pytest.approx(RADIUS, rel=1e-12)
    assert np.sum(r_i * line) < 1e-6 * RADIUS  # ahead, or just here
