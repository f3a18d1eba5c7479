"""What many designs show together: which axes matter, what share of the designs meets the requirements where."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluation.designs import AXIS, designs, name_and_end, requirement_columns, slug, unit_of
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.statistics.probability import basis, fitted, fitted_indices, predicted, success_bounds
from lvnav_trade.results.statistics.select import once
from lvnav_trade.results.tables.dictionary import unit_at_end, unit_suffix
from lvnav_trade.results.tables.read import Tables

EFFECTS = [
    "requirement",
    "axis",
    "rank_correlation",
    "low",
    "high",
    "first_order",
    "designs",
    "sobol_first",
    "sobol_total",
    "predicted",
]
REGIONS = ["requirement", "axis", "level", "low", "high", "unit", "designs", "met", "share", "share_low", "share_high"]
ALL = "all requirements"
BINS = 5  # parts of a numeric axis, with as many designs in each
_FINE = 12  # parts of a numeric axis whose means give its share of the variance
_FEWEST = 8  # designs of which anything is said
CONFIDENCE = 0.95
"""Of all intervals of designs that are drawn at random."""
OVERCONFIDENT = 2.0
"""Expected NEES per state above which a filter counts as overconfident: its sigma is too small by its root."""


def axes_of(frame: pd.DataFrame) -> list[str]:
    """Return the columns of the axes of designs."""
    return [str(name) for name in frame if str(name).startswith(AXIS)]


def possible(tables: Tables) -> pd.DataFrame:
    """Return the designs of results that have numbers."""
    frame = designs(tables)
    return frame[frame.case != ""].reset_index(drop=True)


def errors_of(tables: Tables, frame: pd.DataFrame) -> dict[str, str]:
    """Return the column of the error of each requirement by its name; without requirements those of navigation."""
    stated = tables.campaign.get("requirements") or ()
    named = {str(one["name"]): requirement_columns(one)[0] for one in stated}
    named = named or {f"{name} error": f"{name}_{unit_suffix(unit)}" for name, unit in NAVIGATION_UNITS.items()}
    return {name: column for name, column in named.items() if column in frame}


@once
def effects(tables: Tables) -> pd.DataFrame:
    """Return the dependence of the error of each requirement on each axis over all designs; empty without many designs.
    Without requirements: how attitude, velocity and position at injection do.

    rank_correlation: Spearman's, of numeric axes. low, high: its 95 % interval (Bonett and Wright 2000), of designs
    that are drawn at random; a grid is no sample.
    first_order: part of the variance of the error's logarithm that the axis explains alone, from means over parts of
    the axis with as many designs each, what chance explains taken off.
    sobol_first, sobol_total: Sobol's indices of the squared error by a fit of polynomials to its logarithm (`fitted`),
    of samples over numeric axes alone; predicted: how well the fit predicts left-out designs (1: exactly).
    """
    rows: list[tuple[Any, ...]] = []
    if tables.has_designs:
        frame = possible(tables)
        for name, column in errors_of(tables, frame).items():
            rows += _effects(frame, name, column, tables.is_sampled)
    return pd.DataFrame(rows, columns=EFFECTS)


def _effects(frame: pd.DataFrame, requirement: str, column: str, is_sampled: bool) -> Iterator[tuple[Any, ...]]:
    error = frame[column].to_numpy(dtype=float)
    sobol = _sobol(frame, error) if is_sampled else {}
    for axis in axes_of(frame):
        known = np.isfinite(error) & (error > 0.0) & frame[axis].notna().to_numpy()
        if known.sum() < _FEWEST:
            continue
        level, log = frame[axis][known], np.log(error[known])
        low = high = correlation = np.nan
        if is_numeric(frame, axis):
            correlation = float(stats.spearmanr(level, log).statistic)
            low, high = _interval(correlation, len(log)) if is_sampled else (np.nan, np.nan)
            parts = _parts(level.to_numpy(dtype=float), _FINE)
        else:
            parts = level.map({name: k for k, name in enumerate(dict.fromkeys(level))}).to_numpy()
        shares = sobol.get(axis, (np.nan,) * 3)
        yield requirement, axis, correlation, low, high, _first_order(parts, log, is_sampled), int(known.sum()), *shares


def _sobol(frame: pd.DataFrame, error: Floats) -> dict[str, tuple[float, float, float]]:
    """Return first-order and total index of each axis, and how well the fit behind them predicts; nothing where an axis
    has no numbers, or the designs are too few for the fit.
    """
    axes, known = axes_of(frame), np.isfinite(error) & (error > 0.0)
    count = int(known.sum())
    if not all(is_numeric(frame, axis) for axis in axes) or count < 2 * len(basis(len(axes))):
        return {}
    ranks = np.argsort(
        np.argsort(frame[axes].to_numpy(dtype=float)[known], axis=0, kind="stable"), axis=0, kind="stable"
    )
    u, square = 2.0 * (ranks + 0.5) / count - 1.0, error[known] ** 2
    first, whole = fitted_indices(fitted(u, square)[None], len(axes))[:, 0]
    well = predicted(u, square)
    return {axis: (float(first[k]), float(whole[k]), well) for k, axis in enumerate(axes)}


def is_numeric(frame: pd.DataFrame, axis: str) -> bool:
    """Whether an axis has numbers."""
    return bool(pd.api.types.is_numeric_dtype(frame[axis]))


def _interval(correlation: float, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a rank correlation by Fisher's transformation (Bonett and Wright 2000)."""
    if n <= 3 or not abs(correlation) < 1.0:
        return correlation, correlation
    half = stats.norm.isf(0.5 * (1.0 - CONFIDENCE)) * np.sqrt((1.0 + 0.5 * correlation**2) / (n - 3))
    middle = np.arctanh(correlation)
    return float(np.tanh(middle - half)), float(np.tanh(middle + half))


def _parts(values: Floats, count: int) -> Any:
    """Return in which of some parts a value (n,) lies: in one for each level where there are few, else in one of
    `count` with as many values each. Equal values lie in one part.
    """
    levels, part = np.unique(values, return_inverse=True)
    if len(levels) <= count and 2 * len(levels) <= len(values):  # a level is of several designs, not of one by chance
        return part
    rank = stats.rankdata(values) - 0.5
    parts = (rank * min(count, max(1, len(values) // _FEWEST)) / len(values)).astype(int)
    return np.unique(parts, return_inverse=True)[1]  # none is empty


def _first_order(parts: Any, value: Floats, is_sampled: bool) -> float:
    """Return the part of the variance between parts; of a sample what parts by chance would have taken off (omega
    squared).
    """
    n, k = len(value), int(parts.max()) + 1
    total = float(np.sum((value - value.mean()) ** 2))
    if k < 2 or n <= k or total == 0.0:
        return 0.0
    count = np.bincount(parts, minlength=k)
    mean = np.bincount(parts, weights=value, minlength=k) / np.maximum(count, 1)
    between = float(np.sum(count * (mean - value.mean()) ** 2))
    within = (total - between) / (n - k) if is_sampled else 0.0
    return float(np.clip((between - (k - 1) * within) / (total + within), 0.0, 1.0))


@once
def regions(tables: Tables) -> pd.DataFrame:
    """Return the fraction of designs that meet each requirement, and all of them, in each part of each axis.

    A part is a level, or a fifth of the designs by a numeric axis, from `low` to `high` in `unit`. share_low,
    share_high: exact binomial 95 % interval, of designs that are drawn at random. No rows of results without many
    designs.
    """
    rows: list[tuple[Any, ...]] = []
    stated = tables.campaign.get("requirements") or ()
    if tables.has_designs and stated:
        frame = possible(tables)
        columns = {str(one["name"]): requirement_columns(one)[2] for one in stated}
        for name, column in {**columns, ALL: "verdict"}.items():
            for axis in axes_of(frame) if len(frame) else ():
                rows += _regions(frame, name, column, axis)
    found = pd.DataFrame(rows, columns=REGIONS)
    return found if tables.is_sampled else found.assign(share_low=np.nan, share_high=np.nan)


def _regions(frame: pd.DataFrame, name: str, column: str, axis: str) -> Iterator[tuple[Any, ...]]:
    met = (frame[column] == "met").to_numpy()
    if is_numeric(frame, axis):
        values = frame[axis].to_numpy(dtype=float)
        parts = _parts(values, BINS)
        groups: Sequence[tuple[str, Any]] = [("", parts == k) for k in range(int(parts.max()) + 1)]
    else:
        values = np.full(len(frame), np.nan)
        groups = [(str(level), (frame[axis] == level).to_numpy()) for level in dict.fromkeys(frame[axis])]
    for level, inside in groups:
        count, good = int(inside.sum()), int(met[inside].sum())
        if count:
            ends = (np.nan, np.nan) if level else (values[inside].min(), values[inside].max())
            yield name, axis, level, *map(float, ends), unit_of(axis), count, good, good / count, *interval(good, count)


def interval(good: int, count: int) -> tuple[float, float]:
    """Return the exact two-sided 95 % binomial interval of a share."""
    low, high = success_bounds(count, count - good, 0.5 + 0.5 * CONFIDENCE)
    return float(low), float(high)


def counts_of(tables: Tables, frame: pd.DataFrame) -> dict[str, int]:
    """Return how many of some designs meet each requirement, by its name."""
    stated = tables.campaign.get("requirements") or ()
    columns = {str(one["name"]): requirement_columns(one)[2] for one in stated}
    return {name: int((frame[column] == "met").sum()) for name, column in columns.items() if column in frame}


def overconfident(frame: pd.DataFrame) -> int:
    """Return how many of some designs have an overconfident filter."""
    return int((frame.nees_per_state_ratio > OVERCONFIDENT).sum()) if "nees_per_state_ratio" in frame else 0


_PEOPLE = {"rad": ("mrad", 1e3)}
_OTHERS = {"_sigma": "sigma", "_percent": "%"}  # units by the ends of columns that are in no SI unit


def axis_label(column: str) -> str:
    """Return the name of an axis for people: without ``axis_`` and its unit, in words."""
    return name_and_end(column.removeprefix(AXIS))[0].replace("_", " ")


def range_text(tables: Tables, column: str, low: float, high: float) -> str:
    """Write the ends of a range of a column in its unit for people, three digits each; one number where they are equal
    then.
    """
    unit, factor = people_of(tables, column)
    first, last = (f"{float(f'{end * factor:.2e}'):g}" for end in (low, high))
    return f"{first if first == last else f'{first} to {last}'} {unit}".rstrip()


def people_of(tables: Tables, column: str) -> tuple[str, float]:
    """Return a unit for people and its factor per SI unit, for a column of designs: that in which the campaign states
    an axis, mrad of an attitude, else the SI unit.
    """
    si = unit_at_end(column)[1]
    if column.startswith(AXIS):
        stated = _stated_units(tables).get(column, "")
        shown = re.sub(r"sqrt\((\w+)\)", r"√\1", stated)
        return (shown, 1.0 / parse(f"1 {stated}", si)) if stated and si else (shown or si, 1.0)
    return _PEOPLE.get(si, (si or _OTHERS.get(name_and_end(column)[1], ""), 1.0))


@once
def _stated_units(tables: Tables) -> dict[str, str]:
    """Return the unit in which the campaign states each axis of numbers, by column."""
    names = list(json.loads(tables.designs["axes"].iloc[0])) if tables.has_designs else []
    frame, found = designs(tables), {}
    columns = {_name_in(frame, column): column for column in axes_of(frame)}
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):
        stated = (axis.get("between") or axis.get("labels") or [""])[0]
        unit = str(stated).partition(" ")[2]
        if slug(name) in columns:
            found[columns[slug(name)]] = unit
    return found


def _name_in(frame: pd.DataFrame, column: str) -> str:
    """Return the name of an axis in its column, which ends with a unit where it has numbers."""
    name = column.removeprefix(AXIS)
    return unit_at_end(name)[0] if is_numeric(frame, column) else name
