"""Effects of the axes of a design space on the errors, and fractions of the designs that meet the requirements."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluation.designs import AXIS, designs, requirement_columns, slug, split_suffix, unit_of
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.statistics.probability import (
    basis,
    fit_polynomials,
    fitted_indices,
    predicted_variance_share,
    success_bounds,
)
from lvnav_trade.results.statistics.select import cache_result
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
_FINE = 12  # bins of a numeric axis whose means give its share of the variance
_FEWEST = 8  # smallest number of designs for an effect, and for a bin
CONFIDENCE = 0.95
"""Confidence of the intervals for randomly drawn designs."""
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
    columns = {}
    for requirement in tables.campaign.get("requirements") or ():
        error, _, _ = requirement_columns(requirement)
        columns[str(requirement["name"])] = error
    if not columns:
        for quantity, unit in NAVIGATION_UNITS.items():
            columns[f"{quantity} error"] = f"{quantity}_{unit_suffix(unit)}"
    return {name: column for name, column in columns.items() if column in frame}


def _verdict_columns(tables: Tables) -> dict[str, str]:
    """Return the column of the verdict on each requirement by its name."""
    columns = {}
    for requirement in tables.campaign.get("requirements") or ():
        _, _, verdict = requirement_columns(requirement)
        columns[str(requirement["name"])] = verdict
    return columns


@cache_result
def effects(tables: Tables) -> pd.DataFrame:
    """Return the dependence of the error of each requirement on each axis over all designs.

    Without requirements the errors are those of attitude, velocity and position at injection. The table is empty
    without a design space.

    rank_correlation: Spearman's, of numeric axes. low, high: its 95 % interval (Bonett and Wright 2000) for randomly
    drawn designs; NaN for a grid, which is not a sample.
    first_order: share of the variance of the error's logarithm that the axis explains alone, by the means over bins of
    the axis with equal numbers of designs, without the share expected by chance.
    sobol_first, sobol_total: Sobol's indices of the squared error by a fit of polynomials to its logarithm
    (`fit_polynomials`); NaN unless the designs are a sample over numeric axes only. predicted: share of the variance of
    left-out designs that the fit predicts.
    """
    rows: list[dict[str, Any]] = []
    if tables.has_designs:
        frame = possible(tables)
        for name, column in errors_of(tables, frame).items():
            rows += [{"requirement": name, **row} for row in _requirement_effects(frame, column, tables.is_sampled)]
    return pd.DataFrame(rows, columns=EFFECTS)


def _requirement_effects(frame: pd.DataFrame, column: str, is_sampled: bool) -> Iterator[dict[str, Any]]:
    """Yield the rows of `effects` for one requirement; `column`: its error in the table of designs."""
    error = frame[column].to_numpy(dtype=float)
    indices = _sobol_indices(frame, error) if is_sampled else {}
    for axis in axes_of(frame):
        is_positive = np.isfinite(error) & (error > 0.0)
        is_usable = is_positive & frame[axis].notna().to_numpy()
        if is_usable.sum() < _FEWEST:
            continue
        level = frame[axis][is_usable]
        log_error = np.log(error[is_usable])
        low = high = correlation = np.nan
        if is_numeric(frame, axis):
            correlation = float(stats.spearmanr(level, log_error).statistic)
            if is_sampled:
                low, high = _interval(correlation, len(log_error))
            bins = _bins(level.to_numpy(dtype=float), _FINE)
        else:
            numbers = {name: k for k, name in enumerate(dict.fromkeys(level))}
            bins = level.map(numbers).to_numpy()
        sobol_first, sobol_total, predicted_share = indices.get(axis, (np.nan, np.nan, np.nan))
        yield {
            "axis": axis,
            "rank_correlation": correlation,
            "low": low,
            "high": high,
            "first_order": _first_order(bins, log_error, is_sampled),
            "designs": int(is_usable.sum()),
            "sobol_first": sobol_first,
            "sobol_total": sobol_total,
            "predicted": predicted_share,
        }


def _sobol_indices(frame: pd.DataFrame, error: Floats) -> dict[str, tuple[float, float, float]]:
    """Return for each axis its first-order and total index, and the share of the variance that their fit predicts.

    The result is empty if an axis is not numeric, or if there are too few designs for the fit.
    """
    axes = axes_of(frame)
    is_usable = np.isfinite(error) & (error > 0.0)
    count = int(is_usable.sum())
    if not all(is_numeric(frame, axis) for axis in axes):
        return {}
    if count < 2 * len(basis(len(axes))):
        return {}
    levels = frame[axes].to_numpy(dtype=float)[is_usable]
    order = np.argsort(levels, axis=0, kind="stable")
    ranks = np.argsort(order, axis=0, kind="stable")
    u = 2.0 * (ranks + 0.5) / count - 1.0
    error_squares = error[is_usable] ** 2
    coefficients = fit_polynomials(u, error_squares)
    first, total = fitted_indices(coefficients[None], len(axes))[:, 0]
    predicted_share = predicted_variance_share(u, error_squares)
    indices = {}
    for k, axis in enumerate(axes):
        indices[axis] = (float(first[k]), float(total[k]), predicted_share)
    return indices


def is_numeric(frame: pd.DataFrame, axis: str) -> bool:
    """Whether an axis has numbers."""
    return bool(pd.api.types.is_numeric_dtype(frame[axis]))


def _interval(correlation: float, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a rank correlation by Fisher's transformation (Bonett and Wright 2000).

    Parameters
    ----------
    correlation : float
        Spearman's rank correlation.
    n : int
        Number of designs.
    """
    if n <= 3 or not abs(correlation) < 1.0:
        return correlation, correlation
    variance = (1.0 + 0.5 * correlation**2) / (n - 3)
    sigma = np.sqrt(variance)
    tail = 0.5 * (1.0 - CONFIDENCE)
    half = stats.norm.isf(tail) * sigma
    centre = np.arctanh(correlation)
    low = np.tanh(centre - half)
    high = np.tanh(centre + half)
    return float(low), float(high)


def _bins(values: Floats, count: int) -> Any:
    """Return the number of the bin of each value. Equal values are in the same bin.

    Parameters
    ----------
    values : (n,) array
        Levels of the designs.
    count : int
        Number of bins with equal numbers of values. If there are few levels, each level is a bin instead.

    Returns
    -------
    (n,) array of int
        Bins, from 0.
    """
    levels, bins = np.unique(values, return_inverse=True)
    if len(levels) <= count and 2 * len(levels) <= len(values):  # a level is of several designs, not of one by chance
        return bins
    rank = stats.rankdata(values) - 0.5
    n_bin = min(count, max(1, len(values) // _FEWEST))
    bins = (rank * n_bin / len(values)).astype(int)
    _, consecutive = np.unique(bins, return_inverse=True)  # no bin is empty
    return consecutive


def _first_order(bins: Any, value: Floats, is_sampled: bool) -> float:
    """Return the share of the variance between bins (first-order effect).

    Parameters
    ----------
    bins : (n,) array of int
        Bin of each design, from 0.
    value : (n,) array
        Value of each design.
    is_sampled : bool
        Whether the designs are a sample; the share due to chance is then removed (omega squared).
    """
    n = len(value)
    k = int(bins.max()) + 1
    overall_mean = value.mean()
    total = float(np.sum((value - overall_mean) ** 2))
    if k < 2 or n <= k or total == 0.0:
        return 0.0
    count = np.bincount(bins, minlength=k)
    bin_sum = np.bincount(bins, weights=value, minlength=k)
    mean = bin_sum / np.maximum(count, 1)
    between_squares = float(np.sum(count * (mean - overall_mean) ** 2))
    within_mean_square = 0.0
    if is_sampled:
        within_mean_square = (total - between_squares) / (n - k)
    share = (between_squares - (k - 1) * within_mean_square) / (total + within_mean_square)
    return float(np.clip(share, 0.0, 1.0))


@cache_result
def regions(tables: Tables) -> pd.DataFrame:
    """Return the fraction of designs that meet each requirement, and all of them, in each part of each axis.

    A part is a level, or a fifth of the designs by a numeric axis, from `low` to `high` in `unit`. share_low,
    share_high: exact binomial 95 % interval for randomly drawn designs. The table is empty without a design space.
    """
    rows: list[dict[str, Any]] = []
    columns = _verdict_columns(tables)
    if tables.has_designs and columns:
        frame = possible(tables)
        axes = axes_of(frame) if len(frame) else []
        for name, column in {**columns, ALL: "verdict"}.items():
            is_met = (frame[column] == "met").to_numpy()
            for axis in axes:
                rows += [{"requirement": name, "axis": axis, **row} for row in _axis_regions(frame, is_met, axis)]
    regions_frame = pd.DataFrame(rows, columns=REGIONS)
    if tables.is_sampled:
        return regions_frame
    return regions_frame.assign(share_low=np.nan, share_high=np.nan)


def _axis_regions(frame: pd.DataFrame, is_met: Bools, axis: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of `regions` from the level on, for one axis and designs that meet a requirement or not."""
    if is_numeric(frame, axis):
        values = frame[axis].to_numpy(dtype=float)
        bins = _bins(values, BINS)
        n_bins = int(bins.max()) + 1
        groups: list[tuple[str, Any]] = [("", bins == k) for k in range(n_bins)]
    else:
        values = np.full(len(frame), np.nan)
        groups = []
        for level in dict.fromkeys(frame[axis]):
            has_level = (frame[axis] == level).to_numpy()
            groups.append((str(level), has_level))
    for level, is_inside in groups:
        count = int(is_inside.sum())
        if not count:
            continue
        n_met = int(is_met[is_inside].sum())
        share_low, share_high = interval(n_met, count)
        yield {
            "level": level,
            "low": np.nan if level else float(values[is_inside].min()),
            "high": np.nan if level else float(values[is_inside].max()),
            "unit": unit_of(axis),
            "designs": count,
            "met": n_met,
            "share": n_met / count,
            "share_low": share_low,
            "share_high": share_high,
        }


def interval(good: int, count: int) -> tuple[float, float]:
    """Return the exact two-sided 95 % binomial interval of a share.

    Parameters
    ----------
    good, count : int
        Number of designs that meet a condition, and number of all designs.
    """
    low, high = success_bounds(count, count - good, 0.5 + 0.5 * CONFIDENCE)
    return float(low), float(high)


def met_counts(tables: Tables, frame: pd.DataFrame) -> dict[str, int]:
    """Return how many of some designs meet each requirement, by its name."""
    counts = {}
    for name, column in _verdict_columns(tables).items():
        if column in frame:
            counts[name] = int((frame[column] == "met").sum())
    return counts


def overconfident(frame: pd.DataFrame) -> int:
    """Return how many of some designs have an overconfident filter."""
    if "nees_per_state_ratio" not in frame:
        return 0
    return int((frame.nees_per_state_ratio > OVERCONFIDENT).sum())


_PEOPLE = {"rad": ("mrad", 1e3)}
_OTHERS = {"_sigma": "sigma", "_percent": "%"}  # units by the ends of columns that are in no SI unit


def axis_label(column: str) -> str:
    """Return the name of an axis for people: without ``axis_`` and its unit, in words."""
    return split_suffix(column.removeprefix(AXIS))[0].replace("_", " ")


def range_text(tables: Tables, column: str, low: float, high: float) -> str:
    """Return the ends of a range of a column as text, in its display unit with three digits; once if they are equal."""
    unit, factor = display_unit(tables, column)
    first, last = (f"{_round_number(end * factor):g}" for end in (low, high))
    text = first if first == last else f"{first} to {last}"
    return f"{text} {unit}".rstrip()


def _round_number(number: float) -> float:
    """Return a number rounded to three digits."""
    return float(f"{number:.2e}")


def display_unit(tables: Tables, column: str) -> tuple[str, float]:
    """Return the display unit of a column of designs, and its factor from SI.

    The unit of an axis is that of the campaign, and that of an attitude error is mrad. All other columns are in SI.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    column : str
        Name of the column, with its SI unit at the end.
    """
    _, si = unit_at_end(column)
    if column.startswith(AXIS):
        unit = _campaign_units(tables).get(column, "")
        shown_unit = re.sub(r"sqrt\((\w+)\)", r"√\1", unit)
        if unit and si:
            return shown_unit, 1.0 / parse(f"1 {unit}", si)
        return shown_unit or si, 1.0
    if si in _PEOPLE:
        return _PEOPLE[si]
    _, end = split_suffix(column)
    return si or _OTHERS.get(end, ""), 1.0


@cache_result
def _campaign_units(tables: Tables) -> dict[str, str]:
    """Return the unit in which the campaign states each axis of numbers, by column."""
    if tables.has_designs:
        names = list(json.loads(tables.designs["axes"].iloc[0]))
    else:
        names = []
    frame = designs(tables)
    columns = {_axis_name(frame, column): column for column in axes_of(frame)}
    units = {}
    for name, axis in zip(names, tables.campaign.get("axes") or (), strict=False):
        level = (axis.get("between") or axis.get("labels") or [""])[0]
        _, _, unit = str(level).partition(" ")
        if slug(name) in columns:
            units[columns[slug(name)]] = unit
    return units


def _axis_name(frame: pd.DataFrame, column: str) -> str:
    """Return the name of an axis in its column, which ends with a unit if the axis is numeric."""
    name = column.removeprefix(AXIS)
    if is_numeric(frame, column):
        name, _ = unit_at_end(name)
    return name
