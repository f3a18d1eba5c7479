"""Cases with figures: those that decide and the best; one of those that are alike."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.report import selection
from lvnav_trade.report.blocks import Text
from lvnav_trade.results.evaluation import METRICS

LABELS = {f"{k:02d}": f"case {k}" for k in range(10)}


@pytest.fixture
def tables(monkeypatch):
    """Return ten cases, the last of which is the best; every second one has the same sky."""
    ranking = pd.DataFrame({"case": list(LABELS.values())[::-1]})
    monkeypatch.setitem(METRICS, "ranking", lambda tables: ranking)
    monkeypatch.setattr(selection, "key_cases", lambda tables: {"case 0": "worst"})
    sky = pd.DataFrame({"case": list(LABELS), "cn0_db_hz": [40.0, 30.0] * 5})
    return SimpleNamespace(labels=LABELS, satellites=sky)


def test_of_many_cases_those_that_decide_and_the_best_are_shown_in_the_order_of_the_plan(tables):
    assert list(selection.chosen_cases(tables)) == ["00", "03", "04", "05", "06", "07", "08", "09"]
    assert [block.text for block in selection.omission_note(tables)] == [
        "The decisive cases and the best ones are shown, 8 in all; 2 more are in the tables."
    ]


def test_cases_that_are_alike_are_one(tables):
    assert selection.distinct_cases(tables, "satellites", ["cn0_db_hz"], ["03", "02", "01"]) == ["03", "02"]


def test_more_cases_than_are_drawn_are_counted():
    assert selection.first_cases(list(LABELS)[:8]) == (list(LABELS)[:8], [])
    assert selection.first_cases(list(LABELS))[1] == [Text("2 more cases that differ here are in the tables.")]
