"""Inverse problems: the largest value of a field with which a case meets its requirements."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd
from scipy import optimize

from lvnav_trade.campaign.definition.axes import Case, cases, get
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Solve, Total, Vary
from lvnav_trade.campaign.reading.spaced import AxisEnds, ends_of
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import (
    FROZEN,
    RETUNED,
    changed,
    check_names,
    confirm,
    frozen,
    look,
    not_described,
    number_at,
    with_filter,
)
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import Floats

_CLOSE = 1e-3  # relative tolerance of the crossings
ANSWERS = [
    "case",
    "tuning",
    "along",
    "along_unit",
    "answer",
    "unit",
    "limiting_requirement",
    "monotone",
    "base_value",
    "evaluations",
    "remark",
]
INTERVALS = ["case", "tuning", "along", "along_unit", "least", "largest", "unit"]
SCANNED = [
    "case",
    "tuning",
    "along",
    "along_unit",
    "value",
    "unit",
    "requirement",
    "estimate",
    "limit",
    "metric_unit",
    "ratio",
    "probability",
]
CONFIRMED = ["case", "tuning", "value", "unit", "requirement", "runs", "beyond", "expected", "verdict", "agree"]


class PermittedValues(NamedTuple):
    """Values of a variable at which a function is at most 1."""

    intervals: tuple[tuple[float, float], ...]  # intervals in which it is
    answer: float  # largest value in the intervals; NaN if there is none
    limiting_requirement: str  # at the upper end; empty if there is no limit up to the last value
    monotone: bool  # whether the function is at most 1 for all values below the answer


def search(
    ratio: Callable[[float], Mapping[str, float]], grid: Floats, log: bool, refine: bool = True
) -> PermittedValues:
    """Find the values of a variable at which the largest of several ratios is at most 1.

    Parameters
    ----------
    ratio : callable
        Returns the ratios by name for a value; NaN if the value is not possible.
    grid : (n,) array
        Increasing values to evaluate first. Between neighbours on different sides of 1, Brent's method finds the
        crossing.
    log : bool
        Search in the logarithm of the value.
    refine : bool
        Find the crossings; if not, the last grid value that is met is the end of an interval.

    Returns
    -------
    PermittedValues
        Intervals, largest value, limiting ratio.
    """
    cache: dict[float, Mapping[str, float]] = {}

    def at(value: float) -> Mapping[str, float]:
        if value not in cache:
            cache[value] = ratio(value)
        return cache[value]

    def excess(value: float) -> float:
        ratios = list(at(value).values())
        return math.log(max(ratios)) if ratios and not np.isnan(ratios).any() and max(ratios) > 0.0 else math.nan

    marks = [(x, y) for x in map(float, grid) if not math.isnan(y := excess(x))]
    intervals: list[tuple[float, float]] = []
    begin = marks[0][0] if marks and marks[0][1] <= 0.0 else None
    beyond = math.nan
    way: Callable[[float], float] = math.exp if log else float
    for (x0, y0), (x1, y1) in pairwise(marks):
        if (y0 <= 0.0) == (y1 <= 0.0):
            continue
        if refine:
            ends = (math.log(x0), math.log(x1)) if log else (x0, x1)
            tolerance = _CLOSE if log else _CLOSE * max(abs(x0), abs(x1))
            cross = way(float(optimize.brentq(lambda u: excess(way(u)), *ends, xtol=0.3 * tolerance)))
        else:
            cross = x0 if y0 <= 0.0 else x1
        if y0 <= 0.0 and begin is not None:
            intervals.append((begin, cross))
            begin, beyond = None, x1
        else:
            begin = cross
    if begin is not None:
        intervals.append((begin, marks[-1][0]))
        beyond = math.nan
    if not intervals:
        return PermittedValues((), math.nan, _largest(at(marks[0][0])) if marks else "", True)
    monotone = len(intervals) == 1 and intervals[0][0] == marks[0][0]
    limiting = "" if math.isnan(beyond) else _largest(at(beyond if not refine else _nearest(cache, intervals[-1][1])))
    return PermittedValues(tuple(intervals), intervals[-1][1], limiting, monotone)


def _nearest(evaluated: Mapping[float, Any], value: float) -> float:
    """Return the evaluated value nearest to a value."""
    return min(evaluated, key=lambda x: abs(x - value))


def _largest(ratios: Mapping[str, float]) -> str:
    return max(ratios, key=lambda name: ratios[name])


class InverseSolution(NamedTuple):
    """Solution of an inverse problem."""

    answers: pd.DataFrame  # largest values, columns `ANSWERS`
    intervals: pd.DataFrame  # intervals in which the requirements are met, columns `INTERVALS`
    scanned: pd.DataFrame  # all evaluations, columns `SCANNED`
    confirmed: pd.DataFrame  # confirmation by runs, columns `CONFIRMED`
    names: tuple[str, ...]  # paths of the varied fields
    units: tuple[str, ...]  # their units
    seconds: float  # wall time, s


def solve(campaign: Campaign, problem: Solve, jobs: int = 1) -> InverseSolution:
    """Solve an inverse problem for every case of a campaign, by linear covariance.

    Each problem is solved with the filter re-tuned to every value, and with its models frozen at those of the case. If
    the campaign has Monte Carlo, runs on both sides of each solution confirm it.

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
    InverseSolution
        Tables of the solutions.

    Raises
    ------
    InputError
        A requirement or field is unknown, or no value of a field is possible.
    """
    start = time.monotonic()
    check_names(campaign, problem.meet)
    all_cases = cases(campaign)
    problem = problem.model_copy(update={"vary": tuple(_counted(vary, all_cases[0]) for vary in problem.vary)})
    spans = [span(vary) for vary in problem.vary]
    along = [spans[1][0].text(float(x)) for x in spans[1][1]] if len(spans) > 1 else [None]
    ways = [RETUNED] if problem.vary[0].path.startswith("filter.") else [RETUNED, FROZEN]
    items = [(campaign, problem, case, way, second) for case in all_cases for way in ways for second in along]
    parts = list(each(jobs, _solve_case, items, ordered=True))
    answers = pd.DataFrame([result[0] for result in parts], columns=ANSWERS)
    intervals = pd.DataFrame([row for result in parts for row in result[1]], columns=INTERVALS)
    scanned = pd.DataFrame([row for result in parts for row in result[2]], columns=SCANNED)
    runs = campaign.monte_carlo.runs if campaign.monte_carlo and len(spans) == 1 else 0
    flights = [
        (campaign, problem, case, row.tuning, value, runs)
        for row in answers.itertuples()
        for case in all_cases
        if case.label == row.case and runs and np.isfinite(row.answer) and row.limiting_requirement
        for value in _sides(row.answer, problem)
    ]
    confirmed = [row for rows in each(jobs, _confirm, flights, ordered=True) for row in rows]
    return InverseSolution(
        answers,
        intervals,
        scanned,
        pd.DataFrame(confirmed, columns=CONFIRMED),
        tuple(vary.path for vary in problem.vary),
        tuple(ends.unit for ends, _ in spans),
        time.monotonic() - start,
    )


def _counted(vary: Vary, case: Case) -> Vary:
    """Return the variation of an integer field as a list of whole numbers; any other variation unchanged."""
    value = get(case.scenario.model_dump(mode="json"), vary.path.removeprefix("base.").split("."))
    if vary.between is None or not isinstance(value, int) or isinstance(value, bool):
        return vary
    ends = span(vary)[0]
    count = min(int(abs(ends.last - ends.first)) + 1, 100)
    integers = np.unique(np.round(np.linspace(ends.first, ends.last, count))).astype(int).tolist()
    return Vary(path=vary.path, values=tuple(integers))


def span(vary: Vary) -> tuple[AxisEnds, Floats]:
    """Return the ends and the grid values (n,) of a variation; InputError unless all have the same unit."""
    try:
        if vary.values is not None:
            pairs = [ends_of((vary.values[0], value)) for value in vary.values[1:]]
            return pairs[0], np.array([pairs[0].first, *(pair.last for pair in pairs)])
        ends = ends_of(vary.between or ())
        fraction = np.linspace(0.0, 1.0, vary.points)
        if not vary.log:
            return ends, ends.first + fraction * (ends.last - ends.first)
        if ends.first <= 0.0:
            raise ValueError("a logarithm needs ends above zero")
        return ends, np.asarray(ends.first * (ends.last / ends.first) ** fraction)
    except ValueError as error:
        raise InputError(f"solve.vary: {vary.path}: {error}") from None


def _sides(answer: float, problem: Solve) -> tuple[float, ...]:
    """Return values just below and above a solution, at which runs confirm it."""
    vary = problem.vary[0]
    return () if vary.values is not None else (answer / (1.0 + problem.margin), answer * (1.0 + problem.margin))


def _scenario(problem: Solve, case: Case, way: str, second: Any, value: float) -> Any:
    values = {problem.vary[0].path: span(problem.vary[0])[0].text(value)}
    if second is not None:
        values[problem.vary[1].path] = second
    scenario = changed(case.scenario, values)
    is_frozen = way == FROZEN and len(values) and not _of_filter(problem)
    return with_filter(scenario, frozen(case.scenario)) if is_frozen else scenario


def _of_filter(problem: Solve) -> bool:
    return any(vary.path.startswith("filter.") for vary in problem.vary)


def _solve_case(
    campaign: Campaign, problem: Solve, case: Case, way: str, second: Any
) -> tuple[tuple[Any, ...], list[Any], list[Any]]:
    """Return the rows of `ANSWERS`, `INTERVALS` and `SCANNED` for a case, a filter and a value of the second field."""
    ends, grid = span(problem.vary[0])
    evaluated: dict[float, Any] = {}
    impossible: list[str] = []

    def ratio(value: float) -> dict[str, float]:
        try:
            evaluated[value] = look(campaign, _scenario(problem, case, way, second, value), problem.meet)
        except (InputError, ValueError) as error:
            impossible.append(str(error).splitlines()[0])
            return {"": math.nan}
        return {name: result.ratio for name, result in evaluated[value].items()}

    solution = search(ratio, grid, problem.vary[0].log, problem.vary[0].values is None)
    if not evaluated:
        raise InputError(f"solve: no value of {problem.vary[0].path} is possible: {impossible[0]}")
    along_unit = span(problem.vary[1])[0].unit if second is not None else ""
    along = float(str(second).partition(" ")[0]) if second is not None else math.nan
    place = (case.label, way, along, along_unit)
    rows = [
        (*place, value, ends.unit, name, *result[:2], result.unit, result.ratio, result.probability)
        for value, looked in sorted(evaluated.items())
        for name, result in looked.items()
    ]
    unknown = [f"{name}: {result.why}" for name, result in next(iter(evaluated.values())).items() if result.why]
    remark = "; ".join([*unknown, *(impossible[:1])])
    if not unknown and not solution.intervals:
        remark = "met by no value; " + remark
    elif solution.intervals and not solution.limiting_requirement:
        remark = "met up to the largest value; " + remark
    outside = not_described(result.outside for looked in evaluated.values() for result in looked.values())
    remark = "; ".join(text for text in (remark.removesuffix("; "), outside) if text)
    base = number_at(case.scenario, problem.vary[0].path, ends.unit)
    row = (
        *place,
        solution.answer,
        ends.unit,
        solution.limiting_requirement,
        solution.monotone,
        base,
        len(evaluated),
        remark,
    )
    return row, [(*place, *ends_at, ends.unit) for ends_at in solution.intervals], rows


def _confirm(
    campaign: Campaign, problem: Solve, case: Case, way: str, value: float, runs: int
) -> list[tuple[Any, ...]]:
    """Return the rows of `CONFIRMED`: verdicts of runs at a value close to a solution."""
    unit = span(problem.vary[0])[0].unit
    rows = confirm(campaign, _scenario(problem, case, way, None, value), problem.meet, runs)
    return [(case.label, way, value, unit, *row) for row in rows]


def from_words(varied: Sequence[str], log: bool, meet: Sequence[str], least: str = "") -> Solve:
    """Return the inverse problem given on the command line.

    Parameters
    ----------
    varied : sequence of str
        One or two fields with their ranges, such as ``initial.heading=0.01 deg:2 deg``.
    log : bool
        Search in the logarithm.
    meet : sequence of str
        Names of the requirements; all if empty.
    least : str
        Total to minimise, in place of fields to vary.

    Returns
    -------
    Solve
        The problem.

    Raises
    ------
    InputError
        A text is not valid, or the arguments do not fit together.
    """
    ranges = []
    for text in varied:
        path, equals, limits = text.partition("=")
        low, colon, high = limits.partition(":")
        if not equals or not colon:
            raise InputError(
                f"--vary {quoted(text)}: should be PATH=LEAST:LARGEST, such as 'initial.heading=0.01 deg:2 deg'"
            )
        ranges.append(Vary(path=path.strip(), between=(low.strip(), high.strip()), log=log))
    if len(ranges) > 2:
        raise InputError("--vary: give one or two fields")
    if least not in ("", *get_args(Total)):
        raise InputError(f"--least {quoted(least)}: should be one of {', '.join(get_args(Total))}")
    if bool(ranges) == bool(least) or (least and log):
        raise InputError("give either --vary or --least; --log belongs to --vary")
    return Solve(vary=tuple(ranges), meet=tuple(meet), least=least or None)
