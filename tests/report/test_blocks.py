"""How numbers and tables are written."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.report import blocks
from lvnav_trade.report.blocks import Text, number, percent, same_once, table
from lvnav_trade.results.evaluation import METRICS

LABELS = {f"{k:02d}": f"case {k}" for k in range(10)}


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
    assert list(same_once(frame).itertuples(index=False, name=None)) == [
        ("a; b", "x", 1),
        ("a; b", "y", 2),
        ("c", "x", 3),
    ]
    assert list(same_once(frame[:4]).case) == ["all 2 cases", "all 2 cases"]
    assert same_once(frame[2:]).equals(frame[2:])


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


@pytest.fixture
def tables(monkeypatch):
    """Return ten cases, the last of which is the best; every second one has the same sky."""
    ranking = pd.DataFrame({"case": list(LABELS.values())[::-1]})
    monkeypatch.setitem(METRICS, "ranking", lambda tables: ranking)
    monkeypatch.setattr(blocks, "key_cases", lambda tables: {"case 0": "worst"})
    sky = pd.DataFrame({"case": list(LABELS), "cn0_db_hz": [40.0, 30.0] * 5})
    return SimpleNamespace(labels=LABELS, satellites=sky)


def test_of_many_cases_those_that_decide_and_the_best_are_shown_in_the_order_of_the_plan(tables):
    assert list(blocks.chosen_cases(tables)) == ["00", "03", "04", "05", "06", "07", "08", "09"]
    assert [block.text for block in blocks.left_out(tables)] == [
        "The decisive cases and the best ones are shown, 8 in all; 2 more are in the tables."
    ]


def test_cases_that_are_alike_are_one(tables):
    assert blocks.distinct(tables, "satellites", ["cn0_db_hz"], ["03", "02", "01"]) == ["03", "02"]


def test_more_cases_than_are_drawn_are_counted():
    assert blocks.few(list(LABELS)[:8]) == (list(LABELS)[:8], [])
    assert blocks.few(list(LABELS))[1] == [Text("2 more cases that differ here are in the tables.")]


@pytest.mark.parametrize(("nothing", "expected"), [("", []), ("No fault.", [Text("No fault.", is_nothing=True)])])
def test_a_metric_without_rows_is_a_text_or_nothing(tables, monkeypatch, nothing, expected):
    monkeypatch.setitem(METRICS, "outages", lambda tables: pd.DataFrame({"case": []}))
    assert blocks.of("outages", nothing)(lambda tables, frame: [Text("rows")])(tables) == expected


@pytest.mark.parametrize("layout", [name for name, entry in blocks.texts()["tables"].items() if "columns" in entry])
def test_headings_of_a_table_of_the_report_are_distinct(layout: str) -> None:
    columns = " ".join(blocks.texts()["tables"][layout]["columns"].split()).split(" | ")
    headings = [entry.rpartition(" = ")[0] or entry.partition(": ")[0] for entry in columns]
    assert len(set(headings)) == len(headings)
