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
from lvnav_trade.results.statistics.case_results import parse_number
from lvnav_trade.results.statistics.select import cache_result
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


@cache_result
def swings(tables: Tables) -> pd.DataFrame:
    """Return the error of each requirement at both ends (or at each level) of each axis, for the bars of a tornado.

    All other axes vary over their whole ranges; no additional designs are evaluated.

    error_si: geometric mean of the error over the designs, by a regression of its logarithm on all axes at once
    (polynomials up to third degree along numeric axes). mean_si: geometric mean of all designs. low_si, high_si: 95 %
    interval of the error for randomly drawn designs, by the heteroscedasticity-robust covariance HC3. The table is
    empty for results without a design space, or with too few designs for the regression.
    """
    rows: list[dict[str, Any]] = []
    if tables.has_designs:
        frame = possible(tables)
        for name, column in errors_of(tables, frame).items():
            for row in _requirement_swings(frame, column):
                rows.append({"requirement": name, **row})
    frame = pd.DataFrame(rows, columns=SWINGS)
    if tables.is_sampled:
        return frame
    return frame.assign(low_si=np.nan, high_si=np.nan)


def _requirement_swings(frame: pd.DataFrame, column: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of `swings` for one requirement; `column`: its error in the table of designs."""
    error = frame[column].to_numpy(dtype=float)
    has_levels = frame[axes_of(frame)].notna().all(axis=1).to_numpy()
    is_usable = np.isfinite(error) & (error > 0.0) & has_levels
    designs = frame[is_usable]
    log_error = np.log(error[is_usable])
    varied_axes = [axis for axis in axes_of(frame) if designs[axis].nunique() > 1]
    terms = _regression_terms({axis: designs[axis] for axis in varied_axes}, len(log_error))
    if not terms:
        return
    fit = _Regression(np.hstack([term.columns for term in terms.values()]), log_error)
    first = 0
    mean = log_error.mean()
    for axis, term in terms.items():
        last = first + term.columns.shape[1]
        for end in term.ends:
            weights = np.zeros(fit.size)
            weights[first:last] = term.columns[end.row]
            deviation, half = fit.linear_combination(weights)
            size, low, high, mean_size = np.exp(
                [mean + deviation, mean + deviation - half, mean + deviation + half, mean]
            ).tolist()
            yield {
                "axis": axis,
                "end": end.name,
                "level": end.level,
                "value": end.value,
                "unit": unit_of(axis),
                "error_si": size,
                "low_si": low,
                "high_si": high,
                "mean_si": mean_size,
                "error_unit": unit_at_end(column)[1],
                "designs": len(log_error),
            }
        first = last


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


def _regression_terms(axes: Mapping[str, pd.Series], count: int) -> dict[str, _Term]:
    """Return the terms of the axes, with the largest polynomial degree for which there are four designs per regressor.

    The result is empty if there are too few designs for the first degree.
    """
    for degree in (3, 2, 1):
        terms = {}
        n_regressor = 1
        for axis, levels in axes.items():
            is_numeric = pd.api.types.is_numeric_dtype(levels)
            terms[axis] = _polynomial_term(levels, degree) if is_numeric else _level_term(levels)
            n_regressor += terms[axis].columns.shape[1]
        if terms and 4 * n_regressor <= count:
            return terms
    return {}


def _polynomial_term(levels: pd.Series, degree: int) -> _Term:
    """Return the term of a numeric axis: Legendre polynomials of the rank of the level.

    Parameters
    ----------
    levels : (n,) pandas.Series
        Level of each design.
    degree : int
        Largest degree of the polynomials.
    """
    values = levels.to_numpy(dtype=float)
    u = 2.0 * (stats.rankdata(values) - 0.5) / len(values) - 1.0  # ranks are uniform for any scale of the axis
    highest_degree = min(degree, len(np.unique(values)) - 1)
    columns = legendre.legvander(u, highest_degree)[:, 1:]
    lowest = int(np.argmin(values))
    highest = int(np.argmax(values))
    ends = [
        _End("low", "", float(values[lowest]), lowest),
        _End("high", "", float(values[highest]), highest),
    ]
    return _Term(columns - columns.mean(axis=0), ends)


def _level_term(levels: pd.Series) -> _Term:
    """Return the term of an axis of levels: an indicator for each level except the first."""
    names = list(dict.fromkeys(levels))
    indicators = [(levels == name).to_numpy(dtype=float) for name in names[1:]]
    columns = np.array(indicators).T
    level_of_designs = list(levels)
    ends = []
    for name in names:
        first_design = level_of_designs.index(name)
        ends.append(_End(str(name), str(name), np.nan, first_design))
    return _Term(columns - columns.mean(axis=0), ends)


class _Regression:
    """Least-squares fit with regressors (n, k) of mean zero.

    Intervals are by the covariance estimate HC3, which is valid for unequal variances of the residuals too.
    """

    def __init__(self, columns: Floats, value: Floats) -> None:
        design = np.column_stack([np.ones(len(value)), columns])
        self.size = columns.shape[1]
        self._freedom = len(value) - design.shape[1]
        self._inverse = np.linalg.pinv(design)
        coefficients = self._inverse @ value
        self._coefficients = coefficients[1:]
        residual = value - design @ coefficients
        leverage = np.sum(design * self._inverse.T, axis=1)
        # HC3 uses the residual of each design by a fit without it, r_i / (1 - h_i).
        self._residual = residual / np.maximum(1.0 - leverage, 1e-9)

    def linear_combination(self, weights: Floats) -> tuple[float, float]:
        """Return a linear combination of the coefficients, weights (k,), and the half-width of its 95 % interval."""
        quantile = stats.t.isf(0.5 * (1.0 - CONFIDENCE), self._freedom)
        sensitivity = weights @ self._inverse[1:]  # of the combination to each value
        standard_error = np.linalg.norm(sensitivity * self._residual)
        return float(weights @ self._coefficients), float(quantile * standard_error)


def limit_of(tables: Tables, requirement: str) -> float:
    """Return the limit of the requirement with a name, in the SI unit of its metric; NaN if there is none."""
    for definition in tables.campaign.get("requirements") or ():
        if definition["name"] == requirement:
            return parse_number(definition["below"], metric_of(str(definition["metric"])).unit)
    return float("nan")


def value_of(tables: Tables, end: Any) -> str:
    """Return the level of a row of `swings`, or its value in the unit of the campaign file, as text."""
    return str(end.level) or range_text(tables, str(end.axis), end.value, end.value)
