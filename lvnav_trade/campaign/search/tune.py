"""Filter tuning by linear covariance over several cases at once, evaluated in cases that were withheld."""

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Tune
from lvnav_trade.campaign.reading.spaced import Ends, ends_of
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import changed, fly, looked, not_described, number_at
from lvnav_trade.engines.setup.shared import trajectory_of
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.filters.base import FilterCard
from lvnav_trade.records import Floats

VALUES = ["path", "before", "after", "unit", "least", "largest"]
CASES = [
    "case",
    "role",
    "ratio_before",
    "ratio_after",
    "nees_before",
    "nees_after",
    "runs",
    "beyond",
    "verdict",
    "remark",
]
_OUTSIDE = 10.0  # weight of a NEES beyond its bounds, in the logarithm


class Point(NamedTuple):
    """A case with a filter: error over its limit, and the expected normalised error squared per state at the event,
    and why linear covariance does not describe the case.
    """

    ratio: float
    nees: float
    outside: str = ""


class Tuned(NamedTuple):
    """Tables `VALUES` and `CASES`, the filter card with its provenance, looks taken, and seconds of wall time."""

    values: pd.DataFrame
    cases: pd.DataFrame
    card: FilterCard
    evaluations: int
    seconds: float


def tune(campaign: Campaign, asked: Tune, jobs: int = 1) -> Tuned:
    """Return the filter whose numbers make a requirement's error small over the cases that are not held out.

    Nelder and Mead's simplex in the logarithms of the variables within their bounds, from the filter's own numbers (the
    middle where it has none there). The goal is the logarithm of the largest, or the mean, error over its limit; an
    expected NEES beyond its bounds adds ten times the logarithm of how far.

    InputError where a case or requirement is unknown, or a variable is no number of the filter.
    """
    begun = time.monotonic()
    name = _name(campaign, asked)
    every = cases(campaign)
    unknown = [label for label in asked.hold_out if label not in {case.label for case in every}]
    if unknown:
        raise InputError(f"tune.hold_out: no case {quoted(unknown[0])}")
    used = [case for case in every if case.label not in asked.hold_out]
    spans = [_span(one.path, one.between) for one in asked.variables]
    paths = [one.path for one in asked.variables]
    starts = [number_at(used[0].scenario, path, ends.unit) for path, ends in zip(paths, spans, strict=True)]
    known: dict[tuple[float, ...], float] = {}

    def values_at(x: Floats) -> dict[str, str]:
        return {
            path: ends.text(float(ends.first * (ends.last / ends.first) ** part))
            for path, ends, part in zip(paths, spans, np.clip(x, 0.0, 1.0), strict=True)
        }

    def goal(x: Floats) -> float:
        key = tuple(np.round(np.clip(x, 0.0, 1.0), 9))
        if key not in known:
            values = values_at(x)
            found = list(each(jobs, point, [(campaign, case, name, values) for case in used], ordered=True))
            known[key] = score(found, asked)
        return known[key]

    x0 = [_part(start, ends) for start, ends in zip(starts, spans, strict=True)]
    simplex = np.array(
        [x0, *([v + (0.25 if v < 0.7 else -0.25) * (k == j) for k, v in enumerate(x0)] for j in range(len(x0)))]
    )
    options = {"maxfev": asked.evaluations, "xatol": 5e-3, "fatol": 1e-3, "initial_simplex": simplex}
    best = optimize.minimize(goal, x0, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(x0), options=options)
    chosen = values_at(best.x)
    card = _card(campaign, asked, used, name, chosen, len(known))
    table = [
        (path, start, number_at(changed(used[0].scenario, chosen), path, ends.unit), ends.unit, ends.first, ends.last)
        for path, start, ends in zip(paths, starts, spans, strict=True)
    ]
    shown = pd.DataFrame(_before_and_after(campaign, asked, every, name, chosen, jobs), columns=CASES)
    return Tuned(pd.DataFrame(table, columns=VALUES), shown, card, len(known), time.monotonic() - begun)


def _before_and_after(
    campaign: Campaign, asked: Tune, every: Sequence[Case], name: str, chosen: Mapping[str, Any], jobs: int
) -> list[tuple[Any, ...]]:
    """Return the rows of `CASES`."""
    units = [(campaign, case, name, values) for case in every for values in ({}, chosen)]
    looks = list(each(jobs, point, units, ordered=True))
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    flights = list(each(jobs, _fly, [(campaign, case, chosen, runs, name) for case in every], ordered=True))
    return [
        (
            case.label,
            "held out" if case.label in asked.hold_out else "tuned",
            before.ratio,
            after.ratio,
            before.nees,
            after.nees,
            *flight,
            not_described([before.outside, after.outside]),
        )
        for case, before, after, flight in zip(every, looks[::2], looks[1::2], flights, strict=True)
    ]


def _fly(campaign: Campaign, case: Case, values: Mapping[str, Any], runs: int, name: str) -> tuple[int, int, str]:
    if not runs:
        return 0, 0, ""
    found = fly(campaign, changed(case.scenario, values), runs)[name]
    return found.runs, found.beyond, found.verdict


def _name(campaign: Campaign, asked: Tune) -> str:
    found = [one.name for one in campaign.requirements if not asked.requirement or one.name == asked.requirement]
    if not found:
        raise InputError(f"tune.requirement: no requirement {quoted(asked.requirement)}")
    return found[0]


def _span(path: str, between: Sequence[Any]) -> Ends:
    try:
        ends = ends_of(between)
        if min(ends.first, ends.last) <= 0.0 or not path.startswith("filter."):
            raise ValueError("should be a field of the filter, between two values above zero")
    except ValueError as error:
        raise InputError(f"tune.variables: {path}: {error}") from None
    return ends._replace(whole=False)


def _part(start: float, ends: Ends) -> float:
    """Return where between the ends a start lies, in the logarithm; the middle where it has no number there."""
    if not start > 0.0:
        return 0.5
    return float(np.clip(np.log(start / ends.first) / np.log(ends.last / ends.first), 0.0, 1.0))


def point(campaign: Campaign, case: Case, name: str, values: Mapping[str, Any]) -> Point:
    """Return what linear covariance says of a case with other numbers in its filter."""
    scenario = changed(case.scenario, values)
    found, history, freedom = looked(campaign, scenario, [name])
    (asked,) = (one for one in campaign.requirements if one.name == name)
    t = trajectory_of(scenario).events.get(asked.at or "", history.t[-1])
    at = int(np.argmin(np.abs(history.t - t)))
    return Point(found[name].ratio, float(history.expected_nees[at]) / freedom, found[name].outside)


def score(found: Sequence[Point], asked: Tune) -> float:
    """Return the goal of a tuning at one point of the search."""
    ratios = np.array([one.ratio for one in found])
    if not np.isfinite(ratios).all():
        return 1e6
    size = ratios.max() if asked.over == "worst" else ratios.mean()
    beyond = 0.0
    if asked.nees is not None:
        low, high = asked.nees
        beyond = sum(max(0.0, np.log(low / one.nees), np.log(one.nees / high)) for one in found)
    return float(np.log(size) + _OUTSIDE * beyond)


def _card(
    campaign: Campaign, asked: Tune, used: Sequence[Case], name: str, values: Mapping[str, str], looks: int
) -> FilterCard:
    """Return the tuned filter, whose source says what it was tuned for and by what."""
    card = changed(used[0].scenario, values).filter
    words = (
        f"tune of {campaign.name}: {', '.join(f'{path} = {value}' for path, value in values.items())}; {asked.over} of "
        f"{'; '.join(case.label for case in used)}; requirement {name}, by linear covariance, {looks} looks"
    )
    return card.model_copy(update={"name": f"{card.name}, tuned", "source": words})
