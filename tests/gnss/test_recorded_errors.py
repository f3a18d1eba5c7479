"""Recorded errors of a receiver are read as they stand, in their own frame, and mistakes have their place."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.recorded_errors import (
    ErrorTable,
    PositionErrorColumns,
    VelocityErrorColumns,
    inertial_errors,
    recording,
    refuse_short,
    sample_errors,
)
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, eci_from_ecef, rotation_i_e, rotation_i_n

HEADER = "t_s,n_m,e_m,d_m,vn_cm_s,ve_cm_s,vd_cm_s"


def write(path, rows, header=HEADER):
    path.write_text("\n".join([header, *(",".join(f"{x:g}" for x in row) for row in rows)]) + "\n")
    return str(path)


def card(file, **fields):
    settings = {
        "file": file, "frame": "ned", "time": {"column": "t_s", "unit": "s"},
        "position": {"columns": ["n_m", "e_m", "d_m"]}, "velocity": {"columns": ["vn_cm_s", "ve_cm_s", "vd_cm_s"]},
    }  # fmt: skip
    return ErrorTable.model_validate(settings | fields)


@pytest.fixture
def ramp(tmp_path):
    """Ten rows, 1 s apart: north k m, east 2 k m, down 0; velocity north 100 cm/s."""
    return write(tmp_path / "ramp.csv", [(k, k, 2 * k, 0, 100, 0, 0) for k in range(10)])


def test_units_are_stated_or_stand_at_the_end_of_the_columns_names(ramp, tmp_path):
    found = recording(card(ramp)).errors
    np.testing.assert_allclose(found[3], [3.0, 6.0, 0.0, 1.0, 0.0, 0.0])
    stated = recording(card(ramp, position={"columns": ["n_m", "e_m", "d_m"], "unit": "km"})).errors
    np.testing.assert_allclose(stated[3, :3], [3e3, 6e3, 0.0])
    assert PositionErrorColumns(columns=("a_mm", "b_mm", "c_mm")).column_unit == "mm"
    assert VelocityErrorColumns(columns=("a_km_s", "b_km_s", "c_km_s")).column_unit == "km/s"
    assert VelocityErrorColumns(columns=("a_m_s", "b_m_s", "c_m_s")).column_unit == "m/s"


@pytest.mark.parametrize("names", [("n", "e", "d"), ("n_m", "e_m", "d_cm"), ("n_m_s", "e_m_s", "d_m_s")])
def test_names_without_one_unit_are_refused(names):
    with pytest.raises(ValidationError, match=r"unit is missing, and the columns .* do not all end in one of _km, _cm"):
        PositionErrorColumns(columns=names)


def test_time_sign_and_size_are_as_the_card_says(ramp):
    shifted = recording(card(ramp, time={"column": "t_s", "unit": "min", "liftoff": 2.0}))
    np.testing.assert_allclose(shifted.t[:3], [-120.0, -60.0, 0.0])
    other = recording(card(ramp, truth_minus_solution=True, factor="50 percent"))
    np.testing.assert_allclose(other.errors, -0.5 * recording(card(ramp)).errors)


def test_without_velocity_there_is_no_error_of_it(ramp):
    assert np.all(recording(card(ramp, velocity=None)).errors[:, 3:] == 0.0)


def test_parquet_holds_the_same(ramp, tmp_path):
    text = recording(card(ramp))
    names = HEADER.split(",")
    table = {name: [float(x) for x in column] for name, column in zip(
        names, np.loadtxt(ramp, delimiter=",", skiprows=1).T, strict=True)}  # fmt: skip
    pq.write_table(pa.table(table), tmp_path / "a.parquet")
    np.testing.assert_array_equal(recording(card(str(tmp_path / "a.parquet"))).errors, text.errors)


def test_between_rows_errors_are_straight_lines_and_outside_as_the_card_says(ramp):
    t = np.array([-1.0, 0.0, 2.25, 9.0, 9.5, 10.0, 12.25])
    repeated, zero = sample_errors(card(ramp, outside="repeat"), t), sample_errors(card(ramp, outside="zero"), t)
    # one interval after the last row (9 s) comes the first row again
    np.testing.assert_allclose(repeated[0, :, 0], [9.0, 0.0, 2.25, 9.0, 4.5, 0.0, 2.25])
    np.testing.assert_allclose(zero[0, :, 0], [0.0, 0.0, 2.25, 9.0, 0.0, 0.0, 0.0])


def test_starts_are_equally_spaced_places_of_the_recording(ramp):
    found = sample_errors(card(ramp, outside="repeat", starts=5), np.array([0.0, 1.0]))
    np.testing.assert_allclose(found[:, :, 0], [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]])


def test_a_recording_that_is_begun_anywhere_must_repeat(ramp):
    with pytest.raises(ValidationError, match="set outside: repeat"):
        card(ramp, starts=5)


def test_a_flight_beyond_the_rows_is_refused_unless_the_card_says_what_then(ramp):
    refuse_short(card(ramp), 0.0, 9.0)
    with pytest.raises(InputError, match=r"ramp.csv: rows from 0 to 9 s, the flight is from -60 to 9 s: set outside"):
        refuse_short(card(ramp), -60.0, 9.0)
    with pytest.raises(InputError, match=r"the flight is from 0 to 9\.5 s"):
        refuse_short(card(ramp), 0.0, 9.5)
    for outside in ("zero", "repeat"):
        refuse_short(card(ramp, outside=outside), -60.0, 600.0)


@pytest.mark.parametrize(
    ("rows", "header", "fault"),
    [
        ([(k, 0, 0, 0, 0, 0, 0) for k in (0, 1, 2, 8, 9)], HEADER, r":5: no rows between 2 s and 8 s, a gap longer"),
        ([(k, 0, 0, 0, 0, 0, 0) for k in (0, 1, 1, 2)], HEADER, r":4: time 1 s repeats 1 s of the row before"),
        ([(k, 0, 0, 0, 0, 0, 0) for k in (0, 2, 1)], HEADER, r":4: time 1 s goes back from 2 s"),
        ([(0, 0, 0, 0, 0, 0, 0)], HEADER, "1 rows of data, a recording needs 2 or more"),
        ([(0, 0, 0, 0), (1, 0, 0, 0)], "t_s,n_m,e_m,down_m", r":1: no column 'd_m' \(did you mean"),
        ([(0, 0, 0, 0, 0, 0, 0), (1, np.nan, 0, 0, 0, 0, 0)], HEADER, r":3: n_m is nan, not a finite number"),
        ([(k, 0, 0, 0, 0, 1e308, 0) for k in range(3)], HEADER, r":2: a velocity error of inf km/s; is"),
        ([(k, 0, 0, 0, 1e308, 1e308, 0) for k in range(3)], HEADER, r":2: a velocity error of inf km/s"),
        ([(k, 1e308, 1e308, 0, 0, 0, 0) for k in range(3)], HEADER, r":2: a position error of inf km"),
        ([(k, 4e6, 1e6, 0, 0, 0, 0) for k in range(3)], HEADER, r":2: a position error of 4123.11 km; do the columns"),
    ],
)  # fmt: skip
def test_every_mistake_has_its_place(tmp_path, rows, header, fault):
    with pytest.raises(InputError, match=fault):
        recording(card(write(tmp_path / "a.csv", rows, header)))


def test_a_missing_value_has_its_place(tmp_path):
    (tmp_path / "a.csv").write_text(HEADER + "\n0,1,2,3,4,5,6\n1,1,,3,4,5,6\n")
    with pytest.raises(InputError, match=r"a\.csv:3: e_m is '', not a number"):
        recording(card(str(tmp_path / "a.csv")))


def test_a_gap_that_the_card_allows_is_a_straight_line(tmp_path):
    file = write(tmp_path / "a.csv", [(k, k, 0, 0, 0, 0, 0) for k in (0, 1, 2, 8, 9)])
    assert sample_errors(card(file, largest_gap="6 s"), np.array([5.0]))[0, 0, 0] == pytest.approx(5.0)


def test_a_changed_file_is_read_again(tmp_path):
    file = write(tmp_path / "a.csv", [(k, 1, 0, 0, 0, 0, 0) for k in range(3)])
    assert recording(card(file)).errors[0, 0] == 1.0
    write(tmp_path / "a.csv", [(k, 2, 0, 0, 0, 0, 0) for k in range(3)])
    assert recording(card(file)).errors[0, 0] == 2.0


def test_an_error_in_earth_fixed_axes_is_the_difference_of_two_inertial_states():
    """Two states that differ by the error in frame e, each brought to frame i, differ by the error in frame i."""
    theta0, t = 0.7, np.array([100.0, 400.0])
    theta = earth_angle(theta0, t)
    r_e = np.array([[2.1e6, -4.2e6, -4.3e6], [3.0e6, -3.9e6, -4.6e6]])
    v_e = np.array([[900.0, 300.0, 1200.0], [5200.0, 900.0, 3000.0]])
    errors = np.array([[4.0, -3.0, 2.0, 0.1, 0.2, -0.3], [1e3, 2e3, -1e3, 0.0, 0.0, 0.0]])
    spin = np.array([0.0, 0.0, OMEGA])
    inertial = [
        np.hstack([eci_from_ecef(r, theta), eci_from_ecef(v + np.cross(spin, r), theta)])
        for r, v in ((r_e, v_e), (r_e + errors[:, :3], v_e + errors[:, 3:]))
    ]
    found = inertial_errors(errors, "ecef", eci_from_ecef(r_e, theta), theta)
    np.testing.assert_allclose(found, inertial[1] - inertial[0], atol=2e-9)
    r_i = eci_from_ecef(r_e, theta)
    turn = rotation_i_n(r_i, theta) @ np.swapaxes(rotation_i_e(theta), 1, 2)  # from frame e to n
    ned = np.concatenate([np.einsum("nij,nj->ni", turn, part) for part in (errors[:, :3], errors[:, 3:])], axis=1)
    np.testing.assert_allclose(inertial_errors(ned, "ned", r_i, theta), found, atol=1e-9)
    np.testing.assert_array_equal(inertial_errors(errors, "eci", r_i, theta), errors)
    assert np.allclose(ecef_from_eci(found[:, :3], theta), errors[:, :3])
