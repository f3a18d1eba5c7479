"""Statements of a publication that are reproduced or not, with margins: the first tables of a study."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_studies.claims import ExternalNumber, Statement, StudyStatements
from lvnav_studies.evaluate import NOT_RUN
from lvnav_trade.api.input import PublishedStatement
from lvnav_trade.api.measures import FAILS, HOLDS, NOT_SET_UP, UNDECIDED, marks
from lvnav_trade.api.pages import Block, Text, short_cases, table

# Headings of the tables by verdict, in their order
_HEADINGS = {
    FAILS: "Statements that do not hold here.",
    UNDECIDED: "Statements that these runs do not decide.",
    HOLDS: "Statements that hold.",
    NOT_SET_UP: "Statements that are not set up, and what is missing.",
    NOT_RUN: "Statements whose campaign has no results yet.",
}
# After the number of statements with a verdict: for one statement, for several
_SUMMARY_TEXTS = {
    HOLDS: ("holds in every evaluation by which it is tested", "hold in every evaluation by which they are tested"),
    FAILS: ("does not hold here", "do not hold here"),
    UNDECIDED: ("is undecided", "are undecided"),
    NOT_SET_UP: ("is not set up", "are not set up"),
    NOT_RUN: ("has not been run", "have not been run"),
}
_IN_PART = ("holds in part", "hold in part")
# Columns of these tables, as `lvnav_trade.api.pages.formatted_columns` reads them
_UNANSWERED_COLUMNS = "item | remark"
_COLUMNS = (
    "item | campaign and case = case | formal: number | true: number | Monte Carlo = monte_carlo: number | "
    "95 % = low to high: number | bounds = band_low to band_high: number | below (%) = percentile: .0f | remark"
)


def further_rows(study: StudyStatements, not_run: Mapping[str, Sequence[Statement]]) -> list[dict[str, Any]]:
    """Return the rows of statements without campaign, of campaigns without results, and of numbers from elsewhere.

    not_run : statements of the campaigns without results, by name of the campaign
    """
    rows = [_unanswered_row(statement, NOT_SET_UP, statement.remark) for statement in study.not_set_up]
    for campaign, statements in not_run.items():
        for statement in statements:
            remark = f"campaign {campaign}; {statement.remark}".removesuffix("; ")
            rows.append(_unanswered_row(statement, NOT_RUN, remark))
    rows += [_number_row(statement) for statement in study.elsewhere]
    return rows


def _unanswered_row(statement: PublishedStatement, verdict: str, remark: str) -> dict[str, Any]:
    return {**_identity_cells(statement), "in_band": False, "verdict": verdict, "remark": remark}


def _identity_cells(statement: PublishedStatement) -> dict[str, str]:
    """Return the cells that identify the row of a statement without a case."""
    return {
        "id": statement.id,
        "source": statement.source,
        "item": statement.item,
        **marks(statement.model_dump(), "statement"),
        "case": "",
        "metric": "",
        "unit": "-",
    }


def _number_row(statement: ExternalNumber) -> dict[str, Any]:
    low = np.nan if statement.at_least is None else statement.at_least
    high = np.nan if statement.at_most is None else statement.at_most
    is_inside = not (statement.value < low or statement.value > high)
    return {
        **_identity_cells(statement),
        "monte_carlo": statement.value,
        "ours": statement.value,
        "band_low": low,
        "band_high": high,
        "in_band": is_inside,
        "verdict": HOLDS if is_inside else FAILS,
        "remark": statement.remark,
    }


def verdicts(frame: pd.DataFrame) -> list[Block]:
    """Return how many numbered statements hold, and a table of the rows of each verdict; nothing without rows.

    Rows that are not set up or belong to campaigns without results do not count for a statement that others answer.
    """
    if frame.empty:
        return []
    item = frame["item"]
    first_word = item.str.split(" ").str[0]
    number = first_word.where(item.str.startswith("#"), item)
    verdicts_by_number = frame.verdict.groupby(number, sort=False)
    blocks: list[Block] = [Text(_summary(verdicts_by_number))]
    order = number.str.extract(r"(\d+)", expand=False).astype(float)
    rows = short_cases(frame).assign(order=order)
    rows = rows.sort_values("order", kind="stable")
    rows = rows.dropna(axis="columns", how="all")
    for verdict, heading in _HEADINGS.items():
        verdict_rows = rows[rows.verdict == verdict]
        if len(verdict_rows):
            columns = _UNANSWERED_COLUMNS if verdict in (NOT_SET_UP, NOT_RUN) else _COLUMNS
            blocks.append(table(verdict_rows, heading, columns))
    return blocks


def _summary(verdicts_by_number: Any) -> str:
    """Return how many statements have each verdict, from the verdicts of the rows grouped by statement."""
    verdict_sets = verdicts_by_number.agg(_statement_verdicts)
    counts = {}
    for verdict in _HEADINGS:
        is_unanimous = verdict_sets == frozenset([verdict])
        counts[verdict] = int(is_unanimous.sum())
    texts = [_count_text(counts[verdict], forms) for verdict, forms in _SUMMARY_TEXTS.items() if counts[verdict]]
    mixed_count = len(verdict_sets) - sum(counts.values())
    if mixed_count:
        texts.append(f"{_count_text(mixed_count, _IN_PART)}: for some readings or some of the conditions")
    text_list = ", ".join(texts)
    n = len(verdict_sets)
    return f"Of {n} statement{'s' if n > 1 else ''} {text_list}."


def _count_text(n: int, forms: tuple[str, str]) -> str:
    """Return a number with the text for one or for several."""
    return f"{n} {forms[0] if n == 1 else forms[1]}"


def _statement_verdicts(words: pd.Series) -> frozenset[str]:
    """Return the different verdicts of one statement; a row without an answer counts only if no row has one."""
    verdict_set = frozenset(words)
    return verdict_set - {NOT_RUN, NOT_SET_UP} or verdict_set - {NOT_RUN} or verdict_set
