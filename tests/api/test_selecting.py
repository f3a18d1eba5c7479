"""Conditions on designs: what they choose, and what they are not."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.api.selecting import column_named, select_rows, sort_rows
from lvnav_trade.quantities.errors import InputError

FRAME = pd.DataFrame(
    {
        "case": ["a", "b", "c", "d"],
        "axis_imu": ["fog", "fog", "mems#2", "none"],
        "axis_gyro_bias_rad_per_s": [1e-7, 2e-7, 3e-7, 4e-7],
        "velocity_m_per_s": [0.05, 0.2, 0.1, float("nan")],
        "attitude_rad": [1e-3, 2e-3, 3e-3, 4e-3],
        "cost": [4.0, 3.0, 2.0, 1.0],
    }
)


@pytest.mark.parametrize(
    ("condition", "cases"),
    [
        ("velocity < 0.15", "ac"),
        ("velocity < 15 cm/s", "ac"),
        ("velocity_m_per_s >= 0.1 m/s and cost < 3", "c"),
        ("imu == fog", "ab"),
        ("imu == mems#2 or attitude > 0.2 deg", "cd"),
        ("axis_imu != 'fog' and not (cost < 1.5)", "c"),
        ("gyro_bias <= 0.05 deg/h", "ab"),
        ("0.5 * cost + 1 > 2.6 and (attitude < 0.1 deg)", "a"),
        ("imu in ('fog', 'none')", "abd"),
        ("cost > -1e0", "abcd"),
    ],
)
def test_a_condition_chooses_rows_in_the_units_that_it_is_written_in(condition: str, cases: str) -> None:
    assert "".join(select_rows(FRAME, [condition]).case) == cases


def test_several_conditions_all_hold() -> None:
    assert list(select_rows(FRAME, ["cost > 1", "imu == fog", "velocity > 0.1"]).case) == ["b"]


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("velocty < 1", "no column 'velocty' (did you mean 'velocity'?)"),
        ("velocity < 1 deg", "velocity_m_per_s: '1 deg' has the wrong unit"),
        ("cost < 1 kg", "'1 kg': cost has no unit"),
        ("velocity", "compares nothing"),
        ("velocity <", "is no condition"),
        ("velocity < 1 ; cost", "has no meaning in a condition"),
        ("velocity.real < 1", "has no meaning in a condition"),
        ("abs(velocity) < 1", "no meaning in a condition"),
        ("@pd < 1", "has no meaning in a condition"),
        ("cost < " + "1" * 2000, "at most 1000"),
    ],
)
def test_what_is_no_condition_is_refused_in_one_line(condition: str, message: str) -> None:
    with pytest.raises(InputError) as raised:
        select_rows(FRAME, [condition])
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_rows_are_sorted_by_columns_in_turn_and_largest_first_where_wanted() -> None:
    assert "".join(sort_rows(FRAME, ["cost"]).case) == "dcba"
    assert "".join(sort_rows(FRAME, ["-imu", "-cost"]).case) == "dcab"
    assert "".join(sort_rows(FRAME, ["velocity"]).case) == "acbd"  # a value that is not known comes last


def test_a_name_that_several_columns_have_names_them() -> None:
    frame = FRAME.assign(axis_velocity_m_per_s=1.0)
    assert column_named("velocity_m_per_s", frame) == "velocity_m_per_s"
    with pytest.raises(InputError, match="fits several columns: velocity_m_per_s, axis_velocity_m_per_s"):
        column_named("velocity", frame)
