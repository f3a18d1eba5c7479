"""What a reader of a study sees first."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.headline import failed_table, headline, uncounted_tables, verdict_counts
from lvnav_trade.results.evaluation.published import COLUMNS, marks
from lvnav_trade.results.evaluation.verdicts import FAILS, HOLDS, UNDECIDED


def _row(item: str, ratio: float, percentile: float = np.nan, published: float = 1.0, **cells: object) -> dict:
    row = dict.fromkeys(COLUMNS, "") | {"formal": np.nan, "true": np.nan, "monte_carlo": ratio, "low": 1.0, "high": 1.0}
    bounds = {"band_low": 0.5, "band_high": 2.0, "in_band": 0.5 <= ratio <= 2.0}
    said = marks(cells, "number" if np.isfinite(published) else "order")
    return row | bounds | {"item": item, "ratio": ratio, "ours": ratio, "percentile": percentile} | said | {
        "published": published, "case": "x: y", "remark": f"why {item}",
        "verdict": HOLDS if bounds["in_band"] else FAILS, **cells,
    }  # fmt: skip


ROWS = pd.DataFrame(
    [
        _row("in", 1.0, 40.0), _row("edge", 1.1, 99.5), _row("out", 9.0), _row("far", 90.0), _row("main", 2.5),
        _row("input", 1.0, repeats="the noise"), _row("order", 0.9, published=np.nan),
    ],
    columns=COLUMNS,
)  # fmt: skip


def below(rows):
    """Return the tables below the counts: what is not reproduced, and what is not counted."""
    return [*failed_table(rows), *uncounted_tables(rows)]


def test_the_first_lines_count_evidence_edges_and_inputs() -> None:
    text, important = headline(ROWS, ("main",))
    assert isinstance(text, Text)
    assert isinstance(important, Table)
    assert text.text == (
        "Of 6 published results that count, 3 are reproduced: 2 of 5 numbers are reproduced, 3 are not; 1 of 1 orders "
        "and statements on innovations are reproduced, 0 are not. Separately, of 2 numbers within their band that are "
        "of one published run, 1 lie between the 1 % and 99 % quantiles of our runs. Not counted: 1 result fixed by "
        "our inputs (1 holds)."
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
    assert text.text.startswith("Of 6 published results that count, 3 are reproduced")
    assert text.text.endswith(
        "Not counted: 1 result fixed by our inputs (1 holds); 2 results whose statement or bound is ours (1 holds)."
    )
    assert [row[0] for row in headline(rows, ("limit of ours",))[1].rows] == ["far", "out", "main"]
    tables = below(rows)
    assert [[row[0] for row in one.rows] for one in tables[1:]] == [["input"], ["bound of ours", "limit of ours"]]
    assert "the limit" in tables[2].rows[1]


def test_every_row_that_fails_and_every_input_stands_in_a_table_of_its_own() -> None:
    failing, repeated = below(ROWS)
    assert isinstance(failing, Table)
    assert isinstance(repeated, Table)
    assert [row[0] for row in failing.rows] == ["out", "far", "main"]
    assert [row[0] for row in repeated.rows] == ["input"]
    assert "the noise" in repeated.rows[0]


def test_rows_that_runs_do_not_decide_are_counted_as_such() -> None:
    rows = pd.DataFrame([_row("a", 1.0), _row("b", 0.5, verdict=UNDECIDED)], columns=COLUMNS)
    assert verdict_counts(rows) == {"number": (2, 1, 0, 1)}
    text = headline(rows, ())[0]
    assert isinstance(text, Text)
    assert text.text.startswith(
        "Of 2 published results that count, 1 are reproduced: 1 of 2 numbers are reproduced, 0 are not, 1"
    )


def test_second_readings_and_verifications_have_tables_of_their_own() -> None:
    rows = pd.DataFrame([_row("a", 9.0, again="table 2"), _row("b", 1.0, verification="one motion")], columns=COLUMNS)
    tables = below(rows)
    assert [[row[0] for row in one.rows] for one in tables] == [["a"], ["b"]]
    assert ["table 2" in tables[0].rows[0], "one motion" in tables[1].rows[0]] == [True, True]
    text = headline(rows, ())[0]
    assert isinstance(text, Text)
    assert text.text.startswith(
        "Not counted: 1 second comparison with a published result (0 hold); 1 result that cannot fail"
    )


def test_nothing_is_said_without_rows_and_no_table_where_all_hold() -> None:
    assert headline(ROWS[:0], ()) == []
    assert len(headline(ROWS[:1], ())) == 1
    assert below(ROWS[:1]) == []


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
