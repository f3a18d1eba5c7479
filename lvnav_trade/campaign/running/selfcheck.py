"""Check every distinct case of a campaign by itself: definitions, Jacobians, propagation, innovations, draws."""

import os
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.engines.analysis.selfcheck.case import check_scenario
from lvnav_trade.engines.analysis.selfcheck.check import Check, bounded


class Checked(NamedTuple):
    """A check, and the labels of the cases that it is of: what is the same in several is found once."""

    check: Check
    cases: tuple[str, ...]


def _one(number: int, case: Case, seed: int, history: float) -> tuple[int, list[Check]]:
    return number, check_scenario(case.scenario, seed, history)


def selfcheck(campaign: Campaign, jobs: int = -1, progress: Progress | None = None) -> list[Checked]:
    """Return the checks of all cases, in the order of the cases, with bounds for all statistics of the campaign."""
    found, watch = cases(campaign), progress or Progress()
    by_case: list[list[Check]] = [[] for _ in found]
    jobs = min(len(found), jobs if jobs > 0 else os.cpu_count() or 1)
    watch.stage("self-check", len(found))
    try:
        units = ((k, case, campaign.seed, campaign.keep.history) for k, case in enumerate(found))
        for number, checks in each(jobs, _one, units):
            by_case[number] = checks
            watch.advance(1)
    finally:
        watch.close()
    same: dict[tuple[object, ...], tuple[Check, list[str]]] = {}
    for case, checks in zip(found, by_case, strict=True):
        for check in checks:
            key = (check.kind, check.what, repr(check.figure), check.where, check.reason)
            same.setdefault(key, (check, []))[1].append(case.label)
    whole = bounded(check for check, _ in same.values())
    return [Checked(check, tuple(labels)) for check, (_, labels) in zip(whole, same.values(), strict=True)]
