"""Statements with a number: expressions of metrics of cases, read for every choice of the axes that they leave open."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import stats

from lvnav_studies.cases import matching, readings
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

NOT_FLOWN = "not flown"
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
_BASE = "base"  # level of an axis that is not varied


def bounds(stated: Mapping[str, Any], runs: int) -> tuple[float, float]:
    """Return the bounds of a statement, NaN where there is none; runs: behind a NEES or a ratio of root mean squares,
    whose bounds they set.

    The NEES of a run is correlated from time to time: its mean over a phase has the bound of a single time.
    """
    low, high = (np.nan if stated.get(name) is None else float(stated[name]) for name in ("at_least", "at_most"))
    if stated.get("probability") is not None:
        freedom = 3.0 * max(runs, 1)
        high = float(stats.chi2.ppf(float(stated["probability"]), freedom) / freedom)
    if stated.get("of_runs") is not None:
        tails = 0.5 * (1.0 - float(stated["of_runs"])), 0.5 * (1.0 + float(stated["of_runs"]))
        low, high = (float(np.sqrt(stats.chi2.ppf(tail, max(runs, 1)) / max(runs, 1))) for tail in tails)
    return low, high


def rows(tables: Tables, stated: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of references for each reading of a statement: each choice of the axes left open."""
    wanted = {
        name: {**(stated.get("case") or {}), **(term.get("case") or {})} for name, term in stated["terms"].items()
    }
    along = stated.get("along") or ""
    locus = _locus(tables, stated, wanted, along) if along else {}
    found_any = False
    for levels, found in _read(tables, stated, wanted):
        found_any = True
        low, high = bounds(stated, found.runs or int((tables.campaign.get("monte_carlo") or {}).get("runs") or 1))
        tested = found if stated.get("of_runs") is None else found._replace(low=np.nan, high=np.nan)
        word = verdict(tested, low, high, stated.get("tested_by") or NUMBERS)  # bounds of the runs have their interval
        remarks = [str(stated.get("remark") or ""), *found.remarks]
        if not found.runs and "monte_carlo" in (stated.get("tested_by") or NUMBERS):
            remarks.append(
                "without an interval" if found.monte_carlo == found.monte_carlo else "linear covariance alone"
            )
        open_levels = tuple(sorted((axis, level) for axis, level in levels.items() if axis != along))
        names = stated.get("tested_by") or NUMBERS
        crossing = where_bound(locus.get(open_levels, ()), low, high, names) if word != HOLDS else ""
        remarks.append(f"bound reached at {along} = {crossing}" if crossing else "")
        ours = next((v for v in (found.monte_carlo, found.true, found.formal) if v == v), np.nan)
        yield {
            **_named(stated),
            "case": case_named(stated.get("case") or {}, levels),
            "metric": _name(stated),
            "unit": stated.get("unit") or "-",
            **{key: getattr(found, key) for key in (*NUMBERS, "low", "high")},
            "ours": ours,
            "band_low": low,
            "band_high": high,
            "in_band": word == HOLDS,
            "verdict": word,
            "remark": "; ".join(dict.fromkeys(remark for remark in remarks if remark)),
        }
    if not found_any:
        missing = {"case": "", "metric": _name(stated), "unit": stated.get("unit") or "-", "in_band": False}
        yield {**_named(stated), **missing, "verdict": NOT_FLOWN, "remark": "its cases are not among the results"}


def _named(stated: Mapping[str, Any]) -> dict[str, str]:
    return {key: str(stated.get(key) or "") for key in ("id", "source", "item")} | marks(stated, "statement")


def case_named(stated: Mapping[str, str], levels: Mapping[str, str]) -> str:
    """Return the levels that a statement names, and those it is read at; of many axes, each varied alone, the one."""
    off = {axis: level for axis, level in levels.items() if level != _BASE}
    named = ", ".join(f"{axis}={level}" for axis, level in {**stated, **off}.items())
    return named or (_BASE if levels else "")


def _read(
    tables: Tables, stated: Mapping[str, Any], wanted: Mapping[str, Mapping[str, str]]
) -> Iterator[tuple[dict[str, str], ExpressionValue]]:
    cases = list(tables.levels)
    unit = str(stated.get("unit") or "-")
    known = list(tables.levels.values())
    whole = {name: {**levels, **_first(known, stated["terms"][name])} for name, levels in wanted.items()}
    for levels, chosen in readings(known, whole):
        terms = {name: _over(tables, cases[k], stated["terms"][name], unit) for name, k in chosen.items()}
        yield levels, value_of(str(stated["value"]), terms)


def _first(known: Sequence[Mapping[str, str]], term: Mapping[str, Any]) -> dict[str, str]:
    """Return the first levels of the axes over which a term takes the median or all runs: they stand for all levels."""
    axes = [axis for axis in (str(term.get("over") or ""), *axes_of(term)) if axis]
    return {axis: known[0][axis] for axis in axes} if known else {}


def _over(tables: Tables, case: str, term: Mapping[str, Any], unit: str) -> MetricValue:
    """Return the numbers of a term: of its case, or the median over all levels of an axis."""
    over = str(term.get("over") or "")
    if term.get("minus") is not None:
        wanted = {**tables.levels[case], **term["minus"]}
        others = cases_of(tables, wanted, ())
        return difference(tables, case, others[0], term, unit) if others else MetricValue(remark="no such case")
    if not over:
        whole = evaluate(tables, case, term, unit)
        if term.get("statistic") == "formal":  # one number, whatever it is compared with
            each, level = (np.full(len(one), whole.formal**2) for one in (whole.runs, whole.levels))
            whole = whole._replace(true=whole.formal, monte_carlo=whole.formal, runs=each, levels=level)
        together = len(members(tables, case, axes_of(term))) if axes_of(term) else 0
        words = f"{together} levels of {', '.join(axes_of(term))} together" if together else ""
        return whole._replace(remark="; ".join(text for text in (whole.remark, words) if text))
    mine = {axis: level for axis, level in tables.levels[case].items() if axis != over}
    cases = [other for other, levels in tables.levels.items() if mine.items() <= levels.items()]
    if term["metric"] == REACQUIRED:
        times = np.concatenate([reacquisition_times(tables, one, str(term.get("at") or "injection")) for one in cases])
        scale = parse(f"1 {unit}", "s") if unit != "-" else 1.0
        return MetricValue(np.nan, float(np.median(times)) / scale, np.nan, f"median of {len(times)} acquisitions")
    found = [evaluate(tables, one, term, unit) for one in cases]
    formal, true, runs = (float(np.median([getattr(one, number) for one in found])) for number in NUMBERS)
    return MetricValue(formal, true, runs, f"median of {len(found)} cases")


def _name(stated: Mapping[str, Any]) -> str:
    named = dict.fromkeys(name_of(term) for term in stated["terms"].values())
    return f"{stated['value']}: {'; '.join(named)}"


def locus(tables: Tables, stated: Mapping[str, Any]) -> list[tuple[str, list[tuple[str, ExpressionValue]]]]:
    """Return the values of a statement along its axis, level by level, for each choice of the other axes left open."""
    wanted = {
        name: {**(stated.get("case") or {}), **(term.get("case") or {})} for name, term in stated["terms"].items()
    }
    found = _locus(tables, stated, wanted, str(stated.get("along") or ""))
    return [(", ".join(f"{axis}={level}" for axis, level in key), values) for key, values in found.items()]


def _locus(
    tables: Tables, stated: Mapping[str, Any], wanted: Mapping[str, Mapping[str, str]], along: str
) -> dict[tuple[tuple[str, str], ...], list[tuple[str, ExpressionValue]]]:
    known = list(tables.levels.values())
    named = {name: levels[along] for name, levels in wanted.items() if along in levels}
    here = (stated.get("case") or {}).get(along, next(iter(named.values()), None))
    fixed = {name for name, level in named.items() if level != here}  # what the others are held against
    found: dict[tuple[tuple[str, str], ...], list[tuple[str, ExpressionValue]]] = {}
    for level in dict.fromkeys(levels[along] for levels in known):
        moved = {name: {**levels, along: level} for name, levels in wanted.items() if name not in fixed}
        there = {name: levels for name, levels in moved.items() if matching(known, levels)}
        if there:  # a term that has no case there stays where it is
            asked = {**wanted, **there}
            for levels, value in _read(tables, stated, asked):
                found.setdefault(tuple(sorted(levels.items())), []).append((level, value))
    return found


def where_bound(
    values: Sequence[tuple[str, ExpressionValue]], low: float, high: float, tested_by: Sequence[str] = ("true",)
) -> str:
    """Return the level at which the true error first reaches a bound, interpolated between levels that are numbers; if
    it never does, that at which another of the numbers that are tested does, and which.
    """
    points = [(size, value, level) for level, value in values if (size := _size(level)) is not None]
    points.sort(key=lambda point: point[0])
    for name in sorted(tested_by, key=lambda name: name != "true"):
        for (x0, first, level), (x1, second, _) in pairwise(points):
            y0, y1 = getattr(first, name), getattr(second, name)
            for bound in (low, high):
                if (y0 - bound) * (y1 - bound) < 0.0:
                    part = (bound - y0) / (y1 - y0)
                    x = x0 * (x1 / x0) ** part if x0 > 0.0 else x0 + part * (x1 - x0)
                    which = "" if name == "true" else f" ({name.replace('_', ' ')})"
                    return f"{x:.3g}{_NUMBER.sub('', level, count=1)}{which}"
    return ""


def _size(level: str) -> float | None:
    found = _NUMBER.match(level)
    return float(found[0]) if found else None
