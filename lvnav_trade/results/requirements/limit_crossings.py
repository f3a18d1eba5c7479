"""Errors along the numeric axes of a campaign compared with their limits, and where a curve crosses its limit."""

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.units import parse
from lvnav_trade.results.requirements import improvements, requirements
from lvnav_trade.results.statistics.select import cache_result
from lvnav_trade.results.tables.read import Tables

CURVES = [
    "axis",
    "value",
    "axis_unit",
    "others",
    "case",
    "requirement",
    "unit",
    "limit",
    "lincov",
    "lincov_probability",
    "monte_carlo",
    "verdict",
]
CROSSINGS = ["axis", "axis_unit", "case", "requirement", "unit", "limit", "by", "crossing", "low", "high"]
_QUANTITY = re.compile(r"([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)(?: (\S+))?")
BASE = "base"


class NumericAxis(NamedTuple):
    """An axis whose levels are numbers.

    name : Name of the axis.
    unit : Display unit; empty for a dimensionless number.
    values : Value of each level by its label, in this unit.
    """

    name: str
    unit: str
    values: dict[str, float]


def numeric_axes(tables: Tables) -> list[NumericAxis]:
    """Return the axes with at least two levels, all of them numbers, or quantities of one dimension.

    The unit is that of the labels if they are quantities with the same unit, otherwise the SI unit of the values.
    """
    axes = []
    for name, axis in _axis_definitions(tables).items():
        if axis["values"] is None:  # sampled values do not form a curve
            continue
        labels = [str(label) for label in axis["labels"]]
        if len(labels) < 2:
            continue
        quantities = _read_quantities(labels) or _read_quantities(axis["values"])
        if quantities is not None:
            axes.append(_numeric_axis(tables, name, axis, labels, quantities))
    return axes


def si_axes(tables: Tables) -> list[NumericAxis]:
    """Return the axes whose levels are all numbers, or quantities of one dimension, in SI units."""
    axes = []
    for name, axis in _axis_definitions(tables).items():
        labels, values = _levels(tables, name, axis)
        quantities = _read_quantities(values)
        if quantities is not None:
            axes.append(_numeric_axis(tables, name, axis, labels, quantities))
    return axes


def _axis_definitions(tables: Tables) -> dict[str, dict[str, Any]]:
    """Return the axes of the campaign by name, as far as it has them: a saved base may have none."""
    names = list(next(iter(tables.levels.values()), {}))
    return dict(zip(names, tables.campaign.get("axes") or (), strict=False))


def _numeric_axis(
    tables: Tables, name: str, axis: dict[str, Any], labels: list[str], quantities: tuple[str, list[float]]
) -> NumericAxis:
    """Return an axis with the unit and the numbers of its levels, including its level in the base if it is a number.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    name : str
        Name of the axis.
    axis : dict
        Definition of the axis in the campaign.
    labels : list of str
        Labels of its levels.
    quantities : (str, list of float)
        Unit and numbers of its levels.
    """
    unit, numbers = quantities
    values = dict(zip(labels, numbers, strict=True))
    base = _base_value(tables, axis["path"], unit)
    if base is not None:
        values[BASE] = base
    return NumericAxis(name, unit, values)


def _levels(tables: Tables, name: str, axis: dict[str, Any]) -> tuple[list[str], list[Any]]:
    """Return labels and resolved values of the levels of an axis; for a sampled axis those of the cases."""
    if axis["values"] is not None:
        labels = [str(label) for label in axis["labels"]]
        return labels, list(axis["values"])
    labels = list(dict.fromkeys(levels[name] for levels in tables.levels.values()))
    base_value = _field(tables.campaign.get("base"), axis["path"])
    base_quantity = _QUANTITY.fullmatch(str(base_value))
    if base_quantity is None or base_quantity[2] is None:
        return labels, list(labels)
    unit = base_quantity[2]
    values = [f"{parse(label, unit)!r} {unit}" for label in labels]
    return labels, values


def _read_quantities(values: Sequence[Any]) -> tuple[str, list[float]] | None:
    """Return the common unit and the numbers of labels or values; None unless all are numbers with the same unit."""
    units = set()
    numbers = []
    for value in values:
        quantity = None if isinstance(value, bool) else _QUANTITY.fullmatch(str(value))
        if quantity is None:
            return None
        numbers.append(float(quantity[1]))
        units.add(quantity[2] or "")
    if len(units) == 1:
        return (units.pop(), numbers)
    return None


class BaseLevel(NamedTuple):
    """Level of an axis in the base of the campaign.

    label : Its label, if it is one of the levels; otherwise empty.
    number : Its number in `unit`, if the levels are numbers; NaN if not available.
    unit : Unit of the number.
    """

    label: str = ""
    number: float = float("nan")
    unit: str = ""


def base_level(tables: Tables, name: str) -> BaseLevel:
    """Return the level of an axis in the base, as far as it is available."""
    axis = _axis_definitions(tables).get(name)
    if axis is None:
        return BaseLevel()
    base_value = _field(tables.campaign.get("base"), axis["path"])
    label = ""
    for level, value in zip(axis["labels"] or (), axis["values"] or (), strict=True):
        if value == base_value:
            label = str(level)
            break
    for numeric_axis in numeric_axes(tables):
        if numeric_axis.name == name and BASE in numeric_axis.values:
            return BaseLevel(label, numeric_axis.values[BASE], numeric_axis.unit)
    return BaseLevel(label)


def _field(base: Any, path: str) -> Any:
    """Return the value of a field of the base scenario, by its dotted path."""
    for key in path.removeprefix("base.").split("."):
        if isinstance(base, list):
            base = base[int(key)]
        else:
            base = (base or {}).get(key)
    return base


def _base_value(tables: Tables, path: str, unit: str) -> float | None:
    """Return the value of a field in the base, in a unit; None if it is not a number.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    path : str
        Dotted path of the field.
    unit : str
        Unit of the number; empty for a number without unit.
    """
    value = _field(tables.campaign.get("base"), path)
    if value is None or isinstance(value, bool):
        return None
    quantity = _QUANTITY.fullmatch(str(value))
    if quantity is None:
        return None
    number = float(quantity[1])
    base_unit = quantity[2] or ""
    if base_unit == unit:
        return number
    if base_unit and unit:
        return number / parse(f"1 {unit}", base_unit)
    return None


@cache_result
def curves(tables: Tables) -> pd.DataFrame:
    """Return for each numeric axis and requirement the quantile of the error at the required probability.

    Each case with a value of the axis has a row. Without requirements there are no rows.

    Returns
    -------
    pandas.DataFrame
        axis, value : the axis, and the value in `axis_unit`
        others : levels of the other axes, constant along a curve
        limit : limit of the requirement, in `unit`
        lincov : P-quantile by linear covariance, in `unit`, where P is the required probability
        lincov_probability : probability by linear covariance that the error is within the limit
        monte_carlo : P-quantile of the runs (order statistic), in `unit`
        verdict : verdict of the runs
    """
    run_verdicts = requirements.verdicts(tables).set_index(["requirement", "case"])
    lincov_rows = improvements.lincov_verdicts(tables).set_index(["requirement", "case"])
    rows = []
    for axis in numeric_axes(tables):
        for case, levels in tables.levels.items():
            value = axis.values.get(levels[axis.name])
            if value is None or not _is_on_curve(axis, levels):
                continue
            other_levels = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis.name)
            label = tables.labels[case]
            for requirement in dict.fromkeys(run_verdicts.index.get_level_values(0)):
                runs = run_verdicts.loc[requirement, label]
                lincov_row = lincov_rows.loc[requirement, label]
                row = {
                    "axis": axis.name,
                    "value": value,
                    "axis_unit": axis.unit,
                    "others": other_levels,
                    "case": label,
                    "requirement": requirement,
                    "unit": runs.unit or lincov_row.unit,
                    "limit": lincov_row.limit if np.isnan(runs.limit) else runs.limit,
                    "lincov": lincov_row.estimate,
                    "lincov_probability": lincov_row.expected_probability,
                    "monte_carlo": runs.estimate,
                    "verdict": runs.verdict,
                }
                rows.append(row)
    frame = pd.DataFrame(rows, columns=CURVES)
    order = ["axis", "requirement", "others", "value"]
    return frame.sort_values(order, kind="stable", key=_sort_key).reset_index(drop=True)


def _sort_key(column: pd.Series) -> pd.Series:
    """Return a sort key: numbers unchanged, texts by order of first occurrence."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    return column.map({text: k for k, text in enumerate(dict.fromkeys(column))})


def _is_on_curve(axis: NumericAxis, levels: dict[str, str]) -> bool:
    """Return whether a case lies on a curve along an axis; if axes vary one at a time, the others are at their base."""
    return levels[axis.name] != BASE or all(level == BASE for level in levels.values())


def crossings(tables: Tables) -> pd.DataFrame:
    """Return where each curve of `curves` crosses its limit: between two neighbours (low, high), by linear
    interpolation, for linear covariance and for the runs.

    case : levels of the other axes
    """
    rows = []
    keys = ["axis", "axis_unit", "others", "requirement", "unit"]
    for (axis, axis_unit, other_levels, requirement, unit), curve in curves(tables).groupby(
        keys, sort=False, dropna=False
    ):
        value = curve.value.to_numpy()
        limit = float(curve.limit.iloc[0])
        for method, column in (("linear covariance", "lincov"), ("Monte Carlo", "monte_carlo")):
            for low, high, crossing in find_crossings(value, curve[column].to_numpy(dtype=float), limit):
                row = {
                    "axis": axis,
                    "axis_unit": axis_unit,
                    "case": other_levels,
                    "requirement": requirement,
                    "unit": unit,
                    "limit": limit,
                    "by": method,
                    "crossing": crossing,
                    "low": low,
                    "high": high,
                }
                rows.append(row)
    return pd.DataFrame(rows, columns=CROSSINGS)


def find_crossings(value: np.ndarray, error: np.ndarray, limit: float) -> Iterator[tuple[float, float, float]]:
    """Yield the neighbours (low, high) between which an error reaches a limit, and the interpolated crossing.

    Parameters
    ----------
    value : (n,) array
        Increasing values.
    error : (n,) array
        Errors; pairs with an error that is not finite are skipped.
    limit : float
        Limit of the error.
    """
    for (x0, y0), (x1, y1) in pairwise(zip(value, error, strict=True)):
        are_finite = np.isfinite([y0, y1, limit]).all()
        if are_finite and (y0 < limit) != (y1 < limit):
            fraction = (limit - y0) / (y1 - y0)
            crossing = x0 + fraction * (x1 - x0)
            yield float(x0), float(x1), float(crossing)


TORNADO = [
    "requirement",
    "case",
    "axis",
    "unit",
    "limit",
    "base",
    "low",
    "low_level",
    "high",
    "high_level",
    "range",
]


def tornado(tables: Tables) -> pd.DataFrame:
    """Return, of a campaign that varies one axis at a time, the smallest and the largest error of every requirement
    along each axis, including the base, with the levels that give them; the widest range first.

    Errors are P-quantiles by linear covariance, in `unit`, where P is the required probability.
    """
    rows: list[dict[str, Any]] = []
    if tables.campaign.get("design") == "one_at_a_time":
        verdict_rows = improvements.lincov_verdicts(tables)
        for requirement, estimates in verdict_rows.groupby("requirement", sort=False):
            rows += _tornado_bars(tables, str(requirement), estimates)
    frame = pd.DataFrame(rows, columns=TORNADO)
    return frame.sort_values(["requirement", "range"], ascending=[True, False], kind="stable").reset_index(drop=True)


def _tornado_bars(tables: Tables, requirement: str, estimates: pd.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the rows of one requirement, from its rows of `improvements.lincov_verdicts`."""
    error_by_label = dict(zip(estimates.case, estimates.estimate, strict=True))
    base_cases = [case for case, levels in tables.levels.items() if set(levels.values()) == {BASE}]
    if not base_cases:
        return
    base_label = tables.labels[base_cases[0]]
    base_error = error_by_label[base_label]
    if not np.isfinite(base_error):
        return
    for axis in tables.levels[base_cases[0]]:
        error_by_level = {BASE: base_error}
        for case, levels in tables.levels.items():
            error = error_by_label[tables.labels[case]]
            if levels[axis] != BASE and np.isfinite(error):
                error_by_level[levels[axis]] = error
        low_level = min(error_by_level, key=error_by_level.__getitem__)
        high_level = max(error_by_level, key=error_by_level.__getitem__)
        low = error_by_level[low_level]
        high = error_by_level[high_level]
        yield {
            "requirement": requirement,
            "case": base_label,
            "axis": axis,
            "unit": str(estimates.unit.iloc[0]),
            "limit": float(estimates.limit.iloc[0]),
            "base": base_error,
            "low": low,
            "low_level": low_level,
            "high": high,
            "high_level": high_level,
            "range": high - low,
        }
