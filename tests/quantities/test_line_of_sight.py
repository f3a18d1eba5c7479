"""Lines of sight against closed forms: antennas, ranges and their derivatives, angles, dilution of precision."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.earth import SEMI_MAJOR, SEMI_MINOR
from lvnav_trade.kernels.strapdown import N_NAV, Q, R, V
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, rotation_i_n
from lvnav_trade.quantities.line_of_sight import (
    antenna,
    is_occluded,
    line_of_sight,
    look_angles,
    pdop,
    point_mass_gravitation,
    sight,
)

GRAZING = 10e3


def test_an_antenna_ahead_of_a_body_that_yaws_is_ahead_and_swings_to_the_right():
    # identity attitude: body axes are those of frame i; 2 m ahead, yaw of 0.1 rad/s about z: y is to the right
    nav, out = np.zeros(N_NAV), np.zeros(21)
    nav[Q], nav[V : V + 3], nav[R : R + 3] = 1.0, (10.0, 20.0, 30.0), (100.0, 200.0, 300.0)
    antenna(out, nav, np.array([0.0, 0.0, 0.1]), np.array([2.0, 0.0, 0.0]), 1.0)
    np.testing.assert_allclose(out[:3], [102.0, 200.0, 300.0], rtol=1e-15)
    np.testing.assert_allclose(out[3:6], [10.0, 20.2, 30.0], rtol=1e-15)
    np.testing.assert_allclose(out[6:12], [2.0, 0.0, 0.0, 0.0, 0.2, 0.0], rtol=1e-15)


def test_an_antenna_at_the_unit_moves_with_it():
    nav, out = np.arange(1.0, 11.0), np.zeros(21)
    nav[Q : Q + 4] /= np.linalg.norm(nav[Q : Q + 4])
    antenna(out, nav, np.array([1.0, 2.0, 3.0]), np.zeros(3), 1.0)
    np.testing.assert_array_equal(out[:6], nav[[R, R + 1, R + 2, V, V + 1, V + 2]])
    np.testing.assert_array_equal(out[6:], 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_antennas_velocity_moves_with_what_the_body_rate_is_known_by(sign):
    """A rate counts as it is; of a gyro bias that is larger, the rate is smaller."""
    nav, lever = np.array([0.7, -0.1, 0.5, 0.5, 10.0, 20.0, 30.0, 1.0, 2.0, 3.0]), np.array([1.0, -2.0, 0.5])
    nav[Q : Q + 4] /= np.linalg.norm(nav[Q : Q + 4])
    rate, at, before, after = np.array([0.1, 0.2, -0.3]), np.zeros(21), np.zeros(21), np.zeros(21)
    antenna(at, nav, rate, lever, sign)
    for axis in range(3):
        step = 0.5 * sign * np.eye(3)[axis]
        antenna(before, nav, rate - step, lever, sign)
        antenna(after, nav, rate + step, lever, sign)
        np.testing.assert_allclose(at[12:21].reshape(3, 3)[:, axis], after[3:6] - before[3:6], atol=1e-13)


def test_the_line_of_sight_is_a_unit_vector_from_antenna_to_satellite():
    *u, distance = line_of_sight(np.array([103.0, 4.0, 0.0]), np.array([100.0, 0.0, 0.0] + [0.0] * 9))
    assert distance == pytest.approx(5.0, rel=1e-15)
    np.testing.assert_allclose(u, [0.6, 0.8, 0.0], rtol=1e-15)


def test_the_range_of_a_straight_pass_has_its_closed_form():
    """Past at 3 km and 4 km/s, one second after the nearest point: r = 5 km, r' = v^2 t / r, r'' = v^2 d^2 / r^3."""
    seen = sight(np.array([4e3, 3e3, 0.0]), np.array([4e3, 0.0, 0.0]))
    assert (float(seen.distance), float(seen.rate)) == pytest.approx((5e3, 3.2e3), rel=1e-15)
    assert float(seen.acceleration(np.zeros(3))) == pytest.approx(16e6 * 9e6 / 125e9, rel=1e-14)
    # it turns clockwise by v d / r^2, and pulling along the line adds to the range
    np.testing.assert_allclose(seen.direction_rate, 0.48 * np.array([0.6, -0.8, 0.0]), rtol=1e-14)
    assert float(seen.acceleration(2.0 * seen.direction)) == pytest.approx(1152.0 + 2.0, rel=1e-14)


def test_on_a_circle_gravity_bends_the_line_as_much_as_the_speed_turns_it():
    """From the centre of a circular orbit the range is constant: speed and fall cancel to the last digits."""
    gm, radius = 3.986004418e14, np.array([7e6, 26.56e6])
    r = radius[:, None] * np.array([0.6, 0.0, 0.8])
    seen = sight(r, np.sqrt(gm / radius)[:, None] * np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(seen.acceleration(point_mass_gravitation(r, gm)), 0.0, atol=1e-14)
    np.testing.assert_array_equal(seen.rate, 0.0)


def towards(azimuth, elevation):
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


def test_the_dilution_of_precision_of_a_worked_geometry():
    """Elevations 0, 0, 45, 45, 90 deg: PDOP = sqrt(77/3) / 2, in closed form."""
    direction = towards([0.0, 90.0, 180.0, 270.0, 0.0], [0.0, 0.0, 45.0, 45.0, 90.0])[None]
    assert pdop(direction, np.ones((1, 5), dtype=bool))[0] == pytest.approx(math.sqrt(77.0 / 3.0) / 2.0, rel=1e-12)


def test_without_four_satellites_or_with_all_in_one_cone_there_is_none():
    cone = towards(np.arange(5) * 72.0, np.full(5, 30.0))[None]
    assert pdop(cone, np.ones((1, 5), dtype=bool))[0] == math.inf
    four = np.array([[True, True, True, False, False]])
    assert pdop(towards([0.0, 90.0, 180.0, 270.0, 0.0], [0.0, 0.0, 45.0, 45.0, 90.0])[None], four)[0] == math.inf


def test_azimuth_counts_from_north_over_east_and_elevation_upwards():
    theta0, t = 1.2, np.array([100.0])
    here = eci_from_ecef(ecef_from_geodetic(0.7, -0.9, 1000.0), earth_angle(theta0, 100.0))[None]
    ned = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 1.0, -math.sqrt(2.0)], [-1.0, 0.0, 1.0]])
    direction = ned / np.linalg.norm(ned, axis=1, keepdims=True) @ rotation_i_n(here[0], earth_angle(theta0, 100.0))
    azimuth, elevation = look_angles(theta0, t, here, direction[None])
    np.testing.assert_allclose(np.degrees(azimuth[0, 1:]), [90.0, 270.0, 45.0, 180.0], atol=1e-9)
    assert math.cos(azimuth[0, 0]) == pytest.approx(1.0)
    np.testing.assert_allclose(np.degrees(elevation[0]), [0.0, 0.0, 0.0, 45.0, -45.0], atol=1e-9)


def test_from_orbit_the_horizon_lies_at_the_dip_of_the_grazing_sphere():
    here = np.array([SEMI_MAJOR + 500e3, 0.0, 0.0])
    dip = math.acos((SEMI_MAJOR + GRAZING) / (SEMI_MAJOR + 500e3))
    below = np.array([dip - 1e-6, dip + 1e-6])
    there = here + 2e7 * np.stack([-np.sin(below), np.cos(below), 0.0 * below], axis=1)
    assert is_occluded(here, there, GRAZING).tolist() == [False, True]
    assert not is_occluded(here, here * 2.0, GRAZING)
    assert not is_occluded(
        here, np.array([SEMI_MAJOR + 100e3, 1.0, 0.0]), GRAZING
    )  # the Earth is behind what is looked at


def test_a_ray_over_the_pole_clears_the_flattened_earth():
    height = SEMI_MINOR + GRAZING * np.array([0.99, 1.0])
    here, there = (np.stack([x + 0.0 * height, 0.0 * height, height], axis=1) for x in (-1e7, 2e7))
    assert is_occluded(here, there, GRAZING).tolist() == [True, False]


def test_an_antenna_below_the_ellipsoid_or_the_grazing_height_still_sees_upwards():
    here = ecef_from_geodetic(0.5, 0.3, -40.0)
    up = here / np.linalg.norm(here)
    across = np.array([-math.sin(0.3), math.cos(0.3), 0.0])
    there = here + 2e7 * (across + np.array([[1e-3], [-1e-3]]) * up)
    assert is_occluded(here, there, GRAZING).tolist() == [False, True]
