"""Search for the case of a campaign that meets the requirements with the smallest total, such as mass."""

import time
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Solve
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import check_names, confirm, look, not_described
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.evaluation.resources import PREFERRED, TOTALLED, total_of

COLUMNS = ["case", "chosen", *TOTALLED, "error_ratio", "limiting_requirement", "meets", "remark"]
CONFIRMED = ["case", "requirement", "runs", "beyond", "expected", "verdict", "agree"]


class LeastTotal(NamedTuple):
    """Result of the search."""

    answers: pd.DataFrame  # table of the cases, columns `COLUMNS`, smallest total first
    confirmed: pd.DataFrame  # confirmation by runs, columns `CONFIRMED`
    least: str  # column of the minimised total
    seconds: float  # wall time, s


def least(campaign: Campaign, problem: Solve, jobs: int = 1) -> LeastTotal:
    """Return the case that meets the requirements, by linear covariance, with the smallest total.

    If the campaign has Monte Carlo, runs check this case, and the case with the next smaller total, which does not meet
    the requirements.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    problem : Solve
        Definition of the problem.
    jobs : int
        Worker processes.

    Returns
    -------
    LeastTotal
        Tables of the cases and of the confirmation.

    Raises
    ------
    InputError
        A requirement is unknown, or the devices of a case do not give the total.
    """
    begun = time.monotonic()
    check_names(campaign, problem.meet)
    column, all_cases = PREFERRED[str(problem.least)], cases(campaign)
    totals = [total_of(case.scenario.model_dump(mode="json")) for case in all_cases]
    for case, total in zip(all_cases, totals, strict=True):
        if not np.isfinite(total.get(column, np.nan)):
            raise InputError(f"solve.least: {problem.least}: no device of the case {case.label} states it (resources)")
    looks = list(each(jobs, _ratio, [(campaign, case, problem) for case in all_cases], ordered=True))
    rows = [
        {
            "case": case.label,
            "chosen": False,
            **total,
            "error_ratio": ratio,
            "limiting_requirement": name,
            "meets": ratio <= 1.0,
            "remark": why,
        }
        for case, total, (ratio, name, why) in zip(all_cases, totals, looks, strict=True)
    ]
    frame = pd.DataFrame(rows, columns=COLUMNS).sort_values(column, kind="stable")
    best = frame.index[frame.meets][:1]
    frame.loc[best, "chosen"] = True
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    smaller = frame.index[: frame.index.get_loc(best[0])][-1:] if len(best) else frame.index[:0]
    flights = [(campaign, all_cases[at], problem, runs) for at in [*smaller, *best] if runs]
    confirmed = [row for rows in each(jobs, _confirm, flights, ordered=True) for row in rows]
    return LeastTotal(
        frame.reset_index(drop=True), pd.DataFrame(confirmed, columns=CONFIRMED), column, time.monotonic() - begun
    )


def _ratio(campaign: Campaign, case: Case, problem: Solve) -> tuple[float, str, str]:
    """Return the largest ratio of an error to its limit, the limiting requirement, and a remark."""
    results = look(campaign, case.scenario, problem.meet)
    why = "; ".join(f"{name}: {result.why}" for name, result in results.items() if result.why)
    if why:
        return float("nan"), "", why
    name = max(results, key=lambda requirement: results[requirement].ratio)
    return results[name].ratio, name, not_described(result.outside for result in results.values())


def _confirm(campaign: Campaign, case: Case, problem: Solve, runs: int) -> list[tuple[Any, ...]]:
    return [(case.label, *row) for row in confirm(campaign, case.scenario, problem.meet, runs)]
