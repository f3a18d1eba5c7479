"""Statements of a publication that are reproduced or not, with margins: the first tables of a study."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_studies.claims import Elsewhere, OfStudy, Statement
from lvnav_studies.evaluate import NOT_FLOWN
from lvnav_trade.api.input import PublishedStatement
from lvnav_trade.api.measures import FAILS, HOLDS, NOT_SET_UP, UNDECIDED, marks
from lvnav_trade.api.pages import Block, Text, short_cases, table

# Headings of the tables by verdict, in their order
_HEADINGS = {
    FAILS: "Statements that do not hold here.",
    UNDECIDED: "Statements that these runs do not decide.",
    HOLDS: "Statements that hold.",
    NOT_SET_UP: "Statements that are not set up, and what is missing.",
    NOT_FLOWN: "Statements whose campaign has no results yet.",
}
# Columns of these tables, as `lvnav_trade.api.pages.shown` reads them
_LEFT_OUT = "item | remark"
_COLUMNS = (
    "item | campaign and case = case | formal: number | true: number | Monte Carlo = monte_carlo: number | "
    "95 % = low to high: number | bounds = band_low to band_high: number | below (%) = percentile: .0f | remark"
)


def further_rows(study: OfStudy, unflown: Mapping[str, Sequence[Statement]]) -> list[dict[str, Any]]:
    """Return a row for each statement that no campaign answers, for those of campaigns without results (by their name),
    and for those that a number from elsewhere answers.
    """
    rows: list[tuple[PublishedStatement, str, str]] = [(one, NOT_SET_UP, one.remark) for one in study.not_set_up]
    rows += [
        (one, NOT_FLOWN, f"campaign {campaign}; {one.remark}".removesuffix("; "))
        for campaign, statements in unflown.items()
        for one in statements
    ]
    left = {"case": "", "metric": "", "unit": "-", "in_band": False}
    found = [{**_named(one), **left, "verdict": word, "remark": remark} for one, word, remark in rows]
    return [*found, *map(_of_number, study.elsewhere)]


def _named(one: PublishedStatement) -> dict[str, str]:
    return {"id": one.id, "source": one.source, "item": one.item, **marks(one.model_dump(), "statement")}


def _of_number(one: Elsewhere) -> dict[str, Any]:
    low, high = (np.nan if bound is None else bound for bound in (one.at_least, one.at_most))
    holds = not (one.value < low or one.value > high)
    known = {**_named(one), "case": "", "metric": "", "unit": "-"}
    numbers = {"monte_carlo": one.value, "ours": one.value, "band_low": low, "band_high": high, "in_band": holds}
    return {**known, **numbers, "verdict": HOLDS if holds else FAILS, "remark": one.remark}


def verdicts(frame: pd.DataFrame) -> list[Block]:
    """Return how many numbered statements hold, and a table of the rows of each verdict; nothing without rows.

    What is not flown yet does not count against a statement that other campaigns answer.
    """
    if frame.empty:
        return []
    number = frame["item"].str.split(" ").str[0].where(frame["item"].str.startswith("#"), frame["item"])
    order = number.str.extract(r"(\d+)", expand=False).astype(float)
    groups = frame.verdict.groupby(number, sort=False).agg(
        lambda words: frozenset(words) - {NOT_FLOWN} or frozenset(words)
    )
    only = {word: int((groups == frozenset([word])).sum()) for word in _HEADINGS}
    said = {
        HOLDS: "hold in every evaluation",
        FAILS: "do not hold here",
        UNDECIDED: "are undecided",
        NOT_SET_UP: "are not set up",
        NOT_FLOWN: "are not flown yet",
    }
    counts = [f"{only[word]} {said[word]}" for word in said if only[word]]
    if mixed := len(groups) - sum(only.values()):
        counts.append(f"{mixed} hold in part: for some readings or some of their conditions")
    blocks: list[Block] = [Text(f"Of {len(groups)} statements {', '.join(counts)}.")]
    rows = short_cases(frame).assign(order=order).sort_values("order", kind="stable").dropna(axis="columns", how="all")
    for word, heading in _HEADINGS.items():
        mine = rows[rows.verdict == word]
        if len(mine):
            blocks.append(table(mine, heading, _LEFT_OUT if word in (NOT_SET_UP, NOT_FLOWN) else _COLUMNS))
    return blocks
