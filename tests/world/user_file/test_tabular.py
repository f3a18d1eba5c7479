"""Files of columns are read whole, and every ordinary mistake in them is named with its place."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.world.user_file.tabular import read_columns, refuse_bad_times, rounding

ROWS = "\n".join(f"{k},{k * k},0" for k in range(20))


def test_text_and_parquet_hold_the_same_numbers(tmp_path):
    (tmp_path / "a.csv").write_text(f"# made by hand\nt, x,other\n\n{ROWS}\n")
    pq.write_table(pa.table({"t": list(range(20)), "x": [k * k for k in range(20)]}), tmp_path / "a.parquet")
    text, places = read_columns(str(tmp_path / "a.csv"), ["x", "t"], ",")
    binary, rows = read_columns(str(tmp_path / "a.parquet"), ["x", "t"], ",")
    assert np.array_equal(text, binary)
    assert np.array_equal(text[:, 0], np.arange(20.0) ** 2)
    assert (places[0], rows[0]) == ("4", "row 1")


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        (f"t,xx\n{ROWS}", r":1: no column 'x' \(did you mean 'xx'\?\)"),
        (f"time,lat,lon\n{ROWS}", r":1: no column 't' \(.*"),
        (f"t,x,x\n{ROWS}", ":1: column 'x' stands 2 times"),
        (f"t,x,y\n{ROWS}\n20,400", ":22: 2 fields, the header has 3"),
        (f"t,x,y\n{ROWS}\n20,-,0", ":22: x is '-', not a number"),
        (f"t,x,y\n{ROWS}\n20,,0", ":22: x is '', not a number"),
        (f"t,x,y\n{ROWS}\n20,nan,0", ":22: x is nan, not a finite number"),
        ("t,x,y\n1,2,3\n2,3,4", "2 rows of data, a trajectory needs 12"),
        ("t,x,y\n", "0 rows of data"),
    ],
)
def test_a_mistake_in_a_text_file_is_named_with_its_line(tmp_path, content, fault):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=fault):
        read_columns(str(tmp_path / "a.csv"), ["t", "x"], ",")


def test_files_that_are_not_there_or_not_what_their_name_says_are_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "a.parquet").write_text("t,x\n1,2\n")
    for name, fault in (("none.csv", "No such file"), ("a.csv", "not a text file"), ("a.parquet", "read as Parquet"),
                        ("none.parquet", "cannot be read as Parquet")):  # fmt: skip
        with pytest.raises(InputError, match=fault):
            read_columns(str(tmp_path / name), ["t", "x"], ",")


def test_a_column_of_words_or_a_missing_one_in_a_parquet_file_is_refused(tmp_path):
    pq.write_table(pa.table({"t": list(range(20)), "x": ["a"] * 20}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "x"], ",")
    with pytest.raises(InputError, match="no column 'z'"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "z"], ",")
    pq.write_table(pa.table({"t": list(range(20)), "x": [None, *range(19)]}), tmp_path / "b.parquet")
    with pytest.raises(InputError, match=r"b.parquet:row 1: x is nan, not a finite number"):
        read_columns(str(tmp_path / "b.parquet"), ["t", "x"], ",")


@pytest.mark.parametrize(
    ("t", "fault"),
    [
        ([0.0, 1.0, 1.0, 2.0], ":7: time 1 s repeats 1 s of the row before"),
        ([0.0, 1.0, 0.5, 2.0], ":7: time 0.5 s goes back from 1 s"),
        ([0.0, 1.0, 2.0, 20.0, 21.0], ":8: no data between 2 s and 20 s, where rows beside are 1 s apart"),
    ],
)
def test_times_that_repeat_go_back_or_leave_a_gap_are_refused(t, fault):
    with pytest.raises(InputError, match=fault):
        refuse_bad_times(np.array(t), "a.csv", [str(k) for k in range(5, 5 + len(t))])


def test_a_change_of_rate_is_no_gap():
    refuse_bad_times(np.concatenate([np.arange(0.0, 5.0, 0.1), np.arange(5.0, 30.0)]), "a.csv", [""] * 100)


@pytest.mark.parametrize(
    ("column", "digit"),
    [
        ([0.1, 0.2, 0.25], 0.01),
        ([1000.0, 3000.0, 4000.0], 1000.0),
        ([6378137.123456789, 6378138.2, 6378139.3], 1e-9),
    ],
)
def test_rounding_is_seen_in_the_digits(column, digit):
    if digit > 1e-6:
        assert rounding(np.array(column)) == pytest.approx(digit / math.sqrt(12.0))
    else:
        assert rounding(np.array(column)) == 0.0  # all the digits that a double has


def test_columns_that_hardly_vary_or_carry_all_digits_are_not_rounded():
    assert rounding(np.array([90.0, 90.0, 90.0])) == 0.0
    assert rounding(np.array([90.0, 90.00000000000006, 90.00000000000003])) == 0.0
    assert rounding(np.array([0.0, 1e-17, -3e-16])) == 0.0
    assert rounding(np.sqrt(np.arange(2.0, 40.0))) == 0.0


def test_a_field_that_is_longer_than_any_number_is_refused_with_its_line(tmp_path):
    (tmp_path / "a.csv").write_text(f"t,x\n0,{'1' * 140_000}\n")
    with pytest.raises(InputError, match=r"a\.csv:2: a field of 140000 characters; at most 1000 are read$"):
        read_columns(str(tmp_path / "a.csv"), ["t", "x"], ",")


def test_a_quote_that_hides_the_delimiters_is_refused_with_its_line(tmp_path):
    (tmp_path / "a.csv").write_text('t,x\n0,"' + "1," * 100_000 + '"\n')
    with pytest.raises(InputError, match=r"a\.csv:2: ") as caught:
        read_columns(str(tmp_path / "a.csv"), ["t", "x"], ",")
    assert len(str(caught.value)) < 1_000


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_more_rows_than_are_read_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.setattr("lvnav_trade.world.user_file.tabular.DATA_ROWS", 19)
    (tmp_path / "a.csv").write_text(f"t,x,other\n{ROWS}\n")
    pq.write_table(pa.table({"t": list(range(20)), "x": list(range(20))}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"(more than|20 rows; at most) 19"):
        read_columns(str(tmp_path / name), ["t", "x"], ",")
