"""Figures of design spaces and of searches."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import ALL, axis_label, display_unit, errors_of
from lvnav_trade.results.evaluation.designs import designs
from lvnav_trade.results.evaluation.tornado import limit_of, value_of
from lvnav_trade.results.tables.read import Tables

_ACROSS = 3
_ROOM = 1.35  # range of the axis over that of the errors, with room for the names of levels
_BEYOND = 0.06  # margin of an axis of shares, with room for a dot at its end
_SHARES = [(share, f"{share:g}") for share in (0.0, 0.25, 0.5, 0.75, 1.0)]


@drawing
def effects(tables: Tables, requirement: str) -> Figure:
    """Draw the first-order share of every axis in the variance of the error, and the rank correlation.

    Random designs have 95 % intervals.
    """
    frame = METRICS["effects"](tables)
    frame = frame[frame.requirement == requirement].sort_values("first_order", kind="stable")
    figure, grid = canvas(1, 2, 0.9 + 0.28 * len(frame), sharey=True)
    shares, correlations = grid[0]
    heights = np.arange(len(frame))
    ticks = named_ticks([axis_label(name) for name in frame.axis])
    shares.barh(heights, frame.first_order, 0.6, color=PALETTE[0])
    shares.set(yticks=ticks, xlabel="part of the variance (-)", xlim=(0.0, None))
    correlations.hlines(heights, frame.low, frame.high, color=PALETTE[0], lw=2.0)
    correlations.plot(
        frame.rank_correlation,
        heights,
        ls="none",
        marker="o",
        ms=4,
        color=PALETTE[0],
    )
    correlations.axvline(0.0, color=GREY, lw=1.0)
    correlations.set(yticks=ticks, xlabel="rank correlation (-)", xlim=(-1.0, 1.0))
    return figure


@drawing
def swings(tables: Tables, requirement: str) -> Figure:
    """Draw the error of a requirement between the ends of each axis, the most influential axis on top.

    Dots are at the ends, or at each level. Random designs have 95 % intervals.
    """
    frame = METRICS["swings"](tables)
    frame = frame[frame.requirement == requirement]
    column = errors_of(tables, designs(tables))[requirement]
    unit, factor = display_unit(tables, column)
    swing = frame.groupby("axis").error_si.agg(lambda errors: errors.max() / errors.min())
    order = sorted(dict.fromkeys(frame.axis), key=swing.get)
    figure, ax = panel(0.9 + 0.32 * len(order))
    for height, name in enumerate(order):
        rows = frame[frame.axis == name].sort_values("error_si", kind="stable")
        _draw_swing(ax, tables, rows, height, factor)
    mean = float(frame.mean_si.iloc[0])
    ax.axvline(mean * factor, color="black", lw=1.0)
    limit = limit_of(tables, requirement) * factor
    if np.isfinite(limit):
        ax.axvline(limit, color=GREY, ls="--", lw=1.0)
    columns = [frame[name].dropna() * factor for name in ("error_si", "low_si", "high_si")]
    errors = np.concatenate(columns)
    scale_up(ax, "x", errors)
    if ax.axes.get("xscale") != "log":
        ax.set(xlim=(0.0, _ROOM * errors.max()))
    ax.set(
        xlabel=f"{requirement} ({unit or '-'})",
        yticks=named_ticks([axis_label(name) for name in order]),
        ylim=(-0.6, len(order) - 0.4),
        margin=_ROOM - 1.0,
    )
    return figure


def _draw_swing(ax: Panel, tables: Tables, rows: pd.DataFrame, height: int, factor: float) -> None:
    """Draw the errors of one axis as a bar with dots and intervals, and write the levels at its ends.

    rows : rows of the metric `swings` for one axis, smallest error first
    factor : from SI to the unit of the figure
    """
    error = rows.error_si.to_numpy() * factor
    low = rows.low_si * factor
    high = rows.high_si * factor
    heights = [height] * len(rows)
    ax.boxes(
        error[0],
        error[-1],
        height - 0.3,
        height + 0.3,
        color=PALETTE[0],
        alpha=0.35,
    )
    ax.hlines(heights, low, high, color=PALETTE[0], lw=2.0)
    ax.plot(error, heights, ls="none", marker="o", ms=4, color=PALETTE[0])
    ends = rows.iloc[[0, -1]].itertuples()
    first_level, last_level = (value_of(tables, row) for row in ends)
    right_end = np.nanmax([*error, *high])
    ax.text(right_end, height, f"  {first_level} … {last_level}", ha="left")


@drawing
def regions(tables: Tables) -> Figure:
    """Draw the share of designs that meet all requirements along each axis; random designs have 95 % intervals."""
    frame = METRICS["regions"](tables)
    frame = frame[frame.requirement == ALL]
    names = list(dict.fromkeys(frame.axis))
    columns = min(_ACROSS, max(1, len(names)))
    n_rows = -(-len(names) // columns)
    figure, grid = canvas(n_rows, columns, 2.0, sharey=True)
    for number, name in enumerate(names):
        row, column = divmod(number, columns)
        ax = grid[row][column]
        rows = frame[frame.axis == name]
        if rows.level.astype(bool).any():
            places = np.arange(len(rows), dtype=float)
            ax.set(xticks=named_ticks(list(rows.level)), xlabel=axis_label(name), margin=0.3)
        else:
            places = _region_centres(ax, tables, rows, name)
        ax.vlines(places, rows.share_low, rows.share_high, color=PALETTE[0], lw=2.0)
        ax.plot(places, rows.share, ls="none", marker="o", ms=4, color=PALETTE[0])
        ax.set(ylim=(-_BEYOND, 1.0 + _BEYOND), yticks=_SHARES)
        if column == 0:
            ax.set(ylabel="share that meets all (-)")
    return figure


def _region_centres(ax: Panel, tables: Tables, rows: pd.DataFrame, name: str) -> pd.Series:
    """Return the centres of the parts of a numeric axis in display units, and set the scale and label of its panel.

    rows : parts of the axis, with bounds `low` and `high`
    name : name of the axis
    """
    unit, factor = display_unit(tables, name)
    label = axis_label(name)
    if unit:
        label = f"{label} ({unit})"
    ax.set(xlabel=label)
    is_positive = bool((rows.low > 0.0).all())
    if is_positive and rows.high.max() > 20.0 * rows.low.min():
        ax.set(xscale="log")
        geometric_mean = np.sqrt(rows.low * rows.high)
        return geometric_mean * factor
    mean = 0.5 * (rows.low + rows.high)
    return mean * factor


def ratios(evaluations: pd.DataFrame, answers: pd.DataFrame, name: str) -> Figure:
    """Draw every requirement's ratio of error to limit along a field, by case and by filter; dots are the solutions."""
    figure, ax = panel(3.2)
    groups = evaluations.groupby(["case", "tuning", "requirement"], sort=False)
    for number, (names, rows) in enumerate(groups):
        ax.plot(rows.value, rows.ratio, label=_label_without_base(names), **line_of(number))
    ax.plot(
        answers.answer,
        np.ones(len(answers)),
        ls="none",
        marker="o",
        color="black",
        ms=4,
    )
    ax.axhline(1.0, color=GREY, ls="--", lw=1.0)
    scale_up(ax, "x", evaluations.value, from_zero=False)
    scale_up(ax, "y", evaluations.ratio)
    unit = evaluations.unit.iloc[0] or "-"
    ax.set(xlabel=f"{name} ({unit})", ylabel="error over its limit (-)")
    return figure


def _label_without_base(names: Sequence[str]) -> str:
    """Return the names of case, tuning and requirement as a label; "base" is not written."""
    return ", ".join(str(name) for name in names if str(name) != "base")


def boundary(answers: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Draw the largest value of the first field along the second: below a curve the requirements are met."""
    figure, ax = panel(3.2)
    groups = answers.groupby(["case", "tuning"], sort=False)
    for number, (case_and_tuning, rows) in enumerate(groups):
        label = _label_without_base(case_and_tuning)
        ax.plot(rows.along, rows.answer, marker="o", ms=3, label=label, **line_of(number))
    scale_up(ax, "x", answers.along, from_zero=False)
    scale_up(ax, "y", answers.answer)
    unit = answers.unit.iloc[0] or "-"
    along_unit = answers.along_unit.iloc[0] or "-"
    along_label = f"{names[1]} ({along_unit})"
    label = f"{names[0]} ({unit})"
    ax.set(xlabel=along_label, ylabel=label)
    return figure


def indices(frame: pd.DataFrame) -> Figure:
    """Draw first-order and total indices of every source, frozen and re-tuned."""
    figure, grid = canvas(1, 2, 0.9 + 0.26 * len(frame), sharey=True)
    heights = np.arange(len(frame))[::-1]
    ticks = named_ticks(list(frame.source)[::-1])
    for ax, gains in zip(grid[0], ("frozen", "retuned"), strict=True):
        for offset, order, number in ((0.2, "first", 0), (-0.2, "total", 1)):
            colour = line_of(number)["color"]
            index = frame[f"{gains}_{order}"]
            ax.barh(heights + offset, index, 0.36, color=colour, label=order)
        gains_name = gains.replace("retuned", "re-tuned")
        ax.set(yticks=ticks, xlabel=f"index, {gains_name} (-)")
    return figure
