"""Tornado of a design space: the error of each requirement at the ends of each axis, by regression."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.polynomial import legendre
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.design_space import CONFIDENCE, axes_of, errors_of, possible, range_text
from lvnav_trade.results.evaluation.designs import unit_of
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.case_results import number_in
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.dictionary import unit_at_end
from lvnav_trade.results.tables.read import Tables

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
    """Return the error of each requirement at both ends (or at each level) of each axis, for the bars of a tornado.

    All other axes vary over their whole ranges; no additional designs are evaluated.

    error_si: geometric mean of the error over the designs, by a regression of its logarithm on all axes at once
    (polynomials up to third degree along numeric axes). mean_si: geometric mean of all designs. low_si, high_si: 95 %
    interval of the error for randomly drawn designs, by the heteroscedasticity-robust covariance HC3. The table is
    empty for results without a design space, or with too few designs for the regression.
    """
    rows: list[tuple[Any, ...]] = []
    if tables.has_designs:
        frame = possible(tables)
        for name, column in errors_of(tables, frame).items():
            rows += [(name, *row[:-1], unit_at_end(column)[1], row[-1]) for row in _swings(frame, column)]
    frame = pd.DataFrame(rows, columns=SWINGS)
    return frame if tables.is_sampled else frame.assign(low_si=np.nan, high_si=np.nan)


def _swings(frame: pd.DataFrame, column: str) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of `swings` for one requirement; `column`: its error in the table of designs."""
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
    """An end of an axis, or a level."""

    name: str  # low or high; the level of an axis of levels
    level: str  # empty for a numeric axis
    value: float  # NaN for an axis of levels
    row: int  # index of a design that has it


class _Term(NamedTuple):
    """Term of a regression for one axis."""

    columns: Floats  # (n, k) regressors with mean zero
    ends: Sequence[_End]  # where the fit is evaluated


def _terms_of(axes: Mapping[str, pd.Series], count: int) -> dict[str, _Term]:
    """Return the terms of the axes, with the largest polynomial degree for which there are four designs per regressor.

    The result is empty if there are too few designs for the first degree.
    """
    for degree in (3, 2, 1):
        terms = {axis: _term(levels, degree) for axis, levels in axes.items()}
        if terms and 4 * (1 + sum(term.columns.shape[1] for term in terms.values())) <= count:
            return terms
    return {}


def _term(levels: pd.Series, degree: int) -> _Term:
    if pd.api.types.is_numeric_dtype(levels):
        values = levels.to_numpy(dtype=float)
        u = 2.0 * (stats.rankdata(values) - 0.5) / len(values) - 1.0  # ranks are uniform for any scale of the axis
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
    """Least-squares fit with regressors (n, k) of mean zero.

    Intervals are by the covariance estimate HC3, which is valid for unequal variances of the residuals too.
    """

    def __init__(self, columns: Floats, value: Floats) -> None:
        design = np.column_stack([np.ones(len(value)), columns])
        self.size, self._freedom = columns.shape[1], len(value) - design.shape[1]
        self._inverse = np.linalg.pinv(design)
        rest = value - design @ (self._inverse @ value)
        leverage = np.sum(design * self._inverse.T, axis=1)
        self._coefficients = (self._inverse @ value)[1:]
        self._residual = rest / np.maximum(1.0 - leverage, 1e-9)  # of a fit without the design itself

    def at(self, contrast: Floats) -> tuple[float, float]:
        """Return a linear combination of the coefficients, weights (k,), and the half-width of its 95 % interval."""
        half = stats.t.isf(0.5 * (1.0 - CONFIDENCE), self._freedom)
        weights = contrast @ self._inverse[1:]
        return float(contrast @ self._coefficients), float(half * np.linalg.norm(weights * self._residual))


def limit_of(tables: Tables, requirement: str) -> float:
    """Return the limit of the requirement with a name, in the SI unit of its metric; NaN if there is none."""
    for each in tables.campaign.get("requirements") or ():
        if each["name"] == requirement:
            return number_in(each["below"], metric_of(str(each["metric"])).unit)
    return float("nan")


def value_of(tables: Tables, end: Any) -> str:
    """Return the level of a row of `swings`, or its value in the unit of the campaign file, as text."""
    return str(end.level) or range_text(tables, str(end.axis), end.value, end.value)
