"""Published tables in their own layout, and short names of cases."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.reading.study_card import StudyCard
from lvnav_trade.report.printed import printed_tables, short_cases
from lvnav_trade.results.evaluation.published import COLUMNS, marks

LAYOUT = {
    "title": "Table 4",
    "head": "RMS error",
    "columns": ["estimated", "not estimated"],
    "rows": {
        "position": [
            {"item": "position", "case": {"filter": "yes, all"}},
            {"item": "position", "case": {"filter": "no"}},
        ],
        "white": ["innovations", None],
    },
}
STUDY: dict[str, Any] = {"title": "A paper", "description": "x", "printed": [LAYOUT], "campaigns": []}


def row(item: str, case: str, **cells: object) -> dict[str, Any]:
    return {"item": item, "case": case, **marks(cells, "number"), "verdict": "holds", "unit": "m", **cells}


ROWS = pd.DataFrame(
    [
        row("position", "tight: filter=yes, all, realisation=base; 4 levels of realisation together", published=2317.0,
            ours=2300.0, ratio=0.9927),
        row("position", "tight: filter=no", published=64.0, ours=20.0, ratio=0.3125, verdict="does not hold here"),
        row("innovations", "tight: filter=no", ours=0.5, remark="jumps; published: white; at lag 1",
            verdict="does not hold here"),
    ],
    columns=COLUMNS,
)  # fmt: skip


def test_each_cell_has_what_is_printed_ours_and_the_ratio() -> None:
    (table,) = printed_tables(StudyCard.model_validate(STUDY), ROWS)
    assert table.head == ("RMS error", "estimated (m)", "ours", "ratio", "not estimated (m)", "ours", "ratio")
    assert table.rows[0] == ("position", "2317", "2300", "0.993", "64", "20.0", "0.312 out")
    assert table.rows[1] == ("white", "yes", "0.500", "out", "", "", "")


def test_a_campaign_without_results_leaves_its_cells_empty() -> None:
    (table,) = printed_tables(StudyCard.model_validate(STUDY), ROWS[:0])
    assert table.rows[0] == ("position", *[""] * 6)


def test_cells_and_columns_are_as_many() -> None:
    wrong = LAYOUT | {"rows": {"position": ["position"]}}
    with pytest.raises(ValidationError, match=r"rows\.position: 1 cells for 2 columns"):
        StudyCard.model_validate(STUDY | {"printed": [wrong]})


@pytest.mark.parametrize(
    ("case", "short"),
    [
        ("hil: receiver=base, filter=base; 4 levels of realisation together", "hil: base"),
        ("hil: base", "hil: base"),
        ("delay: filter=tight, uncompensated, realisation=base", "delay: tight, uncompensated"),
        ("clock: h0=2e-21, filter=loose", "clock: h0=2e-21, loose"),
        (
            "a: f=x; 5 levels of realisation together < f=y, g=none; 5 levels of realisation together",
            "a: x < y, g=none",
        ),
        ("delay: ", "delay"),
        ("", ""),
    ],
)
def test_cases_have_short_names(case: str, short: str) -> None:
    assert list(short_cases(pd.DataFrame({"case": [case]}))["case"]) == [short]
