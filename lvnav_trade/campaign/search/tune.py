"""Filter tuning by linear covariance over several cases at once, validated in other cases.

The Nelder-Mead simplex searches the logarithms of the variables within their bounds. It starts from the present
settings of the filter, or from the middle of the bounds if a setting is not a number. The goal is the logarithm of
the largest (or mean) ratio of the error to its limit. If the expected NEES exceeds its bounds by a factor, ten
times the logarithm of this factor is added.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Tune
from lvnav_trade.campaign.reading.spaced import AxisEnds, ends_of
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import changed, covariance_verdicts, fly, not_described, number_at
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.preparation.cache import trajectory_of

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
_OUTSIDE = 10.0  # weight of the logarithm of the factor by which NEES exceeds its bounds


class TuningPoint(NamedTuple):
    """A case evaluated with one filter."""

    ratio: float  # error of the requirement over its limit
    nees: float  # expected normalised estimation error squared at the event, per state
    outside: str = ""  # reason why linear covariance does not describe the case; empty if it does


class TunedFilter(NamedTuple):
    """Result of a filter tuning."""

    values: pd.DataFrame  # tuned settings, columns `VALUES`
    cases: pd.DataFrame  # cases before and after, columns `CASES`
    card: FilterCard  # tuned filter with its provenance
    evaluations: int  # number of evaluations of the goal
    seconds: float  # wall time, s


def tune(campaign: Campaign, settings: Tune, jobs: int = 1) -> TunedFilter:
    """Tune the settings of a filter to minimise a requirement's error over all cases except the validation cases.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    settings : Tune
        Variables with their bounds, requirement, validation cases, largest number of evaluations.
    jobs : int
        Worker processes.

    Raises
    ------
    InputError
        A case or requirement is unknown, or a variable is not a number of the filter.
    """
    begun = time.monotonic()
    name = _name(campaign, settings)
    all_cases = cases(campaign)
    unknown = [label for label in settings.hold_out if label not in {case.label for case in all_cases}]
    if unknown:
        raise InputError(f"tune.hold_out: no case {quoted(unknown[0])}")
    used = [case for case in all_cases if case.label not in settings.hold_out]
    spans = [_span(variable.path, variable.between) for variable in settings.variables]
    paths = [variable.path for variable in settings.variables]
    starts = [number_at(used[0].scenario, path, ends.unit) for path, ends in zip(paths, spans, strict=True)]
    scores: dict[tuple[float, ...], float] = {}

    def values_at(x: Floats) -> dict[str, str]:
        return {
            path: ends.text(float(ends.first * (ends.last / ends.first) ** position))
            for path, ends, position in zip(paths, spans, np.clip(x, 0.0, 1.0), strict=True)
        }

    def goal(x: Floats) -> float:
        key = tuple(np.round(np.clip(x, 0.0, 1.0), 9))
        if key not in scores:
            values = values_at(x)
            evaluated = list(each(jobs, point, [(campaign, case, name, values) for case in used], ordered=True))
            scores[key] = score(evaluated, settings)
        return scores[key]

    x0 = [_part(start, ends) for start, ends in zip(starts, spans, strict=True)]
    simplex = np.array(
        [x0, *([v + (0.25 if v < 0.7 else -0.25) * (k == j) for k, v in enumerate(x0)] for j in range(len(x0)))]
    )
    options = {"maxfev": settings.evaluations, "xatol": 5e-3, "fatol": 1e-3, "initial_simplex": simplex}
    best = optimize.minimize(goal, x0, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(x0), options=options)
    chosen = values_at(best.x)
    card = _card(campaign, settings, used, name, chosen, len(scores))
    table = [
        (path, start, number_at(changed(used[0].scenario, chosen), path, ends.unit), ends.unit, ends.first, ends.last)
        for path, start, ends in zip(paths, starts, spans, strict=True)
    ]
    before_and_after = pd.DataFrame(_before_and_after(campaign, settings, all_cases, name, chosen, jobs), columns=CASES)
    return TunedFilter(
        pd.DataFrame(table, columns=VALUES), before_and_after, card, len(scores), time.monotonic() - begun
    )


def _before_and_after(
    campaign: Campaign, settings: Tune, all_cases: Sequence[Case], name: str, chosen: Mapping[str, Any], jobs: int
) -> list[tuple[Any, ...]]:
    """Return the rows of `CASES`: all cases with the original and with the tuned filter."""
    items = [(campaign, case, name, values) for case in all_cases for values in ({}, chosen)]
    looks = list(each(jobs, point, items, ordered=True))
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    flights = list(each(jobs, _fly, [(campaign, case, chosen, runs, name) for case in all_cases], ordered=True))
    return [
        (
            case.label,
            "held out" if case.label in settings.hold_out else "tuned",
            before.ratio,
            after.ratio,
            before.nees,
            after.nees,
            *flight,
            not_described([before.outside, after.outside]),
        )
        for case, before, after, flight in zip(all_cases, looks[::2], looks[1::2], flights, strict=True)
    ]


def _fly(campaign: Campaign, case: Case, values: Mapping[str, Any], runs: int, name: str) -> tuple[int, int, str]:
    if not runs:
        return 0, 0, ""
    result = fly(campaign, changed(case.scenario, values), runs)[name]
    return result.runs, result.beyond, result.verdict


def _name(campaign: Campaign, settings: Tune) -> str:
    names = [requirement.name for requirement in campaign.requirements]
    fitting = [name for name in names if settings.requirement in ("", name)]
    if not fitting:
        raise InputError(f"tune.requirement: no requirement {quoted(settings.requirement)}")
    return fitting[0]


def _span(path: str, between: Sequence[Any]) -> AxisEnds:
    try:
        ends = ends_of(between)
        if min(ends.first, ends.last) <= 0.0 or not path.startswith("filter."):
            raise ValueError("should be a field of the filter, between two values above zero")
    except ValueError as error:
        raise InputError(f"tune.variables: {path}: {error}") from None
    return ends._replace(whole=False)


def _part(start: float, ends: AxisEnds) -> float:
    """Return the position of a start value between the ends, in the logarithm, 0 to 1; 0.5 if it is not a number."""
    if not start > 0.0:
        return 0.5
    return float(np.clip(np.log(start / ends.first) / np.log(ends.last / ends.first), 0.0, 1.0))


def point(campaign: Campaign, case: Case, name: str, values: Mapping[str, Any]) -> TuningPoint:
    """Evaluate a case by linear covariance with other settings of its filter; `name`: the requirement."""
    scenario = changed(case.scenario, values)
    results, history, freedom = covariance_verdicts(campaign, scenario, [name])
    (requirement,) = (each for each in campaign.requirements if each.name == name)
    t = trajectory_of(scenario).events.get(requirement.at or "", history.t[-1])
    at = int(np.argmin(np.abs(history.t - t)))
    return TuningPoint(results[name].ratio, float(history.expected_nees[at]) / freedom, results[name].outside)


def score(points: Sequence[TuningPoint], settings: Tune) -> float:
    """Return the goal of a tuning from the evaluated cases; see `tune`."""
    ratios = np.array([point.ratio for point in points])
    if not np.isfinite(ratios).all():
        return 1e6
    size = ratios.max() if settings.over == "worst" else ratios.mean()
    beyond = 0.0
    if settings.nees is not None:
        low, high = settings.nees
        beyond = sum(max(0.0, np.log(low / point.nees), np.log(point.nees / high)) for point in points)
    return float(np.log(size) + _OUTSIDE * beyond)


def _card(
    campaign: Campaign, settings: Tune, used: Sequence[Case], name: str, values: Mapping[str, str], looks: int
) -> FilterCard:
    """Return the card of the tuned filter; its source describes the tuning."""
    card = changed(used[0].scenario, values).filter
    words = (
        f"tune of {campaign.name}: {', '.join(f'{path} = {value}' for path, value in values.items())}; "
        f"{settings.over} of {'; '.join(case.label for case in used)}; requirement {name}, "
        f"by linear covariance, {looks} looks"
    )
    return card.model_copy(update={"name": f"{card.name}, tuned", "source": words})
