"""Ranges of a log: names of satellites however they are written, one signal of each, no zeros for numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.navigation_log import Ranges, RangesFile, read_ranges, satellite_name


def frame() -> pd.DataFrame:
    return pd.DataFrame({
        "t_s": np.repeat([10.0, 11.0, 12.0], 4), "satellite": ["G01", "G02", "E05", "R12"] * 3,
        "pseudorange_m": 2.1e7 + np.arange(12.0), "range_rate_m_s": -300.0 + np.arange(12.0),
    })  # fmt: skip


def found(table: pd.DataFrame, folder) -> Ranges:
    table.to_csv(folder / "ranges.csv", index=False)
    return read_ranges(RangesFile(file="ranges.csv"), folder, 10.0)


@pytest.mark.parametrize("text", ["G01", "G 1", "G1", "g01", " G01 ", "G 01", "G001"])
def test_a_satellite_has_one_name_however_it_is_written(text):
    assert satellite_name(text) == "G01"


def test_other_names_are_kept():
    assert [satellite_name(text) for text in ("QZS-1", "J", "12", "A1")] == ["QZS-1", "J", "12", "A01"]


def test_rows_are_times_names_and_values(tmp_path):
    log = found(frame().replace({"satellite": {"G01": "G 1"}}), tmp_path)
    assert log.t[[0, -1]].tolist() == [0.0, 2.0]
    assert log.satellites[:2] == ("G01", "G02")
    assert log.notes == ()


@pytest.mark.parametrize(("first", "line"), [(True, 6), (False, 14)])
def test_a_second_signal_of_a_satellite_is_refused_in_any_order_and_any_spelling(tmp_path, first, line):
    other = frame().iloc[:4].replace({"satellite": {"G01": "G 1"}})
    both = pd.concat([other, frame()] if first else [frame(), other])
    with pytest.raises(InputError, match=rf"ranges.csv:{line}: 'G01' at 10 s again, as in 2: keep the rows of one"):
        found(both, tmp_path)


@pytest.mark.parametrize(
    ("column", "value"),
    [("pseudorange_m", 0.0), ("pseudorange_m", -1.0), ("pseudorange_m", np.nan), ("range_rate_m_s", 0.0),
     ("range_rate_m_s", np.nan)],
)  # fmt: skip
def test_a_number_that_is_missing_is_left_out_and_counted_and_a_column_of_them_refused(tmp_path, column, value):
    table = frame()
    table.loc[5, column] = value
    log = found(table, tmp_path)
    assert np.flatnonzero(np.isnan(log.values).any(axis=1)).tolist() == [5]
    (note,) = log.notes
    assert note.startswith(f"{column} is empty")
    assert note.endswith("in 1 of 12 rows: left out (ranges.csv:7)")
    with pytest.raises(InputError, match=rf"ranges.csv:2: {column} is empty.*, in all 12 rows"):
        found(table.assign(**{column: value}), tmp_path)


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("pseudorange_m", 21034.5, "pseudorange_m is 21034.5; is it in m"),
        ("pseudorange_m", 2.1e10, "is it in m"),
        ("range_rate_m_s", 4e5, "is it in m/s"),
        ("satellite", " ", "satellite is empty"),
    ],
)
def test_what_no_receiver_measures_is_refused_at_its_line(tmp_path, column, value, said):
    table = frame()
    table.loc[5, column] = value
    with pytest.raises(InputError, match=rf"ranges.csv:7: .*{said}"):
        found(table, tmp_path)
