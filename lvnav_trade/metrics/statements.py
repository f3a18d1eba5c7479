"""Statements with a number: an expression of metrics by formal sigma, true error and paired runs, and its verdict."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from lvnav_trade.metrics.basics import expression
from lvnav_trade.metrics.numbers import Columns, columns, name_of
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables

HOLDS, FAILS, UNDECIDED, NOT_SET_UP = "holds", "does not hold here", "undecided", "not set up"
NUMBERS = ("formal", "true", "monte_carlo")
_LEVEL = 0.95
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
_FEWEST = 8  # runs that give an interval


class Value(NamedTuple):
    """The value of an expression three times, and the two-sided 95 % interval of that by the runs; NaN if unknown."""

    formal: float
    true: float
    monte_carlo: float
    low: float
    high: float
    runs: int
    remarks: tuple[str, ...]


def readings(
    known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]]
) -> Iterator[tuple[dict[str, str], dict[str, int]]]:
    """Yield the levels of the axes that no term names, all those of the cases in turn, and the case of each term.

    known: level of every axis of each case; wanted: levels that each term names. Where a term does not have exactly one
    case, there is no reading.
    """
    named = {axis for levels in wanted.values() for axis in levels}
    free = [axis for axis in (known[0] if known else ()) if axis not in named]
    for choice in dict.fromkeys(tuple(levels[axis] for axis in free) for levels in known):
        open_levels = dict(zip(free, choice, strict=True))
        found = {name: _matching(known, {**levels, **open_levels}) for name, levels in wanted.items()}
        if all(len(cases) == 1 for cases in found.values()):
            yield open_levels, {name: cases[0] for name, cases in found.items()}


def _matching(known: Sequence[Mapping[str, str]], levels: Mapping[str, str]) -> list[int]:
    return [k for k, one in enumerate(known) if all(one.get(axis) == level for axis, level in levels.items())]


def value_of(text: str, terms: Mapping[str, Columns]) -> Value:
    """Return the value of an expression of terms.

    The interval is Student's with the jackknife's variance over the runs, which belong together run by run; of the
    logarithm where the expression has no sums. Runs that failed in any of the terms are left out.
    """
    remarks = [one.remark for one in terms.values() if one.remark]
    formal, true, drawn = (
        float(expression.evaluate(text, {name: getattr(one, column) for name, one in terms.items()}))
        for column in NUMBERS
    )
    least = min(len(one.runs) for one in terms.values())
    each = np.stack([one.runs[:least] for one in terms.values()])
    sound = np.all(np.isfinite(each), axis=0)
    low = high = np.nan
    n = int(sound.sum())
    if n >= _FEWEST:
        if n < least:
            remarks.append(f"{least - n} of {least} runs failed and are left out")
        means, without = each[:, sound].mean(axis=1), _without(each[:, sound])
        of_terms = list(zip(terms, means, without, terms.values(), strict=True))
        drawn, others = (
            expression.evaluate(text, {name: _root(pair[k], one) for name, *pair, one in of_terms}) for k in (0, 1)
        )
        low, high = _interval(float(drawn), np.asarray(others), expression.is_product(text))
    return Value(formal, true, float(drawn), low, high, n, tuple(dict.fromkeys(remarks)))


def _without(each: Floats) -> Floats:
    """Return the mean of all runs but one, for each run: (n_term, n_run)."""
    return np.asarray((each.sum(axis=1, keepdims=True) - each) / (each.shape[1] - 1))


def _root(value: Any, one: Columns) -> Any:
    return np.sqrt(np.maximum(value, 0.0)) if one.is_root else value


def _interval(centre: float, without: Floats, is_product: bool) -> tuple[float, float]:
    if not (np.isfinite(centre) and np.all(np.isfinite(without))):
        return np.nan, np.nan
    by_logarithm = is_product and centre > 0.0 and bool(np.all(without > 0.0))
    middle, others = (np.log(centre), np.log(without)) if by_logarithm else (centre, without)
    n = len(others)
    sigma = np.sqrt((n - 1) / n * np.sum((others - others.mean()) ** 2))
    half = float(stats.t.isf(0.5 * (1.0 - _LEVEL), n - 1)) * sigma
    ends = middle - half, middle + half
    low, high = (float(np.exp(end)) if by_logarithm else float(end) for end in ends)
    return low, high


def verdict(found: Value, low: float, high: float, tested_by: Sequence[str]) -> str:
    """Return whether every number that is there lies between the bounds (NaN: none), the runs' with its interval."""
    words = []
    for name in tested_by:
        number = getattr(found, name)
        ends = (found.low, found.high) if name == "monte_carlo" and found.low == found.low else (number, number)
        if number != number:
            continue
        inside = not (ends[0] < low or ends[1] > high)
        outside = ends[1] < low or ends[0] > high
        words.append(HOLDS if inside else FAILS if outside else UNDECIDED)
    return next((word for word in (FAILS, UNDECIDED, HOLDS) if word in words), NOT_SET_UP)


def bounds(stated: Mapping[str, Any], runs: int) -> tuple[float, float]:
    """Return the bounds of a statement, NaN where there is none; runs: behind a NEES, whose upper bound they set.

    The NEES of a run is correlated from time to time: its mean over a phase has the bound of a single time.
    """
    low, high = (np.nan if stated.get(name) is None else float(stated[name]) for name in ("at_least", "at_most"))
    if stated.get("probability") is not None:
        freedom = 3.0 * max(runs, 1)
        high = float(stats.chi2.ppf(float(stated["probability"]), freedom) / freedom)
    return low, high


def rows(tables: Tables, stated: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a row of the table of references for each reading of a statement: each choice of the axes left open."""
    wanted = {
        name: {**(stated.get("case") or {}), **(term.get("case") or {})} for name, term in stated["terms"].items()
    }
    along = stated.get("along") or ""
    locus = _locus(tables, stated, wanted, along) if along else {}
    for levels, found in _read(tables, stated, wanted):
        low, high = bounds(stated, found.runs or int((tables.campaign.get("monte_carlo") or {}).get("runs") or 1))
        word = verdict(found, low, high, stated.get("tested_by") or NUMBERS)
        remarks = [str(stated.get("remark") or ""), *found.remarks]
        if not found.runs and "monte_carlo" in (stated.get("tested_by") or NUMBERS):
            remarks.append(
                "without an interval" if found.monte_carlo == found.monte_carlo else "linear covariance alone"
            )
        open_levels = tuple(sorted((axis, level) for axis, level in levels.items() if axis != along))
        crossing = where_bound(locus.get(open_levels, ()), low, high) if word != HOLDS else ""
        remarks.append(f"bound reached at {along} = {crossing}" if crossing else "")
        ours = next((v for v in (found.monte_carlo, found.true, found.formal) if v == v), np.nan)
        yield {
            **{key: str(stated.get(key) or "") for key in ("id", "source", "item")},
            "case": ", ".join(f"{axis}={level}" for axis, level in {**(stated.get("case") or {}), **levels}.items()),
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


def _read(
    tables: Tables, stated: Mapping[str, Any], wanted: Mapping[str, Mapping[str, str]]
) -> Iterator[tuple[dict[str, str], Value]]:
    cases = list(tables.levels)
    unit = str(stated.get("unit") or "-")
    for levels, chosen in readings(list(tables.levels.values()), wanted):
        terms = {name: columns(tables, cases[k], stated["terms"][name], unit) for name, k in chosen.items()}
        yield levels, value_of(str(stated["value"]), terms)


def _name(stated: Mapping[str, Any]) -> str:
    named = dict.fromkeys(name_of(term) for term in stated["terms"].values())
    return f"{stated['value']}: {'; '.join(named)}"


def locus(tables: Tables, stated: Mapping[str, Any]) -> list[tuple[str, list[tuple[str, Value]]]]:
    """Return the values of a statement along its axis, level by level, for each choice of the other axes left open."""
    wanted = {
        name: {**(stated.get("case") or {}), **(term.get("case") or {})} for name, term in stated["terms"].items()
    }
    found = _locus(tables, stated, wanted, str(stated.get("along") or ""))
    return [(", ".join(f"{axis}={level}" for axis, level in key), values) for key, values in found.items()]


def _locus(
    tables: Tables, stated: Mapping[str, Any], wanted: Mapping[str, Mapping[str, str]], along: str
) -> dict[tuple[tuple[str, str], ...], list[tuple[str, Value]]]:
    free = {name: {axis: level for axis, level in levels.items() if axis != along} for name, levels in wanted.items()}
    found: dict[tuple[tuple[str, str], ...], list[tuple[str, Value]]] = {}
    for levels, value in _read(tables, stated, free):
        others = tuple(sorted((axis, level) for axis, level in levels.items() if axis != along))
        found.setdefault(others, []).append((levels[along], value))
    return found


def where_bound(values: Sequence[tuple[str, Value]], low: float, high: float) -> str:
    """Return the level at which the true error first reaches a bound, interpolated between levels that are numbers."""
    points = [(size, value.true, level) for level, value in values if (size := _size(level)) is not None]
    points.sort()
    for (x0, y0, first), (x1, y1, _) in pairwise(points):
        for bound in (low, high):
            if (y0 - bound) * (y1 - bound) < 0.0:
                part = (bound - y0) / (y1 - y0)
                x = x0 * (x1 / x0) ** part if x0 > 0.0 else x0 + part * (x1 - x0)
                return f"{x:.3g}{_NUMBER.sub('', first, count=1)}"
    return ""


def _size(level: str) -> float | None:
    found = _NUMBER.match(level)
    return float(found[0]) if found else None
