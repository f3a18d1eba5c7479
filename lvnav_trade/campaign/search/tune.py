"""Filter tuning by linear covariance over several cases together, validated in other cases.

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
from lvnav_trade.campaign.reading.spaced import AxisEnds, parse_ends
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.search.point import (
    combined_remark,
    covariance_verdicts,
    monte_carlo_verdicts,
    number_at,
    with_values,
)
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
    validity_remark: str = ""  # reason why linear covariance does not describe the case; empty if it does


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
    start_time = time.monotonic()
    name = _requirement_name(campaign, settings)
    all_cases = cases(campaign)
    labels = {case.label for case in all_cases}
    for label in settings.hold_out:
        if label not in labels:
            raise InputError(f"tune.hold_out: no case {quoted(label)}")
    tuning_cases = [case for case in all_cases if case.label not in settings.hold_out]
    spans = {variable.path: _span(variable.path, variable.between) for variable in settings.variables}
    scenario = tuning_cases[0].scenario
    starts = {path: number_at(scenario, path, ends.unit) for path, ends in spans.items()}
    scores: dict[tuple[float, ...], float] = {}

    def goal(x: Floats) -> float:
        clipped_point = np.clip(x, 0.0, 1.0)
        key = tuple(np.round(clipped_point, 9))
        if key not in scores:
            values = _values_at(spans, x)
            items = [(campaign, case, name, values) for case in tuning_cases]
            points = list(map_items(jobs, point, items, is_ordered=True))
            scores[key] = score(points, settings)
        return scores[key]

    x0 = [_position(starts[path], ends) for path, ends in spans.items()]
    simplex = _initial_simplex(x0)
    options = {"maxfev": settings.evaluations, "xatol": 5e-3, "fatol": 1e-3, "initial_simplex": simplex}
    bounds = [(0.0, 1.0)] * len(x0)
    best = optimize.minimize(goal, x0, method="Nelder-Mead", bounds=bounds, options=options)
    tuned_values = _values_at(spans, best.x)
    tuned_scenario = with_values(scenario, tuned_values)
    value_rows = []
    for path, ends in spans.items():
        tuned_value = number_at(tuned_scenario, path, ends.unit)
        row = (path, starts[path], tuned_value, ends.unit, ends.first, ends.last)
        value_rows.append(row)
    case_rows = _case_rows(campaign, settings, all_cases, name, tuned_values, jobs)
    return TunedFilter(
        values=pd.DataFrame(value_rows, columns=VALUES),
        cases=pd.DataFrame(case_rows, columns=CASES),
        card=_card(campaign, settings, tuning_cases, name, tuned_values, len(scores)),
        evaluations=len(scores),
        seconds=time.monotonic() - start_time,
    )


def _values_at(spans: Mapping[str, AxisEnds], x: Floats) -> dict[str, str]:
    """Return the values of the tuned fields at a point of the search.

    Parameters
    ----------
    spans : mapping of str to AxisEnds
        Bounds of each field by dotted path.
    x : (n,) array
        Position of each field, from 0 to 1 between the logarithms of its bounds; clipped to this range.

    Returns
    -------
    dict of str to str
        Values as written in a campaign, by dotted path.
    """
    values = {}
    positions = np.clip(x, 0.0, 1.0)
    for (path, ends), position in zip(spans.items(), positions, strict=True):
        ratio = ends.last / ends.first
        value = ends.first * ratio**position
        values[path] = ends.text(float(value))
    return values


def _initial_simplex(x0: Sequence[float]) -> Floats:
    """Return the simplex (n + 1, n) around the start: one variable of each further vertex is moved inwards by 0.25."""
    vertices = np.array([x0] * (len(x0) + 1))
    for k, start in enumerate(x0):
        vertices[k + 1, k] += 0.25 if start < 0.7 else -0.25
    return vertices


def _case_rows(
    campaign: Campaign, settings: Tune, all_cases: Sequence[Case], name: str, tuned_values: Mapping[str, Any], jobs: int
) -> list[tuple[Any, ...]]:
    """Return the rows of `CASES`: all cases with the original and with the tuned filter.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    settings : Tune
        Settings of the tuning.
    all_cases : sequence of Case
        Cases of the tuning and held-out cases.
    name : str
        Name of the requirement.
    tuned_values : mapping
        Tuned values by dotted path.
    jobs : int
        Number of worker processes.
    """
    items = [(campaign, case, name, values) for case in all_cases for values in ({}, tuned_values)]
    points = list(map_items(jobs, point, items, is_ordered=True))
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    run_items = [(campaign, case, tuned_values, runs, name) for case in all_cases]
    run_results = list(map_items(jobs, _confirm, run_items, is_ordered=True))
    rows = []
    original_points = points[::2]
    tuned_points = points[1::2]
    results = zip(all_cases, original_points, tuned_points, run_results, strict=True)
    for case, original_point, tuned_point, run_result in results:
        row = (
            case.label,
            "held out" if case.label in settings.hold_out else "tuned",
            original_point.ratio,
            tuned_point.ratio,
            original_point.nees,
            tuned_point.nees,
            *run_result,
            combined_remark([original_point.validity_remark, tuned_point.validity_remark]),
        )
        rows.append(row)
    return rows


def _confirm(campaign: Campaign, case: Case, values: Mapping[str, Any], runs: int, name: str) -> tuple[int, int, str]:
    """Confirm the tuned filter in a case by Monte Carlo runs.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    case : Case
        The case.
    values : mapping
        Tuned values by dotted path.
    runs : int
        Number of runs; 0 for none.
    name : str
        Name of the requirement.

    Returns
    -------
    int, int, str
        Number of runs, number of runs beyond the limit, verdict; 0, 0 and an empty text without runs.
    """
    if not runs:
        return 0, 0, ""
    scenario = with_values(case.scenario, values)
    result = monte_carlo_verdicts(campaign, scenario, runs)[name]
    return result.runs, result.violation_count, result.verdict


def _requirement_name(campaign: Campaign, settings: Tune) -> str:
    for requirement in campaign.requirements:
        if settings.requirement in ("", requirement.name):
            return requirement.name
    raise InputError(f"tune.requirement: no requirement {quoted(settings.requirement)}")


def _span(path: str, limits: Sequence[Any]) -> AxisEnds:
    try:
        ends = parse_ends(limits)
        if min(ends.first, ends.last) <= 0.0 or not path.startswith("filter."):
            raise ValueError("should be a field of the filter, between two values above zero")
    except ValueError as error:
        raise InputError(f"tune.variables: {path}: {error}") from None
    return ends._replace(is_integer=False)


def _position(start: float, ends: AxisEnds) -> float:
    """Return the position of a start value between the ends, in the logarithm, 0 to 1; 0.5 if it is not a number."""
    if not start > 0.0:
        return 0.5
    span = np.log(ends.last / ends.first)
    position = np.log(start / ends.first) / span
    return float(np.clip(position, 0.0, 1.0))


def point(campaign: Campaign, case: Case, name: str, values: Mapping[str, Any]) -> TuningPoint:
    """Evaluate a case by linear covariance with other settings of its filter.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    case : Case
        The case.
    name : str
        Name of the requirement.
    values : mapping
        Settings by dotted path.

    Returns
    -------
    TuningPoint
        Ratio of error to limit, and NEES per estimated state at the event of the requirement.
    """
    scenario = with_values(case.scenario, values)
    verdicts, history, degrees_of_freedom = covariance_verdicts(campaign, scenario, [name])
    (requirement,) = (requirement for requirement in campaign.requirements if requirement.name == name)
    events = trajectory_of(scenario).events
    t_event = events.get(requirement.at or "", history.t[-1])
    hist = int(np.argmin(np.abs(history.t - t_event)))
    nees = float(history.expected_nees[hist])
    verdict = verdicts[name]
    return TuningPoint(verdict.ratio, nees / degrees_of_freedom, verdict.validity_remark)


def score(points: Sequence[TuningPoint], settings: Tune) -> float:
    """Return the goal of a tuning, which is minimised; see `tune`.

    Parameters
    ----------
    points : sequence of TuningPoint
        Evaluated cases.
    settings : Tune
        Settings of the tuning.

    Returns
    -------
    float
        Logarithm of the error ratio, plus a penalty for an NEES outside its limits; 1e6 if a ratio is not finite.
    """
    ratios = np.array([point.ratio for point in points])
    if not np.isfinite(ratios).all():
        return 1e6
    size = ratios.max() if settings.over == "worst" else ratios.mean()
    nees_excess = 0.0
    if settings.nees is not None:
        low, high = settings.nees
        for point in points:
            nees_excess += max(0.0, np.log(low / point.nees), np.log(point.nees / high))
    return float(np.log(size) + _OUTSIDE * nees_excess)


def _card(
    campaign: Campaign,
    settings: Tune,
    tuning_cases: Sequence[Case],
    name: str,
    values: Mapping[str, str],
    evaluations: int,
) -> FilterCard:
    """Return the card of the tuned filter; its source describes the tuning.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    settings : Tune
        Settings of the tuning.
    tuning_cases : sequence of Case
        Cases of the tuning; the filter of the first is changed.
    name : str
        Name of the requirement.
    values : mapping of str to str
        Tuned values by dotted path.
    evaluations : int
        Number of evaluations by linear covariance.
    """
    card = with_values(tuning_cases[0].scenario, values).filter
    values_text = ", ".join(f"{path} = {value}" for path, value in values.items())
    cases_text = "; ".join(case.label for case in tuning_cases)
    source = (
        f"tune of {campaign.name}: {values_text}; {settings.over} of {cases_text}; requirement {name}, "
        f"by linear covariance, {evaluations} looks"
    )
    return card.model_copy(update={"name": f"{card.name}, tuned", "source": source})
