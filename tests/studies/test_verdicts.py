"""The first tables of a study's answer: which statements hold, which do not, which are not set up."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_studies.claims import ExternalNumber, Statement, StudyStatements
from lvnav_studies.verdicts import further_rows, verdicts
from lvnav_trade.api.measures import COLUMNS
from lvnav_trade.report.blocks import Table, Text

SIZE = {"metric": "velocity_error_3d", "at": "injection"}
ROWS = [
    {"id": "p references 1", "item": "a number", "verdict": "holds", "case": "p: x"},
    {"id": "b", "item": "#10 second", "verdict": "does not hold here", "case": "p: x"},
    {"id": "a", "item": "#2 first, one reading", "verdict": "holds", "case": "p: x"},
    {"id": "a", "item": "#2 first, another", "verdict": "undecided", "case": "p: y"},
    {"id": "p statements 3", "item": "#3 third", "verdict": "holds", "case": "p: x"},
]


def test_statements_are_counted_by_number_and_stand_in_the_order_of_their_numbers() -> None:
    bound = {"source": "x", "item": "#5 fifth", "value": "a", "terms": {"a": SIZE}, "at_most": 1.0}
    study = StudyStatements.model_validate({"not_set_up": [{"source": "x", "item": "#4 fourth"}]})
    further = further_rows(study, {"later": [Statement.model_validate(bound)]})
    assert [row["remark"] for row in further] == ["", "campaign later"]
    blocks = verdicts(pd.DataFrame([*ROWS[1:], *further], columns=COLUMNS))
    assert isinstance(blocks[0], Text)
    assert blocks[0].text == (
        "Of 5 statements 1 holds in every evaluation by which it is tested, 1 does not hold here, 1 is not set up, "
        "1 has not been run, 1 holds in part: for some readings or some of the conditions."
    )
    tables = [block for block in blocks if isinstance(block, Table)]
    assert [[row[0] for row in table.rows] for table in tables] == [
        ["#10 second"], ["#2 first, another"], ["#2 first, one reading", "#3 third"], ["#4 fourth"], ["#5 fifth"]
    ]  # fmt: skip


@pytest.mark.parametrize("answer", ["does not hold here", "holds"])
def test_a_row_without_an_answer_does_not_count_for_a_statement_that_has_one(answer: str) -> None:
    rows = [ROWS[1] | {"verdict": word} for word in (answer, "not set up", "not run")]
    summary, *_ = verdicts(pd.DataFrame(rows, columns=COLUMNS))
    assert isinstance(summary, Text)
    assert summary.text.startswith("Of 1 statement 1 ")
    assert "in part" not in summary.text
    unanswered, *_ = verdicts(pd.DataFrame(rows[1:], columns=COLUMNS))
    assert isinstance(unanswered, Text)
    assert unanswered.text == "Of 1 statement 1 is not set up."


def test_a_study_without_statements_says_nothing_of_them() -> None:
    assert verdicts(pd.DataFrame([], columns=COLUMNS)) == []
    assert further_rows(StudyStatements(), {}) == []


def test_a_number_from_elsewhere_has_its_verdict_and_says_where_it_is_from() -> None:
    stated = {"id": "cost", "source": "x", "item": "#29 cost", "value": 3.5, "at_least": 2.0, "remark": "benchmark"}
    study = StudyStatements.model_validate({"elsewhere": [stated, stated | {"value": 1.5}]})
    assert [(row["monte_carlo"], row["verdict"], row["remark"]) for row in further_rows(study, {})] == [
        (3.5, "holds", "benchmark"), (1.5, "does not hold here", "benchmark")
    ]  # fmt: skip
    for wrong in ({"remark": ""}, {"at_least": None}):
        with pytest.raises(ValueError, match=r"bound|from"):
            ExternalNumber.model_validate(stated | wrong)
