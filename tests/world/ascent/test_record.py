"""A broken record is refused by file, line and fault."""

from __future__ import annotations

import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.world.ascent.record import read
from tests.world.flights import record_settings

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
        (with_line(6, "15,30"), r"flight\.csv:6: 2 fields, expected 3"),
        (with_line(6, "10,30,225"), r"flight\.csv:6: time_s 10 repeats 10 s of the row before"),
        (with_line(6, "7,30,225"), r"flight\.csv:6: time_s 7 goes back from 10 s"),
        (with_line(6, "15,-1,225"), r"flight\.csv:6: speed_m_s is -1, a speed is not negative"),
        (GOOD[:8] + GOOD[16:], r"flight\.csv: no data between 25 s and 70 s, where rows are 5 s apart"),
        (GOOD[:6], r"flight\.csv: 4 rows of data"),
        ([], r"flight\.csv: 0 rows of data"),
    ],
)
def test_a_broken_record_is_refused_with_file_line_and_fault(tmp_path, lines, fault):
    with pytest.raises(InputError, match=fault):
        read(written(tmp_path, lines))


def test_a_missing_record_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"absent\.csv: cannot be read: No such file"):
        read(str(tmp_path / "absent.csv"))


def test_a_record_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="is not a text file"):
        read(str(path))
