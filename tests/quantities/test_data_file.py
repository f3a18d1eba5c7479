"""Columns of a user's file, CSV or Parquet: what exporters write is read, or named for what it is."""

from __future__ import annotations

import os
import random
import resource
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lvnav_trade.quantities.data_file import column_names, read_columns, read_texts
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_limits import DATA_BYTES
from tests.fuzzing.mutants import flipped, outcome_of

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
        (f"t,x,x\n{ROWS}", ":1: 2 columns have the name 'x'"),
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
                        ("none.parquet", "No such file")):  # fmt: skip
        with pytest.raises(InputError, match=fault):
            read_columns(str(tmp_path / name), ["t", "x"], ",")


def test_a_column_of_words_or_a_missing_one_in_a_parquet_file_is_refused(tmp_path):
    pq.write_table(pa.table({"t": list(range(20)), "x": ["a"] * 20}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match="column 'x' is of texts, not of numbers"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "x"], ",")
    with pytest.raises(InputError, match="no column 'z'"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "z"], ",")
    pq.write_table(pa.table({"t": list(range(20)), "x": [None, *range(19)]}), tmp_path / "b.parquet")
    with pytest.raises(InputError, match=r"b.parquet:row 1: x is nan, not a finite number"):
        read_columns(str(tmp_path / "b.parquet"), ["t", "x"], ",")


@pytest.mark.parametrize(
    "comments",
    [
        "# t, x, other\n",
        "# Flight 7, by hand\n#t,x,other\n",
        "# t,x,other\n# Event LIFTOFF at t=0.0 seconds\n# 1,2,3\n",
    ],
    ids=["numpy.savetxt", "a title before it", "OpenRocket"],
)
def test_a_header_that_is_a_comment_is_the_header(tmp_path: Path, comments: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(f"{comments}{ROWS}\n")
    assert column_names(str(file)) == ["t", "x", "other"]
    table, places = read_columns(str(file), ["x", "t"], ",")
    assert np.array_equal(table, [[float(k * k), float(k)] for k in range(20)])
    assert places[0] == str(comments.count("\n") + 1)


def test_numbers_without_a_header_are_named_as_such(tmp_path: Path) -> None:
    for comments in ("", "# by hand\n", "# 1, 2, 3\n"):
        (tmp_path / "a.csv").write_text(f"{comments}{ROWS}\n")
        with pytest.raises(InputError, match=r"a\.csv:\d: has numbers where the names of the columns should be"):
            read_columns(str(tmp_path / "a.csv"), ["t", "x"], ",")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"])
def test_text_is_read_in_the_encodings_that_spreadsheets_write(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-le" else ""
    (tmp_path / "a.csv").write_bytes(f"{mark}t,Latitude (°)\r\n0,1\r\n1,4\r\n".encode(encoding))
    table, _ = read_columns(str(tmp_path / "a.csv"), ["t", "Latitude (°)"], ",", 2)
    assert np.array_equal(table, [[0.0, 1.0], [1.0, 4.0]])


def test_text_without_the_mark_of_its_byte_order_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("t,x\n0,1\n".encode("utf-16-le"))
    with pytest.raises(InputError, match="is not a text file \\(UTF-16 without a mark of its byte order"):
        column_names(str(tmp_path / "a.csv"))


@pytest.mark.parametrize("field", ["1_000", "\u0661\u0662", "1_0.5"])
def test_numbers_are_decimal_ascii(tmp_path: Path, field: str) -> None:
    (tmp_path / "a.csv").write_text(f"t,x\n0,1\n1,{field}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.csv:3: x is '.*', not a number"):
        read_columns(str(tmp_path / "a.csv"), ["t", "x"], ",", 2)


def test_nanoseconds_as_whole_numbers_are_those_of_a_text_file(tmp_path: Path) -> None:
    t = 1_710_936_140_000_000_000 + 100_000_001 * np.arange(20)
    rows = pd.DataFrame({"t": t, "x": np.arange(20.0)})
    rows.to_parquet(tmp_path / "a.parquet")
    rows.to_csv(tmp_path / "a.csv", index=False)
    found = [read_columns(str(tmp_path / name), ["t", "x"], ",")[0] for name in ("a.parquet", "a.csv")]
    assert np.array_equal(*found)
    assert np.max(np.abs(found[0][:, 0] - t)) <= 128.0


@pytest.mark.parametrize(
    ("column", "fault"),
    [
        (pd.date_range("2024-01-01", periods=20, freq="1s"), r"of timestamp\[.s\], not of numbers: write seconds, .*"),
        (pd.to_timedelta(np.arange(20), unit="s"), r"of duration\[.s\], not of numbers: write seconds, in pandas such"),
        ([True, False] * 10, "of truth values, not of numbers$"),
        (["1.0"] * 20, "of texts, not of numbers$"),
        ([[1.0, 2.0]] * 20, "of list<.*>, not of numbers$"),
    ],
    ids=["time stamps", "durations", "truth values", "texts", "lists"],
)
def test_a_parquet_column_of_anything_but_numbers_is_named_for_what_it_is(tmp_path: Path, column, fault: str) -> None:
    pd.DataFrame({"t": column, "x": np.arange(20.0)}).to_parquet(tmp_path / "a.parquet")
    with pytest.raises(InputError, match=rf"a\.parquet: column 't' is {fault}"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "x"], ",")


def test_a_long_text_that_repeats_is_refused_without_unpacking_it_for_every_row(tmp_path: Path) -> None:
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(400_000, dtype=np.int32)), ["G" * 100_000])
    pq.write_table(pa.table({"satellite": text, "x": np.arange(400_000.0)}), tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").stat().st_size < 2**22
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"satellite: a text of 100000 characters; at most 1000 are read$"):
        read_texts(str(tmp_path / "a.parquet"), "satellite")
    with pytest.raises(InputError, match=r"column 'satellite' is of texts, not of numbers$"):
        read_columns(str(tmp_path / "a.parquet"), ["satellite"], ",")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**18  # KB; unpacked it would be 40 GB


def test_texts_of_a_parquet_file_come_row_by_row(tmp_path: Path) -> None:
    pd.DataFrame({"satellite": ["G01", "E05", "G01", None], "x": np.arange(4.0)}).to_parquet(tmp_path / "a.parquet")
    assert read_texts(str(tmp_path / "a.parquet"), "satellite") == ["G01", "E05", "G01", ""]
    with pytest.raises(InputError, match="column 'x' is of double, not of texts"):
        read_texts(str(tmp_path / "a.parquet"), "x")


def test_damaged_texts_of_a_parquet_file_are_refused_or_read(tmp_path: Path) -> None:
    # damage of the statistics would end the whole process where they are asked for before a row is read
    rows = {"t_s": [float(k) for k in range(40)], "satellite": [f"G{k % 12:02d}" for k in range(40)]}
    whole = tmp_path / "whole.parquet"
    pq.write_table(pa.table(rows), whole)
    file, found = tmp_path / "damaged.parquet", {True: 0, False: 0}
    for seed in range(900, 1450):
        file.write_bytes(flipped(whole.read_bytes(), random.Random(f"t {seed}"))[0])
        found[outcome_of(lambda: read_texts(str(file), "satellite"), "").read] += 1
    assert min(found.values()) > 50


def test_columns_that_are_too_large_unpacked_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pq.write_table(
        pa.table({"t": np.zeros(200_000), "x": np.zeros(200_000)}), tmp_path / "a.parquet", use_dictionary=False
    )
    assert (tmp_path / "a.parquet").stat().st_size < 200_000
    monkeypatch.setattr("lvnav_trade.quantities.data_file.DATA_BYTES", 2_000_000)
    with pytest.raises(InputError, match=r"t, x: unpacked \d{7} bytes; at most 2000000 are read$"):
        read_columns(str(tmp_path / "a.parquet"), ["t", "x"], ",")
    assert len(read_columns(str(tmp_path / "a.parquet"), ["t"], ",")[0]) == 200_000
    assert DATA_BYTES > 2_000_000


@pytest.mark.parametrize("name", ["pipe.parquet", "pipe.pq", "pipe.csv"])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    for read in (column_names, lambda file: read_columns(file, ["t"], ","), lambda file: read_texts(file, "t")):
        with pytest.raises(InputError, match=r"is not a regular file$"):
            read(str(tmp_path / name))


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
    monkeypatch.setattr("lvnav_trade.quantities.data_file.DATA_ROWS", 19)
    (tmp_path / "a.csv").write_text(f"t,x,other\n{ROWS}\n")
    pq.write_table(pa.table({"t": list(range(20)), "x": list(range(20))}), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"(more than|20 rows; at most) 19"):
        read_columns(str(tmp_path / name), ["t", "x"], ",")
