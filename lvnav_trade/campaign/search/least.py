"""Search for the case of a campaign that meets the requirements with the smallest total, such as mass."""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Solve
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.search.point import check_names, combined_remark, confirm, evaluate_requirements
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.evaluation.resources import PREFERRED, TOTALLED, device_totals

COLUMNS = ["case", "chosen", *TOTALLED, "error_ratio", "limiting_requirement", "meets", "remark"]
CONFIRMED = ["case", "requirement", "runs", "beyond", "expected", "verdict", "agree"]


class LeastTotal(NamedTuple):
    """Result of the search."""

    answers: pd.DataFrame  # table of the cases, columns `COLUMNS`, smallest total first
    confirmed: pd.DataFrame  # confirmation by runs, columns `CONFIRMED`
    total_column: str  # column of the minimised total
    seconds: float  # wall time, s


def least_total_case(campaign: Campaign, problem: Solve, jobs: int = 1) -> LeastTotal:
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
    start_time = time.monotonic()
    check_names(campaign, problem.meet)
    column = PREFERRED[str(problem.least)]
    all_cases = cases(campaign)
    totals = [device_totals(case.scenario.model_dump(mode="json")) for case in all_cases]
    for case, total in zip(all_cases, totals, strict=True):
        if not np.isfinite(total.get(column, np.nan)):
            raise InputError(f"solve.least: {problem.least}: no device of the case {case.label} states it (resources)")
    ratio_items = [(campaign, case, problem) for case in all_cases]
    ratios = list(map_items(jobs, _ratio, ratio_items, is_ordered=True))
    evaluations = zip(all_cases, totals, ratios, strict=True)
    rows = [_row(case, total, *ratio) for case, total, ratio in evaluations]
    table = pd.DataFrame(rows, columns=COLUMNS)
    table = table.sort_values(column, kind="stable")
    sufficient_rows = np.flatnonzero(table.meets)
    checked_cases: list[Case] = []
    if len(sufficient_rows):
        best = int(sufficient_rows[0])
        table.loc[table.index[best], "chosen"] = True
        # Runs check the chosen case, and the case with the next smaller total, which should not meet the requirements.
        checked_numbers = table.index[max(0, best - 1) : best + 1]
        checked_cases = [all_cases[number] for number in checked_numbers]
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    items = [(campaign, case, problem, runs) for case in checked_cases if runs]
    confirmation_rows: list[tuple[Any, ...]] = []
    for confirmation in map_items(jobs, _confirm, items, is_ordered=True):
        confirmation_rows += confirmation
    return LeastTotal(
        answers=table.reset_index(drop=True),
        confirmed=pd.DataFrame(confirmation_rows, columns=CONFIRMED),
        total_column=column,
        seconds=time.monotonic() - start_time,
    )


def _row(
    case: Case, total: Mapping[str, float], error_ratio: float, limiting_requirement: str, remark: str
) -> dict[str, Any]:
    """Return a row of `COLUMNS`."""
    return {
        "case": case.label,
        "chosen": False,
        **total,
        "error_ratio": error_ratio,
        "limiting_requirement": limiting_requirement,
        "meets": error_ratio <= 1.0,
        "remark": remark,
    }


def _ratio(campaign: Campaign, case: Case, problem: Solve) -> tuple[float, str, str]:
    """Return the largest ratio of an error to its limit, the limiting requirement, and a remark.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    case : Case
        The case.
    problem : Solve
        Settings of the search, with the names of the requirements.

    Returns
    -------
    float, str, str
        Ratio, NaN if a requirement cannot be evaluated; name of the requirement; remark.
    """
    verdicts = evaluate_requirements(campaign, case.scenario, problem.meet)
    reasons = "; ".join(
        f"{name}: {verdict.missing_reason}" for name, verdict in verdicts.items() if verdict.missing_reason
    )
    if reasons:
        return float("nan"), "", reasons
    limiting = max(verdicts, key=lambda name: verdicts[name].ratio)
    remark = combined_remark(verdict.validity_remark for verdict in verdicts.values())
    return verdicts[limiting].ratio, limiting, remark


def _confirm(campaign: Campaign, case: Case, problem: Solve, runs: int) -> list[tuple[Any, ...]]:
    """Return the rows of `CONFIRMED` for a case."""
    rows = confirm(campaign, case.scenario, problem.meet, runs)
    return [(case.label, *row) for row in rows]
