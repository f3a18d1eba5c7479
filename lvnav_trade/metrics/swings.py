"""Tornado of many designs: the error of each requirement between the ends of each axis, by a regression."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.polynomial import legendre
from scipy import stats

from lvnav_trade.metrics.basics.case import number_in
from lvnav_trade.metrics.basics.select import once
from lvnav_trade.metrics.designs import unit_of
from lvnav_trade.metrics.registry import metric_of
from lvnav_trade.metrics.space import CONFIDENCE, axes_of, errors_of, possible, range_text
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables
from lvnav_trade.store.schema import unit_at_end

SWINGS = [
    "requirement",
    "axis",
    "end",
    "level",
    "value",
    "unit",
    "error_si",
    "low_si",
    "high_si",
    "mean_si",
    "error_unit",
    "designs",
]


@once
def swings(tables: Tables) -> pd.DataFrame:
    """Return the error of each requirement at both ends of each axis, or at each of its levels, all other axes over
    their whole ranges: what the bars of a tornado show, without designs flown for it.

    error_si: the error, a geometric mean over the designs, by a regression of its logarithm on all axes at once
    (polynomials of third degree or less along numeric axes). low_si, high_si: its 95 % interval over `mean_si`, the
    geometric mean of all designs, by the regression's robust covariance (HC3), of designs that are drawn at random. No
    rows of results without many designs, or with too few for the regression.
    """
    rows: list[tuple[Any, ...]] = []
    if tables.has_designs:
        frame = possible(tables)
        for name, column in errors_of(tables, frame).items():
            rows += [(name, *row[:-1], unit_at_end(column)[1], row[-1]) for row in _swings(frame, column)]
    found = pd.DataFrame(rows, columns=SWINGS)
    return found if tables.is_sampled else found.assign(low_si=np.nan, high_si=np.nan)


def _swings(frame: pd.DataFrame, column: str) -> Iterator[tuple[Any, ...]]:
    """Yield axis, end, level, value and its unit, error and interval, geometric mean, designs of both ends of each
    axis, or of each of its levels.
    """
    error = frame[column].to_numpy(dtype=float)
    known = np.isfinite(error) & (error > 0.0) & frame[axes_of(frame)].notna().all(axis=1).to_numpy()
    designs, log = frame[known], np.log(error[known])
    axes = [axis for axis in axes_of(frame) if designs[axis].nunique() > 1]
    terms = _terms_of({axis: designs[axis] for axis in axes}, len(log))
    if not terms:
        return
    fit = _Regression(np.hstack([term.columns for term in terms.values()]), log)
    first, mean = 0, log.mean()
    for axis, term in terms.items():
        for end in term.ends:
            contrast = np.zeros(fit.size)
            contrast[first : first + term.columns.shape[1]] = term.columns[end.row]
            away, half = fit.at(contrast)
            size, low, high, middle = np.exp([mean + away, mean + away - half, mean + away + half, mean]).tolist()
            yield axis, end.name, end.level, end.value, unit_of(axis), size, low, high, middle, len(log)
        first += term.columns.shape[1]


class _End(NamedTuple):
    """An end of an axis, or a level: its name, the level or the value, and the row of a design that has it."""

    name: str
    level: str
    value: float
    row: int


class _Term(NamedTuple):
    """What stands for an axis in a regression: columns (n, k) with mean zero, and the ends that it is read at."""

    columns: Floats
    ends: Sequence[_End]


def _terms_of(axes: Mapping[str, pd.Series], count: int) -> dict[str, _Term]:
    """Return the terms of axes with polynomials of the largest degree that leaves four designs or more to a term; none
    where there is no such degree.
    """
    for degree in (3, 2, 1):
        terms = {axis: _term(levels, degree) for axis, levels in axes.items()}
        if terms and 4 * (1 + sum(term.columns.shape[1] for term in terms.values())) <= count:
            return terms
    return {}


def _term(levels: pd.Series, degree: int) -> _Term:
    if pd.api.types.is_numeric_dtype(levels):
        values = levels.to_numpy(dtype=float)
        u = 2.0 * (stats.rankdata(values) - 0.5) / len(values) - 1.0  # even along an axis whatever its scale
        columns = legendre.legvander(u, min(degree, len(np.unique(values)) - 1))[:, 1:]
        rows = {"low": int(np.argmin(values)), "high": int(np.argmax(values))}
        ends = [_End(name, "", float(values[row]), row) for name, row in rows.items()]
    else:
        names = list(dict.fromkeys(levels))
        columns = np.array([(levels == name).to_numpy(dtype=float) for name in names[1:]]).T
        places = list(levels)
        ends = [_End(str(name), str(name), np.nan, places.index(name)) for name in names]
    return _Term(columns - columns.mean(axis=0), ends)


class _Regression:
    """Least squares with columns (n, k) of mean zero; intervals by the covariance that holds for unequal spreads too
    (HC3).
    """

    def __init__(self, columns: Floats, value: Floats) -> None:
        design = np.column_stack([np.ones(len(value)), columns])
        self.size, self._freedom = columns.shape[1], len(value) - design.shape[1]
        self._inverse = np.linalg.pinv(design)
        rest = value - design @ (self._inverse @ value)
        leverage = np.sum(design * self._inverse.T, axis=1)
        self._found = (self._inverse @ value)[1:]
        self._spread = rest / np.maximum(1.0 - leverage, 1e-9)

    def at(self, contrast: Floats) -> tuple[float, float]:
        """Return a sum (k,) of coefficients, and half its 95 % interval."""
        half = stats.t.isf(0.5 * (1.0 - CONFIDENCE), self._freedom)
        weights = contrast @ self._inverse[1:]
        return float(contrast @ self._found), float(half * np.linalg.norm(weights * self._spread))


def limit_of(tables: Tables, requirement: str) -> float:
    """Return the limit of a requirement in the SI unit of its metric; NaN where none has that name."""
    for one in tables.campaign.get("requirements") or ():
        if one["name"] == requirement:
            return number_in(one["below"], metric_of(str(one["metric"])).unit)
    return float("nan")


def value_of(tables: Tables, end: Any) -> str:
    """Return the level, or the value in the unit that the campaign states, of a row of `swings`."""
    return str(end.level) or range_text(tables, str(end.axis), end.value, end.value)
