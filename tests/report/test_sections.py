"""What sections share: cases that are chosen, cases that are alike, metrics without rows."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.report import sections
from lvnav_trade.report.blocks import Text

LABELS = {f"{k:02d}": f"case {k}" for k in range(10)}


@pytest.fixture
def tables(monkeypatch):
    """Return ten cases, the last of which is the best; every second one has the same sky."""
    ranking = pd.DataFrame({"case": list(LABELS.values())[::-1]})
    monkeypatch.setitem(METRICS, "ranking", lambda tables: ranking)
    sky = pd.DataFrame({"case": list(LABELS), "cn0_db_hz": [40.0, 30.0] * 5})
    return SimpleNamespace(labels=LABELS, satellites=sky)


def test_of_many_cases_the_best_and_the_worst_are_shown_in_the_order_of_the_plan(tables):
    assert list(sections.chosen_cases(tables)) == ["00", "01", "04", "05", "06", "07", "08", "09"]
    assert [block.text for block in sections.left_out(tables)] == [
        "Shown are the 6 best cases and the 2 worst; 2 more are in the tables."
    ]


def test_cases_that_are_alike_are_one(tables):
    assert sections.distinct(tables, "satellites", ["cn0_db_hz"], ["03", "02", "01"]) == ["03", "02"]


def test_more_cases_than_are_drawn_are_counted():
    assert sections.few(list(LABELS)[:8]) == (list(LABELS)[:8], [])
    assert sections.few(list(LABELS))[1] == [Text("2 more cases that differ here are in the tables.")]


@pytest.mark.parametrize(("nothing", "expected"), [("", []), ("No fault.", [Text("No fault.")])])
def test_a_metric_without_rows_is_a_text_or_nothing(tables, monkeypatch, nothing, expected):
    monkeypatch.setitem(METRICS, "outages", lambda tables: pd.DataFrame({"case": []}))
    assert sections.of("outages", nothing)(lambda tables, frame: [Text("rows")])(tables) == expected
