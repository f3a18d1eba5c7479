"""Statements with a number: expressions of metrics of cases, read for every choice of the axes that they leave open."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import stats

from lvnav_studies.cases import matching_cases, readings
from lvnav_trade.api.input import parse
from lvnav_trade.api.measures import (
    HOLDS,
    NUMBERS,
    REACQUIRED,
    ExpressionValue,
    MetricValue,
    Tables,
    axes_of,
    cases_of,
    difference,
    evaluate,
    marks,
    members,
    name_of,
    reacquisition_times,
    value_of,
    verdict,
)

NOT_RUN = "not run"
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
_BASE = "base"  # level of an axis that is not varied

Choice = tuple[tuple[str, str], ...]
"""Levels of the open axes, as sorted pairs of axis and level."""

LevelValues = list[tuple[str, ExpressionValue]]
"""Levels of an axis with the value of a statement at each."""


def bounds(statement: Mapping[str, Any], runs: int) -> tuple[float, float]:
    """Return the bounds of a statement, NaN for none.

    runs : number of runs, which sets the bounds of a NEES or of a ratio of root mean squares

    The NEES of a run is correlated from time to time: its mean over a phase has the bound of a single time.
    """
    if statement.get("at_least") is None:
        low = np.nan
    else:
        low = float(statement["at_least"])
    if statement.get("at_most") is None:
        high = np.nan
    else:
        high = float(statement["at_most"])
    n = max(runs, 1)
    if statement.get("probability") is not None:
        freedom = 3.0 * n
        quantile = stats.chi2.ppf(float(statement["probability"]), freedom)
        high = float(quantile / freedom)
    if statement.get("of_runs") is not None:
        probability = float(statement["of_runs"])
        low_quantile = stats.chi2.ppf(0.5 * (1.0 - probability), n)
        high_quantile = stats.chi2.ppf(0.5 * (1.0 + probability), n)
        low = float(np.sqrt(low_quantile / n))
        high = float(np.sqrt(high_quantile / n))
    return low, high


def rows(tables: Tables, statement: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of references for each reading of a statement: each choice of the axes left open."""
    axis_name = statement.get("along") or ""
    tested_by = statement.get("tested_by") or NUMBERS
    term_levels = _term_levels(statement)
    values_along = _values_along(tables, statement, axis_name) if axis_name else {}
    planned_runs = int((tables.campaign.get("monte_carlo") or {}).get("runs") or 1)
    is_read = False
    for levels, value in _read_values(tables, statement, term_levels):
        is_read = True
        low, high = bounds(statement, value.runs or planned_runs)
        tested_value = value
        if statement.get("of_runs") is not None:  # these bounds include the interval of the runs
            tested_value = value._replace(low=np.nan, high=np.nan)
        word = verdict(tested_value, low, high, tested_by)
        remarks = [str(statement.get("remark") or ""), *value.remarks]
        if not value.runs and "monte_carlo" in tested_by:
            remarks.append("linear covariance alone" if np.isnan(value.monte_carlo) else "without an interval")
        if word != HOLDS:
            choice = tuple(sorted((axis, level) for axis, level in levels.items() if axis != axis_name))
            crossing = bound_crossing(values_along.get(choice, ()), low, high, tested_by)
            if crossing:
                remarks.append(f"bound reached at {axis_name} = {crossing}")
        yield {
            **_identity_cells(statement),
            "case": case_text(statement.get("case") or {}, levels),
            "metric": _metric_text(statement),
            "unit": statement.get("unit") or "-",
            **{key: getattr(value, key) for key in (*NUMBERS, "low", "high")},
            "ours": _best_number(value),
            "band_low": low,
            "band_high": high,
            "in_band": word == HOLDS,
            "verdict": word,
            "remark": "; ".join(dict.fromkeys(remark for remark in remarks if remark)),
        }
    if not is_read:
        yield {
            **_identity_cells(statement),
            "case": "",
            "metric": _metric_text(statement),
            "unit": statement.get("unit") or "-",
            "in_band": False,
            "verdict": NOT_RUN,
            "remark": "its cases are not among the results",
        }


def _term_levels(statement: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the levels that each term names, with those of the whole statement."""
    common = statement.get("case") or {}
    term_levels = {}
    for name, term in statement["terms"].items():
        levels_of_term = term.get("case") or {}
        term_levels[name] = {**common, **levels_of_term}
    return term_levels


def _best_number(value: ExpressionValue) -> float:
    """Return the number by the runs, or else by linear covariance, or else by formal sigma."""
    for number in (value.monte_carlo, value.true, value.formal):
        if not np.isnan(number):
            return number
    return np.nan


def _identity_cells(statement: Mapping[str, Any]) -> dict[str, str]:
    cells = {key: str(statement.get(key) or "") for key in ("id", "source", "item")}
    return cells | marks(statement, "statement")


def case_text(statement_levels: Mapping[str, str], levels: Mapping[str, str]) -> str:
    """Return the levels that a statement names and those of a reading as text, without axes at the base."""
    varied_levels = {axis: level for axis, level in levels.items() if level != _BASE}
    named_levels = {**statement_levels, **varied_levels}
    text = ", ".join(f"{axis}={level}" for axis, level in named_levels.items())
    if text:
        return text
    return _BASE if levels else ""


def _read_values(
    tables: Tables, statement: Mapping[str, Any], term_levels: Mapping[str, Mapping[str, str]]
) -> Iterator[tuple[dict[str, str], ExpressionValue]]:
    """Yield the levels of the open axes and the value of a statement, for each of its readings."""
    cases = list(tables.levels)
    case_levels = list(tables.levels.values())
    unit = str(statement.get("unit") or "-")
    complete_levels = {}
    for name, levels in term_levels.items():
        first_levels = _first_levels(case_levels, statement["terms"][name])
        complete_levels[name] = {**levels, **first_levels}
    for levels, case_numbers in readings(case_levels, complete_levels):
        terms = {}
        for name, number in case_numbers.items():
            case = cases[number]
            term = statement["terms"][name]
            terms[name] = _term_value(tables, case, term, unit)
        yield levels, value_of(str(statement["value"]), terms)


def _first_levels(case_levels: Sequence[Mapping[str, str]], term: Mapping[str, Any]) -> dict[str, str]:
    """Return the first levels of the axes over which a term takes the median or all runs; they represent all levels."""
    if not case_levels:
        return {}
    axes = list(axes_of(term))
    if term.get("over"):
        axes.append(str(term["over"]))
    return {axis: case_levels[0][axis] for axis in axes}


def _term_value(tables: Tables, case: str, term: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the numbers of a term: of its case, or the median over all levels of an axis."""
    median_axis = str(term.get("over") or "")
    if term.get("minus") is not None:
        subtracted_levels = {**tables.levels[case], **term["minus"]}
        subtracted_cases = cases_of(tables, subtracted_levels, ())
        if not subtracted_cases:
            return MetricValue(remark="no such case")
        return difference(tables, case, subtracted_cases[0], term, unit)
    if not median_axis:
        return _case_value(tables, case, term, unit)
    fixed_levels = {axis: level for axis, level in tables.levels[case].items() if axis != median_axis}
    cases = [name for name, levels in tables.levels.items() if fixed_levels.items() <= levels.items()]
    if term["metric"] == REACQUIRED:
        instant = str(term.get("at") or "injection")
        times = np.concatenate([reacquisition_times(tables, member, instant) for member in cases])
        scale = parse(f"1 {unit}", "s") if unit != "-" else 1.0
        return MetricValue(
            true=float(np.median(times)) / scale,
            remark=f"median of {len(times)} acquisitions",
        )
    values = [evaluate(tables, member, term, unit) for member in cases]
    formal = np.median([value.formal for value in values])
    true = np.median([value.true for value in values])
    monte_carlo = np.median([value.monte_carlo for value in values])
    return MetricValue(
        formal=float(formal),
        true=float(true),
        monte_carlo=float(monte_carlo),
        remark=f"median of {len(values)} cases",
    )


def _case_value(tables: Tables, case: str, term: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the numbers of a term of one case or pool."""
    value = evaluate(tables, case, term, unit)
    if term.get("statistic") == "formal":  # one number, whatever it is compared with
        square = value.formal**2
        value = value._replace(
            true=value.formal,
            monte_carlo=value.formal,
            runs=np.full(len(value.runs), square),
            levels=np.full(len(value.levels), square),
        )
    pool = axes_of(term)
    if not pool:
        return value
    pool_remark = f"{len(members(tables, case, pool))} levels of {', '.join(pool)} together"
    return value._replace(remark=f"{value.remark}; {pool_remark}" if value.remark else pool_remark)


def _metric_text(statement: Mapping[str, Any]) -> str:
    names = dict.fromkeys(name_of(term) for term in statement["terms"].values())
    name_list = "; ".join(names)
    return f"{statement['value']}: {name_list}"


def locus(tables: Tables, statement: Mapping[str, Any]) -> list[tuple[str, LevelValues]]:
    """Return the values of a statement along its axis, level by level, for each choice of the other axes left open."""
    axis_name = str(statement.get("along") or "")
    values_by_choice = []
    for choice, values in _values_along(tables, statement, axis_name).items():
        text = ", ".join(f"{axis}={level}" for axis, level in choice)
        values_by_choice.append((text, values))
    return values_by_choice


def _values_along(tables: Tables, statement: Mapping[str, Any], axis_name: str) -> dict[Choice, LevelValues]:
    """Return the values of `locus`, by the levels of the other open axes.

    A term that names another level of the axis than the statement is the reference of the comparison: it stays at its
    level. So does a term without a case at the level of the others.
    """
    case_levels = list(tables.levels.values())
    term_levels = _term_levels(statement)
    level_by_term = {name: levels[axis_name] for name, levels in term_levels.items() if axis_name in levels}
    first_level = next(iter(level_by_term.values()), None)
    levels_of_statement = statement.get("case") or {}
    statement_level = levels_of_statement.get(axis_name, first_level)
    fixed_terms = {name for name, level in level_by_term.items() if level != statement_level}
    values_by_choice: dict[Choice, LevelValues] = {}
    levels_along = dict.fromkeys(levels[axis_name] for levels in case_levels)
    for level in levels_along:
        moved_terms = {}
        for name, levels in term_levels.items():
            levels_there = {**levels, axis_name: level}
            if name not in fixed_terms and matching_cases(case_levels, levels_there):
                moved_terms[name] = levels_there
        if moved_terms:
            moved_levels = {**term_levels, **moved_terms}
            for levels, value in _read_values(tables, statement, moved_levels):
                choice = tuple(sorted(levels.items()))
                values_by_choice.setdefault(choice, []).append((level, value))
    return values_by_choice


def bound_crossing(
    values: Sequence[tuple[str, ExpressionValue]], low: float, high: float, tested_by: Sequence[str] = ("true",)
) -> str:
    """Return the level at which the true error first reaches a bound, interpolated between levels that are numbers.

    If it never does, the level and the name of another tested number that does; empty if none does.
    """
    points = []
    for level, value in values:
        number = _NUMBER.match(level)
        if number:
            x = float(number[0])
            points.append((x, value, level))
    points.sort(key=lambda point: point[0])
    for name in sorted(tested_by, key=lambda name: name != "true"):
        for (x0, first, level), (x1, second, _) in pairwise(points):
            y0 = getattr(first, name)
            y1 = getattr(second, name)
            for bound in (low, high):
                is_crossed = (y0 - bound) * (y1 - bound) < 0.0
                if is_crossed:
                    fraction = (bound - y0) / (y1 - y0)
                    # positive levels are mostly spaced by factors: interpolate their logarithm
                    if x0 > 0.0:
                        x = x0 * (x1 / x0) ** fraction
                    else:
                        x = x0 + fraction * (x1 - x0)
                    unit = _NUMBER.sub("", level, count=1)
                    suffix = "" if name == "true" else f" ({name.replace('_', ' ')})"
                    return f"{x:.3g}{unit}{suffix}"
    return ""
