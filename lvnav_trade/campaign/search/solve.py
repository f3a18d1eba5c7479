"""Inverse questions: the largest value of a field that still meets the requirements."""

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
from lvnav_trade.campaign.reading.spaced import Ends, ends_of
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
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.records import Floats

_CLOSE = 1e-3  # of a value: crossings are found so closely
ANSWERS = [
    "case",
    "tuning",
    "along",
    "along_unit",
    "answer",
    "unit",
    "binding",
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


class Found(NamedTuple):
    """Where a function of one variable is at most 1: the intervals in which it is, the largest value there (NaN: none),
    what binds at its upper end (empty: nothing does up to the last value), whether it is met below the answer only.
    """

    intervals: tuple[tuple[float, float], ...]
    answer: float
    binding: str
    monotone: bool


def search(ratio: Callable[[float], Mapping[str, float]], grid: Floats, log: bool, refine: bool = True) -> Found:
    """Return where the largest of several ratios is at most 1.

    ratio : ratios by name at a value; NaN where a value is not possible
    grid : (n,) values of the first look, growing; between neighbours of which one is met and the other not, the
        crossing is searched (`refine`) by Brent's method
    log : in the logarithm of the value
    """
    known: dict[float, Mapping[str, float]] = {}

    def at(value: float) -> Mapping[str, float]:
        if value not in known:
            known[value] = ratio(value)
        return known[value]

    def excess(value: float) -> float:
        found = list(at(value).values())
        return math.log(max(found)) if found and not np.isnan(found).any() and max(found) > 0.0 else math.nan

    marks = [(float(x), excess(float(x))) for x in grid]
    marks = [(x, y) for x, y in marks if not math.isnan(y)]
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
        return Found((), math.nan, _largest(at(marks[0][0])) if marks else "", True)
    monotone = len(intervals) == 1 and intervals[0][0] == marks[0][0]
    binding = "" if math.isnan(beyond) else _largest(at(beyond if not refine else _nearest(known, intervals[-1][1])))
    return Found(tuple(intervals), intervals[-1][1], binding, monotone)


def _nearest(known: Mapping[float, Any], value: float) -> float:
    return min(known, key=lambda x: abs(x - value))


def _largest(ratios: Mapping[str, float]) -> str:
    return max(ratios, key=lambda name: ratios[name])


class Solved(NamedTuple):
    """Tables `ANSWERS`, `INTERVALS`, `SCANNED`, `CONFIRMED`, what was varied (name and unit of each), and seconds."""

    answers: pd.DataFrame
    intervals: pd.DataFrame
    scanned: pd.DataFrame
    confirmed: pd.DataFrame
    names: tuple[str, ...]
    units: tuple[str, ...]
    seconds: float


def solve(campaign: Campaign, asked: Solve, jobs: int = 1) -> Solved:
    """Answer an inverse question for every case of a campaign, by linear covariance, with the filter re-tuned to each
    value and with its models as they are at the start; with `monte_carlo`, runs on both sides of each answer follow.

    InputError where a requirement or field is unknown, or no value of a field is possible.
    """
    start = time.monotonic()
    check_names(campaign, asked.meet)
    found_cases = cases(campaign)
    asked = asked.model_copy(update={"vary": tuple(_counted(one, found_cases[0]) for one in asked.vary)})
    spans = [span(vary) for vary in asked.vary]
    along = [spans[1][0].text(float(x)) for x in spans[1][1]] if len(spans) > 1 else [None]
    ways = [RETUNED] if asked.vary[0].path.startswith("filter.") else [RETUNED, FROZEN]
    units = [(campaign, asked, case, way, second) for case in found_cases for way in ways for second in along]
    parts = list(each(jobs, _one, units, ordered=True))
    answers = pd.DataFrame([part[0] for part in parts], columns=ANSWERS)
    intervals = pd.DataFrame([row for part in parts for row in part[1]], columns=INTERVALS)
    scanned = pd.DataFrame([row for part in parts for row in part[2]], columns=SCANNED)
    runs = campaign.monte_carlo.runs if campaign.monte_carlo and len(spans) == 1 else 0
    flights = [
        (campaign, asked, case, row.tuning, value, runs)
        for row in answers.itertuples()
        for case in found_cases
        if case.label == row.case and runs and np.isfinite(row.answer) and row.binding
        for value in _sides(row.answer, asked)
    ]
    confirmed = [row for rows in each(jobs, _confirm, flights, ordered=True) for row in rows]
    return Solved(
        answers,
        intervals,
        scanned,
        pd.DataFrame(confirmed, columns=CONFIRMED),
        tuple(vary.path for vary in asked.vary),
        tuple(ends.unit for ends, _ in spans),
        time.monotonic() - start,
    )


def _counted(vary: Vary, case: Case) -> Vary:
    """Return a field of whole numbers as a list of them; any other as it is."""
    value = get(case.scenario.model_dump(mode="json"), vary.path.removeprefix("base.").split("."))
    if vary.between is None or not isinstance(value, int) or isinstance(value, bool):
        return vary
    ends = span(vary)[0]
    count = min(int(abs(ends.last - ends.first)) + 1, 100)
    whole = np.unique(np.round(np.linspace(ends.first, ends.last, count))).astype(int).tolist()
    return Vary(path=vary.path, values=tuple(whole))


def span(vary: Vary) -> tuple[Ends, Floats]:
    """Return unit and values of the first look; InputError where they are no numbers of one unit."""
    try:
        if vary.values is not None:
            pairs = [ends_of((vary.values[0], one)) for one in vary.values[1:]]
            return pairs[0], np.array([pairs[0].first, *(one.last for one in pairs)])
        ends = ends_of(vary.between or ())
        part = np.linspace(0.0, 1.0, vary.points)
        if not vary.log:
            return ends, ends.first + part * (ends.last - ends.first)
        if ends.first <= 0.0:
            raise ValueError("a logarithm needs ends above zero")
        return ends, np.asarray(ends.first * (ends.last / ends.first) ** part)
    except ValueError as error:
        raise InputError(f"solve.vary: {vary.path}: {error}") from None


def _sides(answer: float, asked: Solve) -> tuple[float, ...]:
    vary = asked.vary[0]
    return () if vary.values is not None else (answer / (1.0 + asked.margin), answer * (1.0 + asked.margin))


def _scenario(asked: Solve, case: Case, way: str, second: Any, value: float) -> Any:
    values = {asked.vary[0].path: span(asked.vary[0])[0].text(value)}
    if second is not None:
        values[asked.vary[1].path] = second
    found = changed(case.scenario, values)
    return (
        with_filter(found, frozen(case.scenario)) if way == FROZEN and len(values) and not _of_filter(asked) else found
    )


def _of_filter(asked: Solve) -> bool:
    return any(vary.path.startswith("filter.") for vary in asked.vary)


def _one(
    campaign: Campaign, asked: Solve, case: Case, way: str, second: Any
) -> tuple[tuple[Any, ...], list[Any], list[Any]]:
    """Return the answer of one case, with one filter, at one value of the second field, its intervals, all looks."""
    ends, grid = span(asked.vary[0])
    seen: dict[float, Any] = {}
    impossible: list[str] = []

    def ratio(value: float) -> dict[str, float]:
        try:
            seen[value] = look(campaign, _scenario(asked, case, way, second, value), asked.meet)
        except (InputError, ValueError) as error:
            impossible.append(str(error).splitlines()[0])
            return {"": math.nan}
        return {name: one.ratio for name, one in seen[value].items()}

    found = search(ratio, grid, asked.vary[0].log, asked.vary[0].values is None)
    if not seen:
        raise InputError(f"solve: no value of {asked.vary[0].path} is possible: {impossible[0]}")
    along_unit = span(asked.vary[1])[0].unit if second is not None else ""
    along = float(str(second).partition(" ")[0]) if second is not None else math.nan
    place = (case.label, way, along, along_unit)
    rows = [
        (*place, value, ends.unit, name, *one[:2], one.unit, one.ratio, one.probability)
        for value, looked in sorted(seen.items())
        for name, one in looked.items()
    ]
    unknown = [f"{name}: {one.why}" for name, one in next(iter(seen.values())).items() if one.why]
    remark = "; ".join([*unknown, *(impossible[:1])])
    if not unknown and not found.intervals:
        remark = "met by no value; " + remark
    elif found.intervals and not found.binding:
        remark = "met up to the largest value; " + remark
    outside = not_described(one.outside for looked in seen.values() for one in looked.values())
    remark = "; ".join(part for part in (remark.removesuffix("; "), outside) if part)
    base = number_at(case.scenario, asked.vary[0].path, ends.unit)
    row = (
        *place,
        found.answer,
        ends.unit,
        found.binding,
        found.monotone,
        base,
        len(seen),
        remark,
    )
    return row, [(*place, *ends_at, ends.unit) for ends_at in found.intervals], rows


def _confirm(campaign: Campaign, asked: Solve, case: Case, way: str, value: float, runs: int) -> list[tuple[Any, ...]]:
    """Return the rows of `CONFIRMED`: what runs beside an answer say of each requirement."""
    unit = span(asked.vary[0])[0].unit
    found = confirm(campaign, _scenario(asked, case, way, None, value), asked.meet, runs)
    return [(case.label, way, value, unit, *one) for one in found]


def from_words(varied: Sequence[str], log: bool, meet: Sequence[str], least: str = "") -> Solve:
    """Return the question of ``initial.heading=0.01 deg:2 deg`` (one or two), or of the least of a total, as the
    command line states it.
    """
    found = []
    for text in varied:
        path, equals, limits = text.partition("=")
        low, colon, high = limits.partition(":")
        if not equals or not colon:
            raise InputError(
                f"--vary {quoted(text)}: should be PATH=LEAST:LARGEST, such as 'initial.heading=0.01 deg:2 deg'"
            )
        found.append(Vary(path=path.strip(), between=(low.strip(), high.strip()), log=log))
    if len(found) > 2:
        raise InputError("--vary: one or two fields")
    if least not in ("", *get_args(Total)):
        raise InputError(f"--least {quoted(least)}: should be one of {', '.join(get_args(Total))}")
    if bool(found) == bool(least) or (least and log):
        raise InputError("--vary or --least: one of them, and --log with --vary")
    return Solve(vary=tuple(found), meet=tuple(meet), least=least or None)
