"""The first tables of a study: which statements hold, which do not, which are not set up."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.campaign.definition.published import Stated, Statement
from lvnav_trade.campaign.reading.study import Elsewhere
from lvnav_trade.metrics.published import COLUMNS
from lvnav_trade.report.blocks import Table, Text
from lvnav_trade.report.statements import is_statement, verdicts, with_those_left_out

SIZE = {"metric": "velocity_error_3d", "at": "injection"}
ROWS = [
    {"id": "p references 1", "item": "a number", "verdict": "holds", "case": "p: x"},
    {"id": "b", "item": "#10 second", "verdict": "does not hold here", "case": "p: x"},
    {"id": "a", "item": "#2 first, one reading", "verdict": "holds", "case": "p: x"},
    {"id": "a", "item": "#2 first, another", "verdict": "undecided", "case": "p: y"},
    {"id": "p statements 3", "item": "#3 third", "verdict": "holds", "case": "p: x"},
]
CAMPAIGN = {"name": "p", "statements": [{"id": "a"}, {"id": "b"}, {}]}


def test_statements_are_counted_by_number_and_stand_in_the_order_of_their_numbers() -> None:
    bound = {"source": "x", "item": "#5 fifth", "value": "a", "terms": {"a": SIZE}, "at_most": 1.0}
    unflown = SimpleNamespace(name="later", statements=[Statement.model_validate(bound)])
    missing = [Stated(source="x", item="#4 fourth")]
    frame = with_those_left_out(pd.DataFrame(ROWS, columns=COLUMNS), missing, [unflown])
    assert list(frame.remark.iloc[-2:]) == ["", "campaign later"]
    chosen = frame[is_statement(frame, [CAMPAIGN])]
    assert "a number" not in set(chosen["item"])
    blocks = verdicts(chosen)
    assert isinstance(blocks[0], Text)
    assert blocks[0].text == (
        "Of 5 statements 1 hold in every reading, 1 do not hold here, 1 are not set up, 1 are not flown yet, "
        "1 hold in part: for some readings or some of their conditions."
    )
    tables = [block for block in blocks if isinstance(block, Table)]
    assert [[row[0] for row in table.rows] for table in tables] == [
        ["#2 first, one reading", "#3 third"], ["#10 second"], ["#2 first, another"], ["#4 fourth"], ["#5 fifth"]
    ]  # fmt: skip


def test_a_study_without_statements_says_nothing_of_them() -> None:
    frame = pd.DataFrame(ROWS[:1], columns=COLUMNS)
    assert verdicts(frame[is_statement(frame, [{"name": "p"}])]) == []
    assert with_those_left_out(frame, [], []) is frame


def test_a_number_from_elsewhere_has_its_verdict_and_says_where_it_is_from() -> None:
    stated = {"id": "cost", "source": "x", "item": "#29 cost", "value": 3.5, "at_least": 2.0, "remark": "benchmark"}
    numbers = [Elsewhere.model_validate(stated), Elsewhere.model_validate(stated | {"value": 1.5})]
    frame = with_those_left_out(pd.DataFrame(ROWS[:1], columns=COLUMNS), [], [], numbers)
    assert frame[["monte_carlo", "verdict", "remark"]].iloc[1:].to_numpy().tolist() == [
        [3.5, "holds", "benchmark"], [1.5, "does not hold here", "benchmark"]
    ]  # fmt: skip
    assert frame[is_statement(frame, [{"name": "p"}])].id.tolist() == ["cost", "cost"]
    for wrong in ({"remark": ""}, {"at_least": None}):
        with pytest.raises(ValueError, match=r"bound|from"):
            Elsewhere.model_validate(stated | wrong)
