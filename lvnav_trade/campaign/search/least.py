"""Discrete search: the case of a campaign that meets the requirements with the smallest total, such as mass."""

import time
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Solve
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import check_names, confirm, look, not_described
from lvnav_trade.errors import InputError
from lvnav_trade.metrics.resources import PREFERRED, TOTALLED, total_of

COLUMNS = ["case", "chosen", *TOTALLED, "error_ratio", "binding", "meets", "remark"]
CONFIRMED = ["case", "requirement", "runs", "beyond", "expected", "verdict", "agree"]


class Chosen(NamedTuple):
    """Tables of the cases (`COLUMNS`, smallest total first) and of runs (`CONFIRMED`), the total, seconds."""

    answers: pd.DataFrame
    confirmed: pd.DataFrame
    least: str
    seconds: float


def least(campaign: Campaign, asked: Solve, jobs: int = 1) -> Chosen:
    """Return which case meets the requirements by linear covariance with the least of a total; with `monte_carlo`, runs
    of that case and of the next smaller one, which does not suffice.

    InputError where a requirement is unknown, or a case states no such total.
    """
    begun = time.monotonic()
    check_names(campaign, asked.meet)
    column, found = PREFERRED[str(asked.least)], cases(campaign)
    totals = [total_of(case.scenario.model_dump(mode="json")) for case in found]
    for case, total in zip(found, totals, strict=True):
        if not np.isfinite(total.get(column, np.nan)):
            raise InputError(f"solve.least: {asked.least}: no device of the case {case.label} states it (resources)")
    looks = list(each(jobs, _ratio, [(campaign, case, asked) for case in found], ordered=True))
    rows = [
        {
            "case": case.label,
            "chosen": False,
            **total,
            "error_ratio": ratio,
            "binding": name,
            "meets": ratio <= 1.0,
            "remark": why,
        }
        for case, total, (ratio, name, why) in zip(found, totals, looks, strict=True)
    ]
    frame = pd.DataFrame(rows, columns=COLUMNS).sort_values(column, kind="stable")
    best = frame.index[frame.meets][:1]
    frame.loc[best, "chosen"] = True
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    smaller = frame.index[: frame.index.get_loc(best[0])][-1:] if len(best) else frame.index[:0]
    flights = [(campaign, found[at], asked, runs) for at in [*smaller, *best] if runs]
    confirmed = [row for rows in each(jobs, _confirm, flights, ordered=True) for row in rows]
    return Chosen(
        frame.reset_index(drop=True), pd.DataFrame(confirmed, columns=CONFIRMED), column, time.monotonic() - begun
    )


def _ratio(campaign: Campaign, case: Case, asked: Solve) -> tuple[float, str, str]:
    """Return the largest error over its limit, the requirement that has it, and a remark."""
    found = look(campaign, case.scenario, asked.meet)
    why = "; ".join(f"{name}: {one.why}" for name, one in found.items() if one.why)
    if why:
        return float("nan"), "", why
    name = max(found, key=lambda one: found[one].ratio)
    return found[name].ratio, name, not_described(one.outside for one in found.values())


def _confirm(campaign: Campaign, case: Case, asked: Solve, runs: int) -> list[tuple[Any, ...]]:
    return [(case.label, *one) for one in confirm(campaign, case.scenario, asked.meet, runs)]
