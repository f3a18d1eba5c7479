"""Rows are found without a search, and are those of a search; what was found once is kept."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.tables.read import PLACES, cache_result, pick, pick_columns

FRAME = pd.DataFrame(
    {
        "case": np.repeat(["a", "b", "c"], 8),
        "axis": [*"xyzxyzxx"] * 3,
        "value": np.arange(24.0),
    }
)


@pytest.fixture
def known():
    """Let the frame be one of the tables."""
    PLACES[id(FRAME)] = {}
    yield PLACES[id(FRAME)]
    del PLACES[id(FRAME)]


@pytest.mark.parametrize("wanted", [{"case": "b"}, {"axis": "x"}, {"case": "c", "axis": "y"}, {"case": "no"}])
def test_rows_of_a_table_are_those_of_a_search_in_their_order(known, wanted):
    searched = FRAME
    for column, value in wanted.items():
        searched = searched[searched[column] == value]
    for _ in range(2):
        pd.testing.assert_frame_equal(pick(FRAME, **wanted), searched)
    assert list(known) == [tuple(wanted)]


@pytest.mark.parametrize("wanted", [{"case": "b"}, {"axis": "x"}, {"case": "c", "axis": "y"}, {"case": "no"}])
def test_columns_of_rows_are_those_of_the_frame_of_them(known, wanted):
    rows = pick(FRAME, **wanted)
    axis, value = pick_columns(FRAME, ("axis", "value"), **wanted)
    assert list(axis) == list(rows.axis)
    np.testing.assert_array_equal(value, rows.value.to_numpy())


def test_a_frame_that_is_no_table_is_searched():
    assert list(pick(FRAME.copy(), case="a", axis="z").value) == [2.0, 5.0]
    assert list(pick_columns(FRAME.copy(), ("value",), case="a", axis="z")[0]) == [2.0, 5.0]
    assert not PLACES.get(id(FRAME))


def test_what_was_found_once_is_kept_by_words_and_handed_out_as_a_copy():
    tables, calls = SimpleNamespace(cache={}), []

    @cache_result
    def metric(tables, word):
        calls.append(word)
        return [word]

    first = metric(tables, "one")
    first.append("changed")
    assert metric(tables, "one") == ["one"]
    assert metric(tables, "two") == ["two"]
    assert calls == ["one", "two"]
