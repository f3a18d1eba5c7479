"""Rows of a user's file."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import gmst, matrices
from lvnav_trade.trajectory.files.rows import read_rows
from tests.trajectory.files.test_row_checks import with_holes
from tests.trajectory.tables import EPOCH, card, path, to_earth, write


def turning(tmp_path, rate, **own):
    """A file of `path` at 30 Hz with a hole of 0.8 s, whose body rolls at a rate (rad/s)."""
    t, _ = with_holes((20.0, 20.8))
    r, v = path(t)
    angle = 0.5 * rate * t
    columns = {"t": t, **dict(zip("xyz", r.T, strict=True)), **dict(zip(("vx", "vy", "vz"), v.T, strict=True))}
    columns |= {"q0": np.cos(angle), "q1": np.sin(angle), "q2": 0.0 * t, "q3": 0.0 * t}
    attitude = {"form": "quaternion", "frame": "eci", "columns": ["q0", "q1", "q2", "q3"], "scalar": "first"}
    return card(write(tmp_path, columns, attitude={**attitude, "turns": "body_to_frame"}, **own))


def test_a_body_that_turns_far_in_a_hole_is_refused(tmp_path):
    assert len(read_rows(turning(tmp_path, 1.0)).notes) == 1
    with pytest.raises(InputError, match=r"mine\.csv:603: no data between 20 s .* the body turns by about 229 deg"):
        read_rows(turning(tmp_path, 5.0))


T = np.arange(0.0, 80.25, 0.5)
LATITUDE, LONGITUDE = 0.3, -1.1  # of the frame ned in which attitudes are written


def earth_motion():
    r, v = path(T)
    spin = np.array([0.0, 0.0, OMEGA])
    return to_earth(T, r), to_earth(T, v - np.cross(spin, r))


def test_earth_fixed_kilometres_and_feet_become_the_inertial_motion(tmp_path):
    (r_e, v_e), (r, v) = earth_motion(), path(T)
    columns = {**dict(zip("abc", r_e.T / 1e3, strict=True)), **dict(zip("def", v_e.T / 0.3048, strict=True))}
    settings = write(
        tmp_path, columns,
        position={"frame": "ecef", "columns": [*"abc"], "unit": "km"},
        velocity={"frame": "ecef", "columns": [*"def"], "unit": "ft/s"},
    )  # fmt: skip
    rows = read_rows(card(settings))
    assert np.max(np.abs(rows.r_i - r)) < 1e-6
    assert np.max(np.abs(rows.v_i - v)) < 1e-9


def test_geodetic_degrees_and_local_velocity_become_the_inertial_motion(tmp_path):
    # geodetic coordinates by the textbook's fixed point, which the package does not use
    (r_e, v_e), (r, v) = earth_motion(), path(T)
    a, f = 6378137.0, 1.0 / 298.257223563
    p = np.hypot(r_e[:, 0], r_e[:, 1])
    lat = np.arctan2(r_e[:, 2], p * (1 - f) ** 2)
    for _ in range(60):  # fixed point of tan(lat) = z / (p - e2 N cos(lat)), plain and slow
        n = a / np.sqrt(1 - f * (2 - f) * np.sin(lat) ** 2)
        lat = np.arctan2(r_e[:, 2] + f * (2 - f) * n * np.sin(lat), p)
    lon = np.arctan2(r_e[:, 1], r_e[:, 0])
    height = p / np.cos(lat) - n
    north = np.column_stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.column_stack([-np.sin(lon), np.cos(lon), 0 * lon])
    ned = {"n": np.sum(north * v_e, 1), "e": np.sum(east * v_e, 1), "d": np.sum(np.cross(north, east) * v_e, 1)}
    settings = write(
        tmp_path, {"lat": np.degrees(lat), "lon": np.degrees(lon) % 360.0, "h": height, **ned},
        position={"frame": "geodetic", "columns": ["lat", "lon", "h"], "unit": "deg", "height_unit": "m"},
        velocity={"frame": "ned", "columns": [*"ned"], "unit": "m/s"},
    )  # fmt: skip
    rows = read_rows(card(settings))
    assert np.max(np.abs(rows.r_i - r)) < 1e-5
    assert np.max(np.abs(rows.v_i - v)) < 1e-8


def test_inertial_axes_of_another_origin_and_time_of_another_clock_are_taken_over(tmp_path):
    r, v = path(T)
    turn = Rotation.from_euler("z", -gmst(EPOCH)).as_matrix()  # the file's x axis is at Greenwich at lift-off
    columns = {"clock": T * 1e3 + 500.0, **dict(zip("abc", (r @ turn.T).T, strict=True)),
               **dict(zip("def", (v @ turn.T).T, strict=True))}  # fmt: skip
    settings = write(
        tmp_path, columns, greenwich="0 deg",
        time={"column": "clock", "unit": "ms", "liftoff": 500.0},
        position={"frame": "eci", "columns": [*"abc"], "unit": "m"},
        velocity={"frame": "eci", "columns": [*"def"], "unit": "m/s"},
    )  # fmt: skip
    rows = read_rows(card(settings))
    assert rows.t == pytest.approx(T)
    assert np.max(np.abs(rows.r_i - r)) < 1e-6
    assert np.max(np.abs(rows.v_i - v)) < 1e-8


def attitude_columns():
    """A body that yaws, pitches and rolls against ned: Euler angles, quaternion (scalar last) and matrix by scipy."""
    angles = np.column_stack([0.3 + 0.01 * T, 1.2 - 0.01 * T, 0.1 * np.sin(T / 9.0)])
    return angles, Rotation.from_euler("ZYX", angles)


FORMS = {
    "euler": {"form": "euler", "frame": "ned", "columns": ["yaw", "pitch", "roll"], "unit": "deg"},
    "quaternion": {"form": "quaternion", "frame": "ned", "columns": ["q1", "q2", "q3", "q4"], "scalar": "last",
                   "turns": "body_to_frame"},
    "first": {"form": "quaternion", "frame": "ned", "columns": ["q4", "q1", "q2", "q3"], "scalar": "first",
              "turns": "body_to_frame"},
    "inverse": {"form": "quaternion", "frame": "ned", "columns": ["p1", "p2", "p3", "p4"], "scalar": "last",
                "turns": "frame_to_body"},
    "matrix": {"form": "matrix", "frame": "ned", "columns": [f"c{k}" for k in range(9)], "turns": "body_to_frame"},
    "transposed": {"form": "matrix", "frame": "ned", "columns": [f"c{k}" for k in (0, 3, 6, 1, 4, 7, 2, 5, 8)],
                   "turns": "frame_to_body"},
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_an_attitude_is_the_same_attitude(tmp_path, form):
    angles, rotation = attitude_columns()
    columns = dict(zip(("yaw", "pitch", "roll"), np.degrees(angles).T, strict=True))
    columns |= dict(zip(("q1", "q2", "q3", "q4"), rotation.as_quat().T, strict=True))
    columns |= dict(zip(("p1", "p2", "p3", "p4"), rotation.inv().as_quat().T, strict=True))
    columns |= {f"c{k}": rotation.as_matrix().reshape(-1, 9)[:, k] for k in range(9)}
    rows = read_rows(card(write(tmp_path, columns, attitude=FORMS[form])))
    r_e, _ = earth_motion()
    down_e = -r_e / np.linalg.norm(r_e, axis=1, keepdims=True)
    # by hand: the nose's angle from the vertical (geocentric, 0.2 deg at most from the geodetic one) is the pitch
    nose_e = to_earth(T, matrices(rows.q_b_i)[:, :, 0])
    pitch = -np.arcsin(np.sum(nose_e * down_e, axis=1))
    assert np.max(np.abs(pitch - angles[:, 1])) < math.radians(0.25)
    reference = read_rows(card(write(tmp_path, columns, name="other.csv", attitude=FORMS["euler"])))
    assert np.min(np.abs(np.sum(rows.q_b_i * reference.q_b_i, axis=1))) > 1.0 - 1e-13


@pytest.mark.parametrize(
    ("columns", "changes", "fault"),
    [
        ({"x": T * 0.0 + 6378.0}, {}, r"mine.csv:2: the position is 4068\.15 km"),
        ({}, {"position": {"frame": "eci", "columns": [*"xyz"], "unit": "km"}}, "from the Earth's centre; is the unit"),
        ({"vx": T * 0.0 + 7.5e6}, {}, r"mine.csv:2: a speed of 7500 km/s; is the unit right\?"),
        (
            {"lat": T + 80.0, "lon": T, "h": T},
            {"position": {"frame": "geodetic", "columns": ["lat", "lon", "h"], "unit": "deg", "height_unit": "m"}},
            r"mine.csv:23: lat: 90\.5 deg is no latitude",
        ),
        (
            {"lat": T, "lon": T * 10.0, "h": T},
            {"position": {"frame": "geodetic", "columns": ["lat", "lon", "h"], "unit": "deg", "height_unit": "m"}},
            r"mine.csv:75: lon: 365 deg is no longitude",
        ),
        ({f"q{k}": T * 0.0 + 0.6 for k in range(1, 5)}, {"attitude": FORMS["quaternion"]}, "has length 1.2, not 1"),
        ({f"c{k}": T * 0.0 + 0.6 for k in range(9)}, {"attitude": FORMS["matrix"]}, "the matrix is no rotation"),
    ],
)
def test_rows_that_cannot_be_are_named(tmp_path, columns, changes, fault):
    with pytest.raises(InputError, match=fault):
        read_rows(card(write(tmp_path, columns, **changes)))


def test_rounding_of_a_file_is_its_noise_unless_the_card_says_otherwise(tmp_path):
    rows = read_rows(card(write(tmp_path, digits=3)))
    assert rows.noise == pytest.approx((1e-3 / math.sqrt(12.0), 1e-3 / math.sqrt(12.0), 0.0))
    assert read_rows(card(write(tmp_path, digits=3, position_noise="2 m"))).noise[0] == 2.0
