"""Ascents rebuilt from a record."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML
from scipy.interpolate import make_interp_spline

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    geodetic_from_ecef,
    matrices,
    rotation_i_n,
    unit,
)
from lvnav_trade.trajectory.ascent.profile import RecordedAscent, course, rebuild, rebuilt_phases
from lvnav_trade.trajectory.ascent.record import Climb, read
from lvnav_trade.trajectory.ascent.vehicle_cards import Site
from lvnav_trade.trajectory.truth import BEYOND, NOTE, WARNING, motion
from tests.trajectory.flight_cases import record_card, record_settings, recorded

SITE = Site(latitude="-38.6 deg", longitude="-62 deg", height="20 m")
AZIMUTH = 1.1
T = np.linspace(0.0, 500.0, 201)
CLIMB = Climb(make_interp_spline(T, 1.2 * T**2, k=5), make_interp_spline(T, 0.03 * T**2, k=5), 0.0)


@pytest.fixture(scope="module")
def stretches():
    return rebuilt_phases(course(SITE, AZIMUTH, CLIMB, [150.0, 160.0], 0.4), 20.0)


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


def rows_of_the_shipped_flight(hole=None, until=None, noise=1.0):
    """Time, speed, altitude (n, 3) of the shipped record's flight at 2 Hz, at 10 Hz from 290 to 315 s, with the noise
    that is stated times a factor; without the rows in a hole, and with rows until a time after injection.
    """
    t = np.unique(np.round(np.concatenate([np.arange(0.0, 558.5, 0.5), np.arange(290.0, 315.0, 0.1)]), 6))
    m = motion(recorded(), t)
    speed = np.linalg.norm(earth_velocity(m.r_i, m.v_i), axis=1)
    height = geodetic_from_ecef(ecef_from_eci(m.r_i, earth_angle(recorded().theta0, t)))[2]
    rows = np.column_stack([t, speed, height - record_card().site.height])
    rows[1:, 1:] += np.random.default_rng(5).standard_normal((t.size - 1, 2)) * noise * [2.0, 100.0]
    rows = np.abs(rows)
    if until is not None:
        later = np.arange(until - 1.0, until, 0.5)
        rows = np.concatenate([rows, np.column_stack([later, 0.0 * later + 7500.0, 0.0 * later + 720e3])])
    return rows if hole is None else rows[(rows[:, 0] <= hole[0]) | (rows[:, 0] >= hole[1])]


def card_of(folder, rows, **changes):
    file = folder / "record.csv"
    lines = [",".join(f"{value:.3f}" for value in row) for row in rows]
    file.write_text("\n".join(["time_s,speed_m_s,altitude_m", *lines]))
    return record_card(file=str(file), **changes)


def wrong_digits(share=0.15):
    """The shipped record with a leading or second digit misread in a share of the rows."""
    rows, rng = np.column_stack(read(record_settings()["file"])), np.random.default_rng(2)
    for k in np.flatnonzero(rng.random(len(rows)) < share):
        column = 1 + int(rng.integers(2))
        rows[k, column] += rng.choice([-1.0, 1.0, 2.0]) * 10.0 ** (
            math.floor(math.log10(max(rows[k, column], 1.0))) - 1
        )
    return np.abs(rows)


def notes(flight):
    return [one.text for one in flight.remarks if one.category == NOTE]


LIMITS = ("highest_load", "highest_rate", "highest_spin", "highest_misfit")


def test_a_record_with_wrong_digits_is_refused_at_the_fields_that_would_let_it_fly(tmp_path):
    with pytest.raises(InputError) as caught:
        rebuild(card_of(tmp_path, wrong_digits()))
    found = {one.path.removeprefix("trajectory."): one.message for one in caught.value.records}
    assert {"highest_load", "highest_misfit"} <= set(found) <= set(LIMITS)
    for field, message in found.items():
        assert message.startswith(f"{tmp_path}/record.csv: ")
        assert " is usual: " in message
        assert message.endswith(f"; if it is true, raise {field}")
    assert "RMS misfit to the record" in found["highest_misfit"]


def test_limits_that_are_raised_let_a_record_with_wrong_digits_fly_and_say_so(tmp_path):
    raised = {
        "highest_load": "1000 g",
        "highest_rate": "9000 deg/s",
        "highest_spin": "9000 deg/s",
        "highest_misfit": 900,
    }
    flight = rebuild(card_of(tmp_path, wrong_digits(), **raised))
    (line,) = (one.text for one in flight.remarks if one.category == BEYOND)
    assert "RMS misfit to the record" in line
    assert "specific force" in line
    assert "(usually at most 15 g)" in line


@pytest.mark.parametrize("hole", [(300.0, 300.83), (300.0, 304.9)])
def test_a_hole_that_the_fit_bridges_is_filled_and_said(tmp_path, hole):
    rows = (rows_of_the_shipped_flight(one) for one in (None, hole))
    whole, flight = (rebuild(card_of(tmp_path, one, highest_rate="120 deg/s")) for one in rows)
    assert notes(whole) == []
    (note,) = notes(flight)
    assert note.startswith("no data from 300 to ")
    t = np.linspace(hole[0], hole[1], 20)
    assert np.max(np.linalg.norm(motion(flight, t).v_i - motion(whole, t).v_i, axis=1)) < 4.0


def test_a_longer_hole_is_refused_with_its_place(tmp_path):
    with pytest.raises(
        InputError, match=r"record.csv: no data between 300 s and 305.2 s, where the rows around are 0.1 s apart"
    ):
        rebuild(card_of(tmp_path, rows_of_the_shipped_flight((300.0, 305.15))))


def test_a_gap_after_injection_is_no_reason_to_refuse(tmp_path):
    flight = rebuild(card_of(tmp_path, rows_of_the_shipped_flight(until=700.0)))
    assert flight.remarks == ()
    assert flight.events["injection"] == 558.0
    late = {**record_settings()["events"], "injection": "600 s"}
    own = card_of(tmp_path, rows_of_the_shipped_flight(until=700.0), events=late)
    with pytest.raises(InputError, match="no data between 558 s and 699 s"):
        rebuild(own)


def test_a_record_that_begins_after_lift_off_begins_at_rest_there(tmp_path):
    flight = rebuild(card_of(tmp_path, np.column_stack(read(record_settings()["file"]))[2:]))  # from 10 s on
    m = motion(flight, [0.0])
    assert np.linalg.norm(earth_velocity(m.r_i, m.v_i)) < 1e-6


def test_a_record_without_events_of_stages_suggests_them(tmp_path):
    raised = {
        "highest_misfit": 100,
        "highest_rate": "9000 deg/s",
        "highest_spin": "9000 deg/s",
        "highest_load": "900 g",
    }
    raised |= {"speed_noise": "0.2 m/s", "altitude_noise": "10 m", "events": {"injection": "558 s"}}
    flight = rebuild(card_of(tmp_path, rows_of_the_shipped_flight(noise=0.1), **raised))
    (line,) = (one.text for one in flight.remarks if one.category == WARNING)
    found = YAML(typ="safe").load(line.partition("as YAML: ")[2])["events"]
    assert list(found) == ["stage1_cutoff", "stage2_ignition"]
    times = [float(time.split()[0]) for time in found.values()]
    assert times == pytest.approx([150.0, 161.0], abs=2.5)
    assert recorded().remarks == ()  # the shipped card declares them, and noise suggests no more
