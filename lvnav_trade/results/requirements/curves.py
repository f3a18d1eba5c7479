"""Errors over the numeric axes of a campaign, beside their limits, and where a curve crosses its limit."""

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
    """An axis whose levels are numbers: name, unit for people (empty: none), value by label of the level."""

    name: str
    unit: str
    values: dict[str, float]


def numeric_axes(tables: Tables) -> list[NumericAxis]:
    """Return the axes with two levels or more, all of them numbers, or quantities of one dimension.

    The unit is that of the labels where these are quantities of one unit, else the SI unit of the values.
    """
    names = list(next(iter(tables.levels.values()), {}))
    found = []
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):  # a kept base may state none
        if axis["values"] is None:  # sampled: its values are no grid that a curve could be drawn over
            continue
        labels, values = [str(label) for label in axis["labels"]], list(axis["values"])
        read = [_QUANTITY.fullmatch(text) for text in labels]
        units = {one[2] or "" for one in read if one is not None}
        if len(labels) > 1 and None not in read and len(units) == 1:
            unit = units.pop()
            numbers = dict(zip(labels, (float(one[1]) for one in read if one is not None), strict=True))
        elif len(labels) > 1 and (si := _in_si(values)) is not None:
            unit, numbers = si[0], dict(zip(labels, si[1], strict=True))
        else:
            continue
        base = _base_value(tables, axis["path"], unit)
        found.append(NumericAxis(name, unit, numbers | ({} if base is None else {BASE: base})))
    return found


def si_axes(tables: Tables) -> list[NumericAxis]:
    """Return the axes of which every level is a number, or a quantity of one dimension, in SI units."""
    names = list(next(iter(tables.levels.values()), {}))
    found = []
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):
        labels, stated = _levels(tables, name, axis)
        read = _in_si(stated)
        if read is not None:
            unit, numbers = read
            values = dict(zip(labels, numbers, strict=True))
            base = _base_value(tables, axis["path"], unit)
            found.append(NumericAxis(name, unit, values | ({} if base is None else {BASE: base})))
    return found


def _levels(tables: Tables, name: str, axis: dict[str, Any]) -> tuple[list[str], list[Any]]:
    """Return labels and resolved values of the levels of an axis; of a sampled one those that the cases have."""
    if axis["values"] is not None:
        return [str(label) for label in axis["labels"]], list(axis["values"])
    labels = list(dict.fromkeys(levels[name] for levels in tables.levels.values()))
    own = _QUANTITY.fullmatch(str(_at(tables.campaign.get("base"), axis["path"])))
    if own is None or own[2] is None:
        return labels, list(labels)
    return labels, [f"{parse(label, own[2])!r} {own[2]}" for label in labels]


def _in_si(values: list[Any]) -> tuple[str, list[float]] | None:
    """Return the unit and the numbers of resolved values; None where they are not all numbers of one unit."""
    read = [None if isinstance(value, bool) else _QUANTITY.fullmatch(str(value)) for value in values]
    units = {one[2] or "" for one in read if one is not None}
    return None if None in read or len(units) != 1 else (units.pop(), [float(one[1]) for one in read if one])


class BaseLevel(NamedTuple):
    """The base's own level of an axis: its label where it is one of the levels, its number in a unit where these are
    numbers (NaN: not known).
    """

    label: str = ""
    number: float = float("nan")
    unit: str = ""


def base_level(tables: Tables, name: str) -> BaseLevel:
    """Return the base's own level of an axis, which one of the levels may be, as far as it is known."""
    names = list(next(iter(tables.levels.values()), {}))
    axes = dict(zip(names, tables.campaign.get("axes") or (), strict=False))
    if (axis := axes.get(name)) is None:
        return BaseLevel()
    own = _at(tables.campaign.get("base"), axis["path"])
    levels = zip(axis["labels"] or (), axis["values"] or (), strict=True)
    label = next((str(one) for one, value in levels if value == own), "")
    numbers = next((one for one in numeric_axes(tables) if one.name == name and BASE in one.values), None)
    return BaseLevel(label) if numbers is None else BaseLevel(label, numbers.values[BASE], numbers.unit)


def _at(base: Any, path: str) -> Any:
    for key in path.removeprefix("base.").split("."):
        base = base[int(key)] if isinstance(base, list) else (base or {}).get(key)
    return base


def _base_value(tables: Tables, path: str, unit: str) -> float | None:
    """Return the base's own value of a field, in a unit; None where it is no number."""
    value = _at(tables.campaign.get("base"), path)
    if value is None or isinstance(value, bool) or (read := _QUANTITY.fullmatch(str(value))) is None:
        return None
    if (read[2] or "") == unit:
        return float(read[1])
    return float(read[1]) / parse(f"1 {unit}", read[2]) if read[2] and unit else None


@once
def curves(tables: Tables) -> pd.DataFrame:
    """Return for each numeric axis and requirement the error that the asked fraction of flights stays below.

    One row for every case that has a value of the axis: axis, value in `axis_unit`; others: the levels of the other
    axes, the same along a curve; limit, lincov (by linear covariance, with the probability that the bound is kept) and
    monte_carlo (order statistic of the runs), in `unit`; verdict of the runs. No rows without requirements.
    """
    by_runs = requirements.verdicts(tables).set_index(["requirement", "case"])
    by_covariance = improvements.expected(tables).set_index(["requirement", "case"])
    rows = []
    for axis in numeric_axes(tables):
        for case, levels in tables.levels.items():
            if (value := axis.values.get(levels[axis.name])) is None or not _is_on(axis, levels):
                continue
            others = ", ".join(f"{name}={level}" for name, level in levels.items() if name != axis.name)
            for requirement in dict.fromkeys(by_runs.index.get_level_values(0)):
                key = (requirement, tables.labels[case])
                runs, expected = by_runs.loc[key], by_covariance.loc[key]
                head = (axis.name, value, axis.unit, others, key[1], requirement, runs.unit or expected.unit)
                found = (expected.estimate, expected.expected_probability, runs.estimate, runs.verdict)
                rows.append((*head, runs.limit if runs.limit == runs.limit else expected.limit, *found))
    frame = pd.DataFrame(rows, columns=CURVES)
    order = ["axis", "requirement", "others", "value"]
    return frame.sort_values(order, kind="stable", key=_in_order).reset_index(drop=True)


def _in_order(column: pd.Series) -> pd.Series:
    """Return numbers as they are, texts as the order in which they come first."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    return column.map({text: k for k, text in enumerate(dict.fromkeys(column))})


def _is_on(axis: NumericAxis, levels: dict[str, str]) -> bool:
    """Whether a case lies on a curve along an axis: where one axis is varied at a time the others are at the base."""
    return levels[axis.name] != BASE or all(level == BASE for level in levels.values())


def crossings(tables: Tables) -> pd.DataFrame:
    """Return where each curve of `curves` crosses its limit: between two neighbours (low, high), by linear
    interpolation; by linear covariance and by the runs. case: the levels of the other axes.
    """
    rows = []
    keys = ["axis", "axis_unit", "others", "requirement", "unit"]
    for head, curve in curves(tables).groupby(keys, sort=False, dropna=False):
        axis, axis_unit, others, requirement, unit = head
        for by, column in (("linear covariance", "lincov"), ("Monte Carlo", "monte_carlo")):
            limit = float(curve.limit.iloc[0])
            for low, high, crossing in crossed(curve.value.to_numpy(), curve[column].to_numpy(dtype=float), limit):
                rows.append((axis, axis_unit, others, requirement, unit, limit, by, crossing, low, high))
    return pd.DataFrame(rows, columns=CROSSINGS)


def crossed(value: np.ndarray, error: np.ndarray, limit: float) -> Iterator[tuple[float, float, float]]:
    """Yield the neighbours (low, high) between which an error reaches a limit, and where, by linear interpolation.

    value (n,) growing; errors (n,), those that are not finite are passed over.
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
    along each axis, the base among them, with the levels that give them; the widest range first.

    Errors are those that the asked fraction of flights stays below by linear covariance, in `unit`.
    """
    rows: list[tuple[Any, ...]] = []
    if tables.campaign.get("design") == "one_at_a_time":
        expected = improvements.expected(tables)
        digests = {label: case for case, label in tables.labels.items()}
        for requirement, found in expected.groupby("requirement", sort=False):
            error = dict(zip(found.case, found.estimate, strict=True))
            rows += _bars(tables, str(requirement), found, {digests[label]: size for label, size in error.items()})
    frame = pd.DataFrame(rows, columns=TORNADO)
    return frame.sort_values(["requirement", "range"], ascending=[True, False], kind="stable").reset_index(drop=True)


def _bars(tables: Tables, requirement: str, found: pd.DataFrame, error: dict[str, float]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of one requirement; error: by digest of the case."""
    base = next((case for case, levels in tables.levels.items() if set(levels.values()) == {BASE}), None)
    if base is None or not np.isfinite(error[base]):
        return
    for axis in tables.levels[base]:
        along = {levels[axis]: error[case] for case, levels in tables.levels.items() if levels[axis] != BASE}
        along = {level: size for level, size in {BASE: error[base], **along}.items() if np.isfinite(size)}
        low, high = (choose(along, key=lambda level: along[level]) for choose in (min, max))
        head = (requirement, tables.labels[base], axis, str(found.unit.iloc[0]), float(found.limit.iloc[0]))
        yield (*head, error[base], along[low], low, along[high], high, along[high] - along[low])
