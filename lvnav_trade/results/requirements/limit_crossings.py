"""Errors along the numeric axes of a campaign compared with their limits, and where a curve crosses its limit."""

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.units import parse
from lvnav_trade.results.requirements import improvements, requirements
from lvnav_trade.results.statistics.select import once
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
    names = list(next(iter(tables.levels.values()), {}))
    axes = []
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):  # a saved base may have none
        if axis["values"] is None:  # sampled values do not form a curve
            continue
        labels, values = [str(label) for label in axis["labels"]], list(axis["values"])
        read = [_QUANTITY.fullmatch(text) for text in labels]
        units = {number[2] or "" for number in read if number is not None}
        if len(labels) > 1 and None not in read and len(units) == 1:
            unit = units.pop()
            numbers = dict(zip(labels, (float(number[1]) for number in read if number is not None), strict=True))
        elif len(labels) > 1 and (si := _in_si(values)) is not None:
            unit, numbers = si[0], dict(zip(labels, si[1], strict=True))
        else:
            continue
        base = _base_value(tables, axis["path"], unit)
        axes.append(NumericAxis(name, unit, numbers | ({} if base is None else {BASE: base})))
    return axes


def si_axes(tables: Tables) -> list[NumericAxis]:
    """Return the axes whose levels are all numbers, or quantities of one dimension, in SI units."""
    names = list(next(iter(tables.levels.values()), {}))
    axes = []
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):
        labels, stated = _levels(tables, name, axis)
        read = _in_si(stated)
        if read is not None:
            unit, numbers = read
            values = dict(zip(labels, numbers, strict=True))
            base = _base_value(tables, axis["path"], unit)
            axes.append(NumericAxis(name, unit, values | ({} if base is None else {BASE: base})))
    return axes


def _levels(tables: Tables, name: str, axis: dict[str, Any]) -> tuple[list[str], list[Any]]:
    """Return labels and resolved values of the levels of an axis; for a sampled axis those of the cases."""
    if axis["values"] is not None:
        return [str(label) for label in axis["labels"]], list(axis["values"])
    labels = list(dict.fromkeys(levels[name] for levels in tables.levels.values()))
    base_quantity = _QUANTITY.fullmatch(str(_at(tables.campaign.get("base"), axis["path"])))
    if base_quantity is None or base_quantity[2] is None:
        return labels, list(labels)
    return labels, [f"{parse(label, base_quantity[2])!r} {base_quantity[2]}" for label in labels]


def _in_si(values: list[Any]) -> tuple[str, list[float]] | None:
    """Return the common SI unit and the numbers of resolved values; None unless all are numbers with the same unit."""
    read = [None if isinstance(value, bool) else _QUANTITY.fullmatch(str(value)) for value in values]
    units = {number[2] or "" for number in read if number is not None}
    return None if None in read or len(units) != 1 else (units.pop(), [float(number[1]) for number in read if number])


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
    names = list(next(iter(tables.levels.values()), {}))
    axes = dict(zip(names, tables.campaign.get("axes") or (), strict=False))
    if (axis := axes.get(name)) is None:
        return BaseLevel()
    base_value = _at(tables.campaign.get("base"), axis["path"])
    levels = zip(axis["labels"] or (), axis["values"] or (), strict=True)
    label = next((str(level) for level, value in levels if value == base_value), "")
    numbers = next(
        (candidate for candidate in numeric_axes(tables) if candidate.name == name and BASE in candidate.values), None
    )
    return BaseLevel(label) if numbers is None else BaseLevel(label, numbers.values[BASE], numbers.unit)


def _at(base: Any, path: str) -> Any:
    for key in path.removeprefix("base.").split("."):
        base = base[int(key)] if isinstance(base, list) else (base or {}).get(key)
    return base


def _base_value(tables: Tables, path: str, unit: str) -> float | None:
    """Return the value of a field in the base, in a unit; None if it is not a number."""
    value = _at(tables.campaign.get("base"), path)
    if value is None or isinstance(value, bool) or (read := _QUANTITY.fullmatch(str(value))) is None:
        return None
    if (read[2] or "") == unit:
        return float(read[1])
    return float(read[1]) / parse(f"1 {unit}", read[2]) if read[2] and unit else None


@once
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
    by_runs = requirements.verdicts(tables).set_index(["requirement", "case"])
    by_covariance = improvements.expected(tables).set_index(["requirement", "case"])
    rows = []
    for axis in numeric_axes(tables):
        for case, levels in tables.levels.items():
            if (value := axis.values.get(levels[axis.name])) is None or not _is_on(axis, levels):
                continue
            other_levels = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis.name)
            for requirement in dict.fromkeys(by_runs.index.get_level_values(0)):
                key = (requirement, tables.labels[case])
                runs, expected = by_runs.loc[key], by_covariance.loc[key]
                head = (axis.name, value, axis.unit, other_levels, key[1], requirement, runs.unit or expected.unit)
                results = (expected.estimate, expected.expected_probability, runs.estimate, runs.verdict)
                rows.append((*head, runs.limit if runs.limit == runs.limit else expected.limit, *results))
    frame = pd.DataFrame(rows, columns=CURVES)
    order = ["axis", "requirement", "others", "value"]
    return frame.sort_values(order, kind="stable", key=_in_order).reset_index(drop=True)


def _in_order(column: pd.Series) -> pd.Series:
    """Return a sort key: numbers unchanged, texts by order of first occurrence."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    return column.map({text: k for k, text in enumerate(dict.fromkeys(column))})


def _is_on(axis: NumericAxis, levels: dict[str, str]) -> bool:
    """Return whether a case lies on a curve along an axis; if axes vary one at a time, the others are at their base."""
    return levels[axis.name] != BASE or all(level == BASE for level in levels.values())


def crossings(tables: Tables) -> pd.DataFrame:
    """Return where each curve of `curves` crosses its limit: between two neighbours (low, high), by linear
    interpolation, for linear covariance and for the runs.

    case : levels of the other axes
    """
    rows = []
    keys = ["axis", "axis_unit", "others", "requirement", "unit"]
    for head, curve in curves(tables).groupby(keys, sort=False, dropna=False):
        axis, axis_unit, other_levels, requirement, unit = head
        for by, column in (("linear covariance", "lincov"), ("Monte Carlo", "monte_carlo")):
            limit = float(curve.limit.iloc[0])
            for low, high, crossing in crossed(curve.value.to_numpy(), curve[column].to_numpy(dtype=float), limit):
                rows.append((axis, axis_unit, other_levels, requirement, unit, limit, by, crossing, low, high))
    return pd.DataFrame(rows, columns=CROSSINGS)


def crossed(value: np.ndarray, error: np.ndarray, limit: float) -> Iterator[tuple[float, float, float]]:
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
        if np.isfinite([y0, y1, limit]).all() and (y0 < limit) != (y1 < limit):
            yield float(x0), float(x1), float(x0 + (limit - y0) / (y1 - y0) * (x1 - x0))


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
    rows: list[tuple[Any, ...]] = []
    if tables.campaign.get("design") == "one_at_a_time":
        expected = improvements.expected(tables)
        digests = {label: case for case, label in tables.labels.items()}
        for requirement, estimates in expected.groupby("requirement", sort=False):
            error = dict(zip(estimates.case, estimates.estimate, strict=True))
            rows += _bars(tables, str(requirement), estimates, {digests[label]: size for label, size in error.items()})
    frame = pd.DataFrame(rows, columns=TORNADO)
    return frame.sort_values(["requirement", "range"], ascending=[True, False], kind="stable").reset_index(drop=True)


def _bars(
    tables: Tables, requirement: str, estimates: pd.DataFrame, error: dict[str, float]
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of one requirement.

    error : P-quantile by digest of the case
    """
    base = next((case for case, levels in tables.levels.items() if set(levels.values()) == {BASE}), None)
    if base is None or not np.isfinite(error[base]):
        return
    for axis in tables.levels[base]:
        along = {levels[axis]: error[case] for case, levels in tables.levels.items() if levels[axis] != BASE}
        along = {level: size for level, size in {BASE: error[base], **along}.items() if np.isfinite(size)}
        low, high = (choose(along, key=lambda level: along[level]) for choose in (min, max))
        head = (requirement, tables.labels[base], axis, str(estimates.unit.iloc[0]), float(estimates.limit.iloc[0]))
        yield (*head, error[base], along[low], low, along[high], high, along[high] - along[low])
