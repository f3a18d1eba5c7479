"""Which statements of a publication hold, by how much, and which do not: the first tables of a study."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.published import Stated
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.study import Elsewhere
from lvnav_trade.metrics.published import COLUMNS
from lvnav_trade.metrics.statements import FAILS, HOLDS, NOT_FLOWN, NOT_SET_UP, UNDECIDED
from lvnav_trade.report.blocks import Block, Text, stated

# Headings of the tables by verdict, in their order
_HEADINGS = {
    HOLDS: "Statements that hold.",
    FAILS: "Statements that do not hold here.",
    UNDECIDED: "Statements that these runs do not decide.",
    NOT_SET_UP: "Statements that are not set up, and what is missing.",
    NOT_FLOWN: "Statements whose campaign has no results yet.",
}


def with_those_left_out(
    frame: pd.DataFrame, missing: Sequence[Stated], unflown: Sequence[Campaign], elsewhere: Sequence[Elsewhere] = ()
) -> pd.DataFrame:
    """Return a table of references with a row for each statement that no campaign answers, for those of campaigns
    without results, and for those that a number from elsewhere answers.
    """
    rows = [(one, NOT_SET_UP, one.remark) for one in missing]
    rows += [
        (one, NOT_FLOWN, f"campaign {campaign.name}; {one.remark}".removesuffix("; "))
        for campaign in unflown
        for one in campaign.statements
    ]
    left = {"case": "", "metric": "", "unit": "-", "in_band": False}
    found: list[dict[str, Any]] = [
        {**_named(one), **left, "verdict": word, "remark": remark} for one, word, remark in rows
    ]
    found += [_of_number(one) for one in elsewhere]
    return pd.concat([frame, pd.DataFrame(found, columns=COLUMNS)], ignore_index=True) if found else frame


def _named(one: Stated) -> dict[str, str]:
    return {"id": one.id, "source": one.source, "item": one.item, "own": one.own}


def _of_number(one: Elsewhere) -> dict[str, Any]:
    low, high = (np.nan if bound is None else bound for bound in (one.at_least, one.at_most))
    holds = not (one.value < low or one.value > high)
    known = {**_named(one), "case": "", "metric": "", "unit": "-"}
    numbers = {"monte_carlo": one.value, "ours": one.value, "band_low": low, "band_high": high, "in_band": holds}
    return {**known, **numbers, "verdict": HOLDS if holds else FAILS, "remark": one.remark}


def is_statement(frame: pd.DataFrame, campaigns: Sequence[Mapping[str, Any]]) -> pd.Series:
    """Whether each row of a table of references is of a statement, or of one that is not set up."""
    names = {
        one.get("id") or f"{campaign.get('name')} statements {k}"
        for campaign in campaigns
        for k, one in enumerate(campaign.get("statements") or (), 1)
    }
    return frame.id.isin(names) | (frame["case"] == "")


def verdicts(frame: pd.DataFrame) -> list[Block]:
    """Return how many numbered statements hold, and a table of the rows of each verdict; nothing without rows."""
    if frame.empty:
        return []
    number = frame["item"].str.split(" ").str[0].where(frame["item"].str.startswith("#"), frame["item"])
    order = number.str.extract(r"(\d+)", expand=False).astype(float)
    groups = frame.verdict.groupby(number, sort=False).agg(lambda words: frozenset(words))
    only = {word: int((groups == frozenset([word])).sum()) for word in _HEADINGS}
    said = {
        HOLDS: "hold in every reading",
        FAILS: "do not hold here",
        UNDECIDED: "are undecided",
        NOT_SET_UP: "are not set up",
        NOT_FLOWN: "are not flown yet",
    }
    counts = [f"{only[word]} {said[word]}" for word in said if only[word]]
    if mixed := len(groups) - sum(only.values()):
        counts.append(f"{mixed} hold in part: for some readings or some of their conditions")
    blocks: list[Block] = [Text(f"Of {len(groups)} statements {', '.join(counts)}.")]
    rows = frame.assign(order=order).sort_values("order", kind="stable").dropna(axis="columns", how="all")
    for word, heading in _HEADINGS.items():
        mine = rows[rows.verdict == word]
        if len(mine):
            blocks.append(
                stated("left_out" if word in (NOT_SET_UP, NOT_FLOWN) else "statements", mine, heading=heading)
            )
    return blocks
