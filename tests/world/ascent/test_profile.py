"""Ascents rebuilt from a record."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.interpolate import make_interp_spline

from lvnav_trade.errors import InputError
from lvnav_trade.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    geodetic_from_ecef,
    matrices,
    rotation_i_n,
    unit,
)
from lvnav_trade.world.ascent.profile import RecordedAscent, course, rebuild, tracks_of
from lvnav_trade.world.ascent.record import Climb, read
from lvnav_trade.world.ascent.vehicle import Site
from lvnav_trade.world.truth import motion
from tests.world.flights import record_card, record_settings, recorded

SITE = Site(latitude="-38.6 deg", longitude="-62 deg", height="20 m")
AZIMUTH = 1.1
T = np.linspace(0.0, 500.0, 201)
CLIMB = Climb(make_interp_spline(T, 1.2 * T**2, k=5), make_interp_spline(T, 0.03 * T**2, k=5), 0.0)


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


def rebuilt_minus_record():
    flight, record = recorded(), read(record_settings()["file"])
    m = motion(flight, record.t)
    speed = np.linalg.norm(earth_velocity(m.r_i, m.v_i), axis=1)
    height = geodetic_from_ecef(ecef_from_eci(m.r_i, earth_angle(flight.theta0, m.t)))[2]
    return speed - record.speed, height - 100.0 - record.altitude


def test_speed_and_altitude_match_the_record_within_its_noise():
    # Stated noises: 2 m/s and 100 m; their weighted mean square is one, each by itself stays below 1.5.
    speed, altitude = rebuilt_minus_record()
    assert np.sqrt(np.mean(speed**2)) < 1.5 * 2.0
    assert np.sqrt(np.mean(altitude**2)) < 1.5 * 100.0


def test_the_facts_say_what_was_smoothed():
    speed, altitude = rebuilt_minus_record()
    facts = recorded().facts
    assert facts["smoothing_speed_rms_m_s"] == pytest.approx(np.sqrt(np.mean(speed**2)), rel=1e-3)
    assert abs(facts["smoothing_altitude_worst_m"]) == pytest.approx(np.max(np.abs(altitude)), rel=1e-3)
    assert facts["smoothing_misfit"] == pytest.approx(1.0, abs=0.05)


def test_the_flight_ends_in_the_published_orbit():
    # FormoSat-5 went to 720 km sun-synchronous at 98.28 deg; webcast numbers place it there within 40 km.
    facts = recorded().facts
    assert math.degrees(facts["inclination_rad"]) == pytest.approx(98.28, abs=1e-4)
    assert facts["perigee_m"] == pytest.approx(720e3, abs=40e3)
    assert facts["apogee_m"] == pytest.approx(720e3, abs=40e3)


def test_thrust_is_along_the_roll_axis_in_powered_flight():
    f_b = motion(recorded(), np.concatenate([np.linspace(13.0, 149.0, 50), np.linspace(162.0, 557.0, 50)])).f_b
    assert np.max(np.abs(f_b[:, 1:])) < 1e-3 * np.min(f_b[:, 0])


def test_the_body_turns_through_the_coast_without_haste():
    m = motion(recorded(), np.linspace(0.0, recorded().end, 3000))
    assert np.degrees(np.max(np.linalg.norm(m.w_ib_b, axis=1))) < 1.0


def test_the_body_flies_close_to_the_wind_at_greatest_dynamic_pressure():
    m = motion(recorded(), [71.0])
    x = matrices(m.q_b_i)[0, :, 0]
    assert x @ unit(earth_velocity(m.r_i, m.v_i))[0] > math.cos(math.radians(3.0))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"azimuth": "190 deg"}, "azimuth or the inclination, one of the two"),
        ({"inclination": None}, "azimuth or the inclination, one of the two"),
        ({"events": {"stage1_cutoff": "150 s"}}, "events must name injection"),
    ],
)
def test_a_card_that_contradicts_itself_is_refused(changes, fault):
    with pytest.raises(ValidationError, match=fault):
        RecordedAscent.model_validate({**record_settings(), **changes})


def test_an_inclination_out_of_reach_of_the_site_is_refused():
    with pytest.raises(InputError, match=r"20\.00 deg cannot be reached from a latitude of 34\.63 deg"):
        rebuild(record_card(inclination="20 deg"))


def test_an_event_outside_the_flight_is_refused():
    with pytest.raises(InputError, match="event 'max_q' at 700 s is outside"):
        rebuild(record_card(events={"max_q": "700 s", "injection": "558 s"}))


def test_a_record_that_ends_before_injection_is_refused():
    with pytest.raises(InputError, match="goes from 0 to 558 s, lift-off to injection at 600 s is needed"):
        rebuild(record_card(events={"injection": "600 s"}))
