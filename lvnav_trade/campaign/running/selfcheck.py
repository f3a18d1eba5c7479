"""Self-check of the distinct cases of a campaign: error definitions, Jacobians, propagation, innovations, draws."""

import os
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.covariance.selfcheck.case_checks import check_scenario
from lvnav_trade.covariance.selfcheck.check import CheckResult, bounded


class CombinedCheck(NamedTuple):
    """A check and the cases to which it applies; equal checks of several cases are combined."""

    check: CheckResult
    cases: tuple[str, ...]  # labels


def _check_case(number: int, case: Case, seed: int, history: float) -> tuple[int, list[CheckResult]]:
    return number, check_scenario(case.scenario, seed, history)


def selfcheck(campaign: Campaign, jobs: int = -1, progress: Progress | None = None) -> list[CombinedCheck]:
    """Return the checks of all cases, in the order of the cases.

    The bounds of the statistical checks take into account how many there are in the whole campaign.
    """
    all_cases, watch = cases(campaign), progress or Progress()
    by_case: list[list[CheckResult]] = [[] for _ in all_cases]
    jobs = min(len(all_cases), jobs if jobs > 0 else os.cpu_count() or 1)
    watch.stage("self-check", len(all_cases))
    try:
        items = ((k, case, campaign.seed, campaign.keep.history) for k, case in enumerate(all_cases))
        for number, checks in each(jobs, _check_case, items):
            by_case[number] = checks
            watch.advance(1)
    finally:
        watch.close()
    combined: dict[tuple[object, ...], tuple[CheckResult, list[str]]] = {}
    for case, checks in zip(all_cases, by_case, strict=True):
        for check in checks:
            key = (check.kind, check.what, repr(check.figure), check.where, check.reason)
            combined.setdefault(key, (check, []))[1].append(case.label)
    with_bounds = bounded(check for check, _ in combined.values())
    return [
        CombinedCheck(check, tuple(labels)) for check, (_, labels) in zip(with_bounds, combined.values(), strict=True)
    ]
