"""A row holds in its band, among our flights; what repeats an input is no evidence."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluation.published import (
    is_at_edge,
    is_evidence,
    is_reproduced,
    is_unpublished,
    marks,
    most_important,
)

ROWS = pd.DataFrame(
    {
        "item": ["a", "b", "b", "c", "d", "e"],
        "in_band": [True, True, False, False, False, False],
        "percentile": [50.0, 99.5, 10.0, np.nan, np.nan, np.nan],
        "ratio": [1.0, 1.5, 2.5, 20.0, np.nan, np.nan],
        "ours": [1.0, 1.5, 2.5, 20.0, 1.2, np.nan],
        "band_low": [0.5, 0.5, 0.5, 0.5, 0.0, 0.5],
        "band_high": [2.0, 2.0, 2.0, 2.0, 1.0, 2.0],
        "verdict": ["holds", "holds", "does not hold here", "undecided", "holds", "does not hold here"],
        "counts_as": ["number", "number", "order", "statement", "repeats", "number"],
    }
)


def test_what_holds_is_decided_by_the_verdict_and_a_flight_at_an_edge_is_told_apart() -> None:
    assert list(is_at_edge(ROWS)) == [False, True, False, False, False, False]
    assert list(is_reproduced(ROWS)) == [True, True, False, False, True, False]


@pytest.mark.parametrize("percentile", [0.0, 1.0, 99.0, 100.0])
def test_an_edge_is_the_point_itself_and_what_is_beyond(percentile: float) -> None:
    assert is_at_edge(ROWS.assign(percentile=percentile)).all()


def test_a_number_that_an_input_decides_is_no_evidence() -> None:
    assert list(is_evidence(ROWS)) == [True, True, True, True, False, True]


@pytest.mark.parametrize("mark", ["own", "again", "verification"])
def test_a_row_with_a_mark_is_no_evidence(mark: str) -> None:
    rows = ROWS.assign(counts_as=["number", "order", mark, "statement", "repeats", "number"])
    assert list(is_evidence(rows)) == [True, True, False, True, False, True]
    assert list(is_unpublished(rows)) == [False, False, mark == "own", False, False, False]


def test_the_first_mark_of_a_row_is_what_it_counts_as() -> None:
    assert marks({}, "order")["counts_as"] == "order"
    both = marks({"own": "the bound", "repeats": "the latency"}, "number")
    assert both == {
        "repeats": "the latency",
        "verification": "",
        "own": "the bound",
        "again": "",
        "counts_as": "repeats",
    }


def test_what_a_study_calls_important_comes_first_then_the_furthest_from_its_band_once_an_item() -> None:
    failing = ROWS[1:]
    assert list(most_important(failing, ("d", "nothing"))["item"]) == ["d", "e", "c"]  # e: no number at all
    found = most_important(failing, (), 9)
    assert list(found["item"]) == ["e", "c", "b", "d"]
    assert found.ratio[found["item"] == "b"].item() == 2.5  # of two rows of an item the further one
    assert list(found.columns) == list(ROWS.columns)


def test_each_beginning_of_an_item_names_one_row_the_furthest_that_begins_so() -> None:
    failing = ROWS[1:].assign(item=["table, x", "table, x", "table, y", "order", "table, z"])
    assert list(most_important(failing, ("table", "order"))["item"]) == ["table, z", "order", "table, y"]


def test_a_number_below_its_band_is_as_far_as_one_above_it() -> None:
    two = ROWS.iloc[[3, 3]].assign(item=["low", "high"], ratio=[0.5 / 8.0, 2.0 * 7.9])
    assert list(most_important(two, ())["item"]) == ["low", "high"]
