"""The first tables of a study: which statements hold, which do not, which are not set up."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.campaign.definition.published import Stated
from lvnav_trade.metrics.published import COLUMNS
from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.statements import is_statement, verdicts, with_those_not_set_up

ROWS = [
    {"id": "p references 1", "item": "a number", "verdict": "holds", "case": "p: x"},
    {"id": "b", "item": "#10 second", "verdict": "does not hold here", "case": "p: x"},
    {"id": "a", "item": "#2 first, one reading", "verdict": "holds", "case": "p: x"},
    {"id": "a", "item": "#2 first, another", "verdict": "undecided", "case": "p: y"},
    {"id": "p statements 3", "item": "#3 third", "verdict": "holds", "case": "p: x"},
]
CAMPAIGN = {"name": "p", "statements": [{"id": "a"}, {"id": "b"}, {}]}


def test_statements_are_counted_by_number_and_stand_in_the_order_of_their_numbers() -> None:
    frame = with_those_not_set_up(pd.DataFrame(ROWS, columns=COLUMNS), [Stated(source="x", item="#4 fourth")])
    chosen = frame[is_statement(frame, [CAMPAIGN])]
    assert "a number" not in set(chosen["item"])
    blocks = verdicts(chosen)
    assert isinstance(blocks[0], Text)
    assert blocks[0].text == (
        "Of 4 statements 1 hold in every reading, 1 do not hold here, 1 are not set up, "
        "1 hold in part: for some readings or some of their conditions."
    )
    tables = [block for block in blocks if isinstance(block, Table)]
    assert [[row[0] for row in table.rows] for table in tables] == [
        ["#2 first, one reading", "#3 third"], ["#10 second"], ["#2 first, another"], ["#4 fourth"]
    ]  # fmt: skip


def test_a_study_without_statements_says_nothing_of_them() -> None:
    frame = pd.DataFrame(ROWS[:1], columns=COLUMNS)
    assert verdicts(frame[is_statement(frame, [{"name": "p"}])]) == []
    assert with_those_not_set_up(frame, []) is frame
