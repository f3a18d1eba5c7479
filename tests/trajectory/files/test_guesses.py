"""Columns of a user's file are known by their names, or by the size of their numbers; what is not found is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lvnav_trade.quantities.data_file import read_columns
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.first_rows import interpretations
from lvnav_trade.trajectory.files.guesses import guess

EXAMPLE = "configs/trajectories/example_table.csv"
NAMES = ["time_s", "latitude_deg", "longitude_deg", "height_m", "north_m_s", "east_m_s", "down_m_s"]


def written(folder: Path, titles: list[str], columns: np.ndarray, delimiter: str = ",") -> str:
    file = folder / "flight.csv"
    np.savetxt(file, columns, fmt="%.9g", delimiter=delimiter, header=delimiter.join(titles), comments="")
    return str(file)


@pytest.fixture(scope="module")
def rows() -> np.ndarray:
    return read_columns(EXAMPLE, NAMES, ",")[0]


def content(file: str) -> dict[str, object]:
    return {one.field: one.content for one in guess(file)}


def test_names_with_units_in_any_brackets_are_known(rows, tmp_path: Path) -> None:
    titles = ["t [s]", "Lat (deg)", "Lon (deg)", "Alt_km", "v_north [ft/s]", "v_east [ft/s]", "v_down [ft/s]"]
    found = content(written(tmp_path, titles, rows))
    assert found["time"] == {"column": "t [s]", "unit": "s"}
    assert found["position"] == {"frame": "geodetic", "columns": titles[1:4], "unit": "deg", "height_unit": "km"}
    assert found["velocity"] == {"frame": "ned", "columns": titles[4:], "unit": "ft/s"}


def test_without_units_the_size_of_the_numbers_counts(rows, tmp_path: Path) -> None:
    titles = ["time", "lat", "lon", "alt", "vn", "ve", "vd"]
    found = content(written(tmp_path, titles, rows * [1, 1, 1, 1e-3, 1e-3, 1e-3, 1e-3], ";"))
    assert found["delimiter"] == ";"
    assert found["position"] == {"frame": "geodetic", "columns": titles[1:4], "unit": "deg", "height_unit": "km"}
    assert found["velocity"] == {"frame": "ned", "columns": titles[4:], "unit": "km/s"}
    radians = content(written(tmp_path, titles, rows * [1, np.pi / 180, np.pi / 180, 1, 1, 1, 1]))
    assert radians["position"] == {"frame": "geodetic", "columns": titles[1:4], "unit": "rad", "height_unit": "m"}


@pytest.mark.parametrize(
    ("height", "unit"),
    [
        (lambda t: 900.0 * np.sin(t / 40.0), "m"),  # a hop: as km it would be at 20 km/s
        (lambda t: 1450.0 + np.maximum(t - 20.0, 0.0) * 2.0, "m"),  # a balloon from a pad that is no 1450 km high
        (lambda t: 0.01 * t**2, "km"),
        (lambda t: 400.0 - 0.5 * t, "km"),  # an entry
    ],
    ids=["hop", "high pad", "ascent", "entry"],
)
def test_heights_below_three_thousand_are_metres_where_no_vehicle_is_so_quick_in_km(
    height, unit: str, tmp_path: Path
) -> None:
    t = np.arange(0.0, 120.5, 0.5)
    columns = np.column_stack([t, 40.0 + 1e-4 * t, 100.0 + 0.0 * t, height(t)])
    assert content(written(tmp_path, ["t", "lat", "lon", "alt"], columns))["position"]["height_unit"] == unit


@pytest.mark.parametrize(("time", "per_second"), [("t [s]", 1.0), ("t [ms]", 1000.0), ("t [min]", 1.0 / 60.0)])
@pytest.mark.parametrize(("turning", "frame"), [(0.0, "ecef"), (7.292115e-5, "eci")])
def test_a_frame_that_no_name_says_is_that_in_which_the_first_rows_rest(
    turning: float, frame: str, time: str, per_second: float, tmp_path: Path
) -> None:
    t = np.arange(20.0)
    angle = 0.3 + turning * t
    columns = np.column_stack([per_second * t, 6378.0 * np.cos(angle), 6378.0 * np.sin(angle), 0.0 * t])
    assert content(written(tmp_path, [time, "x", "y", "z"], columns))["position"] == {
        "frame": frame, "columns": ["x", "y", "z"], "unit": "km",
    }  # fmt: skip
    named = content(written(tmp_path, [time, "x_j2000 [km]", "y_j2000 [km]", "z_j2000 [km]"], columns))
    assert named["position"]["frame"] == "j2000"


def test_angles_with_a_unit_in_their_titles_are_not_read(rows, tmp_path: Path) -> None:
    columns = np.column_stack([rows[:, :4], np.full((len(rows), 3), np.nan)])
    titles = ["t", "lat", "lon", "alt", "yaw_deg", "pitch_deg", "roll_deg"]
    assert content(written(tmp_path, titles, columns))["attitude"] == {
        "form": "euler", "frame": "ned", "columns": titles[4:], "unit": "deg",
    }  # fmt: skip


def test_columns_that_are_missing_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"flight.csv: no column of time \(one of t, time, .*\); it has a, b$"):
        guess(written(tmp_path, ["a", "b"], np.zeros((20, 2))))
    with pytest.raises(InputError, match=r"flight.csv: no columns of position .*; it has t, b$"):
        guess(written(tmp_path, ["t", "b"], np.zeros((20, 2))))


def test_a_quaternion_has_sixteen_readings_and_the_guessed_one_is_first() -> None:
    guessed = {
        "form": "quaternion",
        "frame": "eci",
        "columns": list("abcd"),
        "scalar": "last",
        "turns": "body_to_frame",
    }
    found = list(interpretations(guessed))
    assert found[0] == guessed
    assert len({tuple(map(str, one.values())) for one in found}) == 16
