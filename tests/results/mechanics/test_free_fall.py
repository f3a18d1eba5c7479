"""Points of impact against a free fall that scipy integrates down to the ellipsoid."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import (
    earth_velocity,
    ecef_from_eci,
    ecef_from_geodetic,
    eci_from_ecef,
    geodetic_from_ecef,
    rotation_e_n,
)
from lvnav_trade.results.mechanics.free_fall import coast, impact, offsets
from tests import mission as flights

THETA = 0.7
# height (m), latitude (deg), inertial speed: horizontal and up (m/s), azimuth (deg)
FALLS = [
    (100e3, -38.0, 3000.0, 1500.0, 90.0), (60e3, 5.0, 1500.0, 800.0, 10.0), (200e3, 30.0, 7000.0, 100.0, 45.0),
    (200e3, 70.0, 7000.0, -200.0, 170.0), (250e3, 69.0, 300.0, 1000.0, 350.0), (180e3, 10.0, 7400.0, 20.0, 95.0),
]  # fmt: skip


def thrown(height, latitude, speed, up, azimuth):
    r_e = ecef_from_geodetic(np.radians(latitude), 0.3, height)
    angle = np.radians(azimuth)
    v_n = np.array([speed * np.cos(angle), speed * np.sin(angle), -up])
    return eci_from_ecef(r_e, THETA), eci_from_ecef(rotation_e_n(np.radians(latitude), 0.3).T @ v_n, THETA)


def ground(_, y):
    return geodetic_from_ecef(y[:3])[2]


ground.terminal, ground.direction = True, -1


@pytest.mark.parametrize("oblate", [True, False])
@pytest.mark.parametrize("case", FALLS)
def test_the_point_of_impact_is_where_a_numerical_fall_ends(case, oblate):
    r_i, v_i = thrown(*case)
    flown = flights.coast(r_i, v_i, np.array([0.0, 6000.0]), oblate, events=ground)
    t, y = float(flown.t_events[0][0]), flown.y_events[0][0]
    found = impact(r_i, v_i, THETA, j2=oblate)
    theta = THETA + OMEGA * t
    assert found.fall[0] == pytest.approx(t, abs=1e-5)
    np.testing.assert_allclose(found.r_e[0], ecef_from_eci(y[:3], theta), atol=0.01)
    v_n = rotation_e_n(found.latitude[0], found.longitude[0]) @ ecef_from_eci(earth_velocity(y[:3], y[3:]), theta)
    assert found.heading[0] == pytest.approx(np.arctan2(v_n[1], v_n[0]), abs=1e-7)
    assert geodetic_from_ecef(found.r_e[0])[2] == pytest.approx(0.0, abs=1e-3)


def test_oblateness_moves_a_long_fall_by_kilometres():
    r_i, v_i = thrown(*FALLS[-1])
    with_j2, without = impact(r_i, v_i, THETA), impact(r_i, v_i, THETA, j2=False)
    assert 5e3 < float(np.linalg.norm(with_j2.r_e - without.r_e)) < 100e3


def test_an_orbit_that_clears_the_earth_has_no_impact_nor_has_an_escape_or_a_vehicle_on_the_ground():
    assert np.isnan(impact(*thrown(200e3, 20.0, 7900.0, 0.0, 90.0), THETA).fall[0])
    assert np.isnan(impact(*thrown(200e3, 20.0, 12000.0, 3000.0, 90.0), THETA).fall[0])
    assert np.isnan(impact(*thrown(500.0, 20.0, 600.0, 50.0, 90.0), THETA).fall[0])


def test_many_states_fall_as_each_alone():
    states = [thrown(*case) for case in FALLS]
    together = impact(np.array([r for r, _ in states]), np.array([v for _, v in states]), THETA)
    alone = [impact(r_i, v_i, THETA).r_e[0] for r_i, v_i in states]
    np.testing.assert_allclose(together.r_e, alone, atol=1e-6)


def test_offsets_are_down_range_along_the_heading_and_cross_range_to_its_right():
    here = ecef_from_geodetic(np.radians(40.0), 1.0, 0.0)
    north, east = rotation_e_n(np.radians(40.0), 1.0)[:2]
    found = offsets(here, here + 100.0 * north + 10.0 * east, np.radians(90.0))
    np.testing.assert_allclose(found, [10.0, -100.0], atol=1e-9)  # flying east, north is to the left


@pytest.mark.parametrize("seconds", [0.0, 60.0, -60.0, 5400.0])
def test_a_coast_is_a_numerical_flight_about_the_oblate_earth(seconds):
    r_i, v_i = np.array([6.7e6, 1.0e6, 2.0e6]), np.array([-1.5e3, 7.0e3, 3.0e3])
    found = coast(np.stack([r_i, 1.001 * r_i]), np.stack([v_i, v_i]), seconds)
    for k, scale in enumerate((1.0, 1.001)):
        end = flights.coast(scale * r_i, v_i, np.array([0.0, seconds or 1e-9])).y[:, -1]
        np.testing.assert_allclose(found[0][k], end[:3], rtol=0.0, atol=0.1)
        np.testing.assert_allclose(found[1][k], end[3:], rtol=0.0, atol=1e-4)
