"""Self-check of the distinct cases of a campaign: error definitions, Jacobians, propagation, innovations, draws."""

import os
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.covariance.selfcheck.case_checks import check_scenario
from lvnav_trade.covariance.selfcheck.check import CheckResult, set_bounds


class CombinedCheck(NamedTuple):
    """A check and the cases to which it applies; equal checks of several cases are combined."""

    check: CheckResult
    cases: tuple[str, ...]  # labels


def _check_case(number: int, case: Case, seed: int, history: float) -> tuple[int, list[CheckResult]]:
    return number, check_scenario(case.scenario, seed, history)


def selfcheck(campaign: Campaign, jobs: int = -1, progress: Progress | None = None) -> list[CombinedCheck]:
    """Return the checks of all cases, in the order of the cases.

    The bounds of the statistical checks take into account how many there are in the whole campaign.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    jobs : int
        Number of worker processes; -1 for all cores.
    progress : Progress, optional
        Display of the progress.
    """
    all_cases = cases(campaign)
    progress = progress or Progress()
    by_case: list[list[CheckResult]] = [[] for _ in all_cases]
    processes = jobs if jobs > 0 else os.cpu_count() or 1
    progress.stage("self-check", len(all_cases))
    try:
        items = ((k, case, campaign.seed, campaign.keep.history) for k, case in enumerate(all_cases))
        for number, checks in map_items(min(len(all_cases), processes), _check_case, items):
            by_case[number] = checks
            progress.advance(1)
    finally:
        progress.close()
    return _combined_checks([case.label for case in all_cases], by_case)


def _combined_checks(labels: list[str], by_case: list[list[CheckResult]]) -> list[CombinedCheck]:
    """Return each distinct check once, bounded, with the labels of its cases."""
    distinct: dict[tuple[object, ...], CheckResult] = {}
    labels_by_key: dict[tuple[object, ...], list[str]] = {}
    for label, checks in zip(labels, by_case, strict=True):
        for check in checks:
            key = (check.check_type, check.quantity, repr(check.figure), check.remark, check.reason)
            distinct.setdefault(key, check)
            labels_by_key.setdefault(key, []).append(label)
    combined_checks = []
    for check, check_labels in zip(set_bounds(distinct.values()), labels_by_key.values(), strict=True):
        combined_checks.append(CombinedCheck(check, tuple(check_labels)))
    return combined_checks
