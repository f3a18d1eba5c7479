"""How numbers and tables are written."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.report import blocks
from lvnav_trade.report.blocks import Text, all_cases, combine_equal_cases, number, percent, table
from lvnav_trade.results.evaluation import METRICS


@pytest.mark.parametrize(
    ("value", "reported"),
    [
        (0.0, "0"), (1234.5, "1230"), (0.012345, "0.0123"), (9.996, "10.0"), (1.0, "1.00"), (1e-7, "1.00e-07"),
        (float("nan"), "–"), (float("inf"), "∞"), (7, "7"), (-45.67, "-45.7"),
    ],
)  # fmt: skip
def test_numbers_have_three_significant_digits(value, reported):
    assert number(value) == reported


def test_percent_does_not_round_a_requirement_away():
    assert percent(0.9973) == "99.73 %"


def test_cases_with_the_same_rows_stand_once_in_a_table():
    frame = pd.DataFrame({"case": ["a", "a", "b", "b", "c"], "fault": ["x", "y", "x", "y", "x"], "n": [1, 2, 1, 2, 3]})
    assert list(combine_equal_cases(frame).itertuples(index=False, name=None)) == [
        ("a; b", "x", 1),
        ("a; b", "y", 2),
        ("c", "x", 3),
    ]
    assert list(combine_equal_cases(frame[:4]).case) == ["both cases", "both cases"]
    assert combine_equal_cases(frame[2:]).equals(frame[2:])


def test_columns_are_shown_as_their_entries_say():
    frame = pd.DataFrame(
        {
            "at_event": ["stage1_cutoff", "end"],
            "t_s": [1.25, np.nan],
            "low": [0.1, 1.0],
            "high": [0.25, 3.0],
            "n": [1, 2],
        }
    )
    found = table(
        frame, "Times.", "at_event: words | time (s) = t_s: .1f | after = t_s: time | 95 % = low to high: number | n"
    )
    assert found.head == ("at event", "time (s)", "after", "95 %", "n")
    assert found.rows == (
        ("stage1 cutoff", "1.2", "1", "0.100 to 0.250", "1"),
        ("end", "–", "never", "1.00 to 3.00", "2"),
    )
    assert found.numeric == (False, False, False, False, True)


@pytest.mark.parametrize(("nothing", "expected"), [("", []), ("No fault.", [Text("No fault.", is_nothing=True)])])
def test_a_metric_without_rows_is_a_text_or_nothing(monkeypatch, nothing, expected):
    monkeypatch.setitem(METRICS, "outages", lambda tables: pd.DataFrame({"case": []}))
    section = blocks.table_section("outages", nothing)(lambda tables, frame: [Text("rows")])
    assert section(SimpleNamespace()) == expected


@pytest.mark.parametrize("layout", [name for name, entry in blocks.texts()["tables"].items() if "columns" in entry])
def test_headings_of_a_table_of_the_report_are_distinct(layout: str) -> None:
    columns = " ".join(blocks.texts()["tables"][layout]["columns"].split()).split(" | ")
    headings = [entry.rpartition(" = ")[0] or entry.partition(": ")[0] for entry in columns]
    assert len(set(headings)) == len(headings)


def test_two_cases_together_are_both_cases():
    assert [all_cases(count) for count in (2, 3)] == ["both cases", "all 3 cases"]
