"""A climb laid over the Earth keeps its altitude, speed and heading."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from lvnav_trade.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_i_n, unit
from lvnav_trade.world.ascent.groundtrack import course, tracks_of
from lvnav_trade.world.ascent.smoothing import Climb
from lvnav_trade.world.ascent.vehicle import Site

SITE = Site(latitude="-38.6 deg", longitude="-62 deg", height="20 m")
AZIMUTH = 1.1
T = np.linspace(0.0, 500.0, 201)
CLIMB = Climb(make_interp_spline(T, 1.2 * T**2, k=5), make_interp_spline(T, 0.03 * T**2, k=4), 0.0)


@pytest.fixture(scope="module")
def stretches():
    return tracks_of(course(SITE, AZIMUTH, CLIMB, [150.0, 160.0], 0.4), 20.0)


def state_at(stretches, t):
    stretch = next(s for s in stretches if s.start <= t <= s.end)
    return stretch.position(t), stretch.position(t, 1)


@pytest.mark.parametrize("t", [0.5, 100.0, 155.0, 300.0, 499.0])
def test_altitude_and_speed_are_those_of_the_climb(stretches, t):
    r_i, v_i = state_at(stretches, t)
    height = geodetic_from_ecef(ecef_from_eci(r_i, earth_angle(0.4, t)))[2]
    assert height == pytest.approx(20.0 + 1.2 * t**2, abs=1e-3)
    assert np.linalg.norm(earth_velocity(r_i, v_i)) == pytest.approx(np.hypot(2.4 * t, 0.03 * t**2), abs=1e-5)


def test_the_track_leaves_the_site_by_the_azimuth(stretches):
    t = 20.0
    r_i, v_i = state_at(stretches, t)
    north, east, down = rotation_i_n(r_i, earth_angle(0.4, t)) @ earth_velocity(r_i, v_i)
    assert np.arctan2(east, north) == pytest.approx(AZIMUTH, abs=1e-4)
    assert down == pytest.approx(-2.4 * t, abs=1e-5)


def test_the_normals_of_the_track_stay_in_one_plane(stretches):
    t = np.array([1.0, 200.0, 350.0, 500.0])
    r_i = np.array([state_at(stretches, value)[0] for value in t])
    lat, lon, _ = geodetic_from_ecef(ecef_from_eci(r_i, earth_angle(0.4, t)))
    normals = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    plane = unit(np.cross(normals[0], normals[-1]))
    assert np.max(np.abs(normals @ plane)) < 1e-9


def test_the_final_coast_follows_from_the_end_of_the_record(stretches):
    last, coast = stretches[-2:]
    assert (coast.name, coast.end - coast.start) == ("final coast", pytest.approx(20.0))
    assert np.max(np.abs(coast.position(coast.start) - last.position(last.end))) < 1e-7
    assert np.max(np.abs(coast.position(coast.start, 1) - last.position(last.end, 1))) < 1e-6
