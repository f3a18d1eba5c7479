"""Records of ascents: reading, the climb fitted to one, comparison."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import GM, SEMI_MAJOR
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.trajectory.ascent.record import AscentRecord, differences, path_force, read, smooth
from lvnav_trade.trajectory.ascent.vehicle_cards import FlightRecords
from lvnav_trade.trajectory.truth import motion
from tests.trajectory.flight_cases import ascent, ascent_card, record_settings

GOOD = ["# a comment", "time_s,speed_m_s,altitude_m", *(f"{5 * k},{10 * k}.0,{25 * k * k}" for k in range(20))]


def written(tmp_path, lines):
    path = tmp_path / "flight.csv"
    path.write_text("\n".join(lines))
    return str(path)


def with_line(number, text):
    """The good file with line `number` (from one) replaced."""
    return [*GOOD[: number - 1], text, *GOOD[number:]]


def test_a_good_record_is_read(tmp_path):
    record = read(written(tmp_path, GOOD))
    assert record.t[-1] == 95.0
    assert record.speed[3] == 30.0
    assert record.altitude[2] == 100.0


def test_the_shipped_record_is_read():
    record = read(record_settings()["file"])
    assert record.t.size == 114
    assert (record.t[-1], record.speed[-1]) == (558.0, 7578.59)


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        (with_line(2, "time,speed,altitude"), r"flight\.csv:2: the header is 'time,speed,altitude', expected 'time_s,"),
        (with_line(6, "15,nan,225"), r"flight\.csv:6: speed_m_s is 'nan', not a finite number"),
        (with_line(6, "15,30,high"), r"flight\.csv:6: altitude_m is 'high', not a number"),
        (with_line(6, "15,3_0,225"), r"flight\.csv:6: speed_m_s is '3_0', not a number"),
        (with_line(6, "15,30"), r"flight\.csv:6: 2 fields, expected 3"),
        (with_line(6, "10,30,225"), r"flight\.csv:6: time_s 10 repeats 10 s of the row before"),
        (with_line(6, "7,30,225"), r"flight\.csv:6: time_s 7 goes back from 10 s"),
        (with_line(6, "15,-1,225"), r"flight\.csv:6: speed_m_s is -1, a speed is not negative"),
        (GOOD[:6], r"flight\.csv: 4 rows of data"),
        ([], r"flight\.csv: 0 rows of data"),
    ],
)
def test_a_broken_record_is_refused_with_file_line_and_fault(tmp_path, lines, fault):
    with pytest.raises(InputError, match=fault):
        read(written(tmp_path, lines))


def test_the_force_along_the_path_is_that_of_the_climb():
    t, h, w, u = known_climb()
    force = path_force(AscentRecord(t, np.hypot(w, u), h))
    assert force.size == t.size - 1
    burning, coasting = (t[1:] < 149.0) & (t[:-1] > 5.0), (t[1:] > 150.0) & (t[1:] < 160.0)
    middle = 0.5 * (t[1:] + t[:-1])
    upwards, along = 6.0 + 0.1 * middle + 9.6, 0.08 * middle
    steep = np.hypot(0.5 * (w[1:] + w[:-1]), 0.5 * (u[1:] + u[:-1]))
    path = (upwards * 0.5 * (w[1:] + w[:-1]) + along * 0.5 * (u[1:] + u[:-1])) / steep
    assert np.max(np.abs(force - path)[burning]) < 0.3
    assert np.max(np.abs(force[coasting])) < 0.3


def test_a_missing_record_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"absent\.csv: cannot be read: No such file"):
        read(str(tmp_path / "absent.csv"))


def test_a_record_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_bytes(b"time_s,speed_m_s,altitude_m\n\x00\x01\n")
    with pytest.raises(InputError, match="is not a text file"):
        read(str(path))


def record_of(tmp_path, speed_off=0.0, altitude_off=0.0):
    t = np.linspace(0.0, ascent().events["injection"], 30)
    m = motion(ascent(), t)
    speed = np.linalg.norm(earth_velocity(m.r_i, m.v_i), axis=1) + speed_off
    height = geodetic_from_ecef(ecef_from_eci(m.r_i, earth_angle(ascent().theta0, t)))[2] - 20.0 + altitude_off
    path = tmp_path / "record.csv"
    rows = [f"{a!r},{abs(b)!r},{c!r}" for a, b, c in zip(t.tolist(), speed.tolist(), height.tolist(), strict=True)]
    path.write_text("\n".join(["time_s,speed_m_s,altitude_m", *rows]))
    return str(path)


def compared(**given):
    return differences(FlightRecords(source="a record", **given), ascent(), ascent_card().site)


def test_a_flight_does_not_differ_from_its_own_record(tmp_path):
    facts = compared(file=record_of(tmp_path))
    assert facts["compared_with"] == "a record"
    assert facts["record_speed_rms_m_s"] < 1e-6
    assert facts["record_altitude_rms_m"] < 1e-6


def test_a_constant_difference_is_its_own_rms_flight_minus_record(tmp_path):
    facts = compared(file=record_of(tmp_path, 3.0, -40.0))
    assert facts["record_speed_rms_m_s"] == pytest.approx(3.0, abs=1e-6)
    assert facts["record_speed_worst_m_s"] == pytest.approx(-3.0, abs=1e-6)
    assert facts["record_altitude_rms_m"] == pytest.approx(40.0, abs=1e-5)
    assert facts["record_altitude_worst_m"] == pytest.approx(40.0, abs=1e-5)


def test_events_tell_how_much_later_they_are():
    facts = compared(events={"stage1_cutoff": "150 s", "an_event_of_the_record_alone": "1 s"})
    assert facts["stage1_cutoff_after_record_s"] == pytest.approx(ascent().events["stage1_cutoff"] - 150.0)
    assert "an_event_of_the_record_alone_after_record_s" not in facts


def test_a_record_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        compared(file=str(tmp_path / "absent.csv"))


NOISE = (2.0, 60.0)


def known_climb():
    """Altitude, its rate and level speed of a climb with cut-off at 150 s, free fall to 160 s, and a second burn."""
    t = np.arange(0.0, 300.5, 0.5)
    up = np.where(t < 150.0, 6.0 + 0.1 * t, np.where(t < 160.0, -GM / (SEMI_MAJOR + 8e4) ** 2, 1.0))
    along = np.where(t < 150.0, 0.08 * t, np.where(t < 160.0, 0.0, 15.0))
    w, u = (np.append(0.0, np.cumsum(0.25 * (a[1:] + a[:-1]))) for a in (up, along))
    h = np.append(0.0, np.cumsum(0.25 * (w[1:] + w[:-1])))
    return t[::10], h[::10], w[::10], u[::10]


def noisy(seed):
    t, h, w, u = known_climb()
    draws = np.random.default_rng(seed).standard_normal((2, t.size))
    speed = np.maximum(np.hypot(w, u) + NOISE[0] * draws[0], 0.0)
    return AscentRecord(t, speed, h + NOISE[1] * draws[1])


def test_the_fit_lies_closer_to_the_known_climb_than_the_record_does():
    t, h, w, u = known_climb()
    climb = smooth(noisy(1), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    assert np.sqrt(np.mean((climb.altitude(t) - h) ** 2)) < 0.7 * NOISE[1]
    assert np.sqrt(np.mean((climb.speed(t) - np.hypot(w, u)) ** 2)) < 1.0 * NOISE[0]


def test_the_residuals_are_the_noise_that_was_stated():
    climb = smooth(noisy(2), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    assert climb.misfit == pytest.approx(1.0, abs=0.1)


def test_speed_is_never_less_than_the_rate_of_climb_and_starts_from_rest():
    climb = smooth(noisy(3), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    t = np.linspace(0.0, 300.0, 1000)
    assert np.all(climb.speed(t) >= np.abs(climb.altitude(t, 1)))
    assert climb.speed(np.array([0.0]))[0] < 1e-9
    assert abs(climb.altitude(0.0)) < 1e-9


def test_acceleration_jumps_at_the_breaks_and_speed_does_not():
    climb = smooth(noisy(4), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    before, after = climb.altitude([150.0 - 1e-6, 150.0 + 1e-6], 2)
    assert before - after > 20.0
    for order, spline in ((0, climb.altitude), (1, climb.altitude), (0, climb.level)):
        left, right = spline([150.0 - 1e-7, 150.0 + 1e-7], order)
        assert abs(left - right) < 1e-3


def test_the_coast_is_in_free_fall():
    climb = smooth(noisy(5), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    t = np.linspace(150.5, 159.5, 10)
    gravity = GM / (SEMI_MAJOR + climb.altitude(t)) ** 2
    assert np.max(np.abs(climb.altitude(t, 2) + gravity - climb.level(t) ** 2 / SEMI_MAJOR)) < 0.3
