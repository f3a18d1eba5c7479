"""What a reader of a study sees first."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.metrics.published import COLUMNS
from lvnav_trade.metrics.verdicts import FAILS, HOLDS
from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.headline import headline, those_that_fail


def _row(item: str, ratio: float, percentile: float = np.nan, published: float = 1.0, **cells: object) -> dict:
    row = dict.fromkeys(COLUMNS, "") | {"formal": np.nan, "true": np.nan, "monte_carlo": ratio, "low": 1.0, "high": 1.0}
    bounds = {"band_low": 0.5, "band_high": 2.0, "in_band": 0.5 <= ratio <= 2.0}
    return row | bounds | {"item": item, "ratio": ratio, "ours": ratio, "percentile": percentile} | {
        "published": published, "case": "x: y", "remark": f"why {item}", **cells,
    }  # fmt: skip


ROWS = pd.DataFrame(
    [
        _row("in", 1.0, 40.0), _row("edge", 1.1, 99.5), _row("out", 9.0), _row("far", 90.0), _row("main", 2.5),
        _row("input", 1.0, repeats="the noise"), _row("order", 0.9, published=np.nan),
    ],
    columns=COLUMNS,
)  # fmt: skip


def test_the_first_lines_count_evidence_edges_and_inputs() -> None:
    text, important = headline(ROWS, ("main",))
    assert isinstance(text, Text)
    assert isinstance(important, Table)
    assert text.text == (
        "Of 6 published results that are not fixed by our inputs, 2 are reproduced: 1 of 5 numbers are within their "
        "band (single runs: among ours); 1 of 1 orders and statements on innovations are as published. Results within "
        "their band whose published run is at or beyond the 1 % or 99 % quantile of ours: 1. Results that repeat an "
        "input and are not counted: 1."
    )
    assert [row[0] for row in important.rows] == ["main", "far", "out"]
    assert [row[-1] for row in important.rows] == ["why main", "why far", "why out"]


def test_a_statement_that_does_not_hold_may_be_the_most_important() -> None:
    said = pd.DataFrame(
        [_row("said", 0.1, published=np.nan, verdict=FAILS), _row("so", 1.0, verdict=HOLDS)], columns=COLUMNS
    )
    text, important = headline(ROWS, ("said", "main"), said)
    assert isinstance(text, Text)
    assert isinstance(important, Table)
    assert text.text.startswith("Of 6 published results")  # statements are counted in a line of their own
    assert [row[0] for row in important.rows] == ["said", "main", "far"]


def test_numbers_that_settings_were_searched_for_by_are_counted_apart() -> None:
    rows = pd.DataFrame([_row("a", 1.0, fitted=True), _row("b", 9.0, fitted=True), _row("c", 1.0)], columns=COLUMNS)
    text = headline(rows, ())[0]
    assert isinstance(text, Text)
    assert (
        "fitted to 2 of the numbers; 1 of these are reproduced, and 1 of the 1 numbers withheld from the fit."
        in text.text
    )


def test_rows_that_are_not_published_are_counted_apart_and_have_a_table() -> None:
    mine = [_row("bound of ours", 1.0, own="the bound"), _row("limit of ours", 9.0, own="the limit")]
    rows = pd.concat([ROWS, pd.DataFrame(mine, columns=COLUMNS)], ignore_index=True)
    text = headline(rows, ("limit of ours",))[0]
    assert isinstance(text, Text)
    assert text.text.startswith("Of 6 published results that are not fixed by our inputs, 2 are reproduced")
    assert "Results that repeat an input and are not counted: 1." in text.text
    assert text.text.endswith("which are not counted: 2; 1 of them hold.")
    assert [row[0] for row in headline(rows, ("limit of ours",))[1].rows] == ["far", "out", "main"]
    tables = those_that_fail(rows)
    assert [[row[0] for row in one.rows] for one in tables[1:]] == [["input"], ["bound of ours", "limit of ours"]]
    assert "the limit" in tables[2].rows[1]


def test_every_row_that_fails_and_every_input_stands_in_a_table_of_its_own() -> None:
    failing, repeated = those_that_fail(ROWS)
    assert isinstance(failing, Table)
    assert isinstance(repeated, Table)
    assert [row[0] for row in failing.rows] == ["edge", "out", "far", "main"]
    assert [row[0] for row in repeated.rows] == ["input"]
    assert "the noise" in repeated.rows[0]


def test_nothing_is_said_without_rows_and_no_table_where_all_hold() -> None:
    assert headline(ROWS[:0], ()) == []
    assert len(headline(ROWS[:1], ())) == 1
    assert those_that_fail(ROWS[:1]) == []


def test_what_an_item_says_is_not_said_again_by_its_case_and_expression() -> None:
    rows = [
        _row("one", 9.0, case="campaign: axis=a long level; 10 of b together", metric="position error at injection"),
        _row("two", 8.0, case="campaign: axis=1"), _row("two", 1.0, case="campaign: axis=2"),
    ]  # fmt: skip
    said = [_row("said", 0.1, published=np.nan, verdict=FAILS, case="c: x", metric="a / min(b, c): a error; b error")]
    found = headline(pd.DataFrame(rows, columns=COLUMNS), (), pd.DataFrame(said, columns=COLUMNS))[1]
    assert isinstance(found, Table)
    shown = {row[0]: list(row[1:3]) for row in found.rows}
    assert shown["one"] == ["campaign", "position error at injection"]
    assert shown["two"][0] == "campaign: axis=1"
    assert shown["said"][0] == "c"
    assert "min" not in shown["said"][1]
