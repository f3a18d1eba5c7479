"""Figures of design spaces and of searches."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, line_of, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import ALL, axis_label, errors_of, people_of
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
    at, names = np.arange(len(frame)), named_ticks([axis_label(name) for name in frame.axis])
    grid[0][0].barh(at, frame.first_order, 0.6, color=PALETTE[0])
    grid[0][0].set(yticks=names, xlabel="part of the variance (-)", xlim=(0.0, None))
    ax = grid[0][1]
    ax.hlines(at, frame.low, frame.high, color=PALETTE[0], lw=2.0)
    ax.plot(frame.rank_correlation, at, ls="none", marker="o", ms=4, color=PALETTE[0])
    ax.axvline(0.0, color=GREY, lw=1.0)
    ax.set(yticks=names, xlabel="rank correlation (-)", xlim=(-1.0, 1.0))
    return figure


@drawing
def swings(tables: Tables, requirement: str) -> Figure:
    """Draw the error of a requirement between the ends of each axis, the most influential axis on top.

    Dots are at the ends, or at each level. Random designs have 95 % intervals.
    """
    frame = METRICS["swings"](tables)
    frame = frame[frame.requirement == requirement]
    unit, factor = people_of(tables, errors_of(tables, designs(tables))[requirement])
    groups = dict(list(frame.groupby("axis", sort=False)))
    order = sorted(groups, key=lambda name: groups[name].error_si.max() / groups[name].error_si.min())
    figure, ax = panel(0.9 + 0.32 * len(order))
    for at, name in enumerate(order):
        rows = groups[name].sort_values("error_si", kind="stable")
        error = rows.error_si.to_numpy() * factor
        ax.boxes(error[0], error[-1], at - 0.3, at + 0.3, color=PALETTE[0], alpha=0.35)
        ax.hlines([at] * len(rows), rows.low_si * factor, rows.high_si * factor, color=PALETTE[0], lw=2.0)
        ax.plot(error, [at] * len(rows), ls="none", marker="o", ms=4, color=PALETTE[0])
        low, high = (value_of(tables, row) for row in rows.iloc[[0, -1]].itertuples())
        ax.text(np.nanmax([*error, *rows.high_si * factor]), at, f"  {low} … {high}", ha="left")
    ax.axvline(float(frame.mean_si.iloc[0]) * factor, color="black", lw=1.0)
    limit = limit_of(tables, requirement) * factor
    if np.isfinite(limit):
        ax.axvline(limit, color=GREY, ls="--", lw=1.0)
    errors = np.concatenate([frame[name].dropna() * factor for name in ("error_si", "low_si", "high_si")])
    scale_up(ax, "x", errors)
    if ax.axes.get("xscale") != "log":
        ax.set(xlim=(0.0, _ROOM * errors.max()))
    ax.set(yticks=named_ticks([axis_label(name) for name in order]), ylim=(-0.6, len(order) - 0.4), margin=_ROOM - 1.0)
    ax.set(xlabel=f"{requirement} ({unit or '-'})")
    return figure


@drawing
def regions(tables: Tables) -> Figure:
    """Draw the share of designs that meet all requirements along each axis; random designs have 95 % intervals."""
    frame = METRICS["regions"](tables)
    frame = frame[frame.requirement == ALL]
    names = list(dict.fromkeys(frame.axis))
    columns = min(_ACROSS, max(1, len(names)))
    figure, grid = canvas(-(-len(names) // columns), columns, 2.0, sharey=True)
    for number, name in enumerate(names):
        ax, rows = grid[number // columns][number % columns], frame[frame.axis == name]
        if rows.level.astype(bool).any():
            at = np.arange(len(rows), dtype=float)
            ax.set(xticks=named_ticks(list(rows.level)), xlabel=axis_label(name), margin=0.3)
        else:
            unit, factor = people_of(tables, name)
            positive = bool((rows.low > 0.0).all()) and rows.high.max() > 20.0 * rows.low.min()
            at = np.sqrt(rows.low * rows.high) * factor if positive else 0.5 * (rows.low + rows.high) * factor
            label = f"{axis_label(name)} ({unit})" if unit else axis_label(name)
            ax.set(xlabel=label, **({"xscale": "log"} if positive else {}))
        ax.vlines(at, rows.share_low, rows.share_high, color=PALETTE[0], lw=2.0)
        ax.plot(at, rows.share, ls="none", marker="o", ms=4, color=PALETTE[0])
        ax.set(ylim=(-_BEYOND, 1.0 + _BEYOND), yticks=_SHARES)
        if number % columns == 0:
            ax.set(ylabel="share that meets all (-)")
    return figure


def ratios(scanned: pd.DataFrame, answers: pd.DataFrame, name: str) -> Figure:
    """Draw every requirement's ratio of error to limit along a field, by case and by filter; dots are the solutions."""
    figure, ax = panel(3.2)
    groups = scanned.groupby(["case", "tuning", "requirement"], sort=False)
    for number, ((case, way, requirement), rows) in enumerate(groups):
        label = ", ".join(label_item for label_item in (str(case), str(way), str(requirement)) if label_item != "base")
        ax.plot(rows.value, rows.ratio, label=label, **line_of(number))
    ax.plot(answers.answer, np.ones(len(answers)), ls="none", marker="o", color="black", ms=4)
    ax.axhline(1.0, color=GREY, ls="--", lw=1.0)
    scale_up(ax, "x", scanned.value, from_zero=False)
    scale_up(ax, "y", scanned.ratio)
    ax.set(xlabel=f"{name} ({scanned.unit.iloc[0] or '-'})", ylabel="error over its limit (-)")
    return figure


def boundary(answers: pd.DataFrame, names: Sequence[str]) -> Figure:
    """Draw the largest value of the first field along the second: below a curve the requirements are met."""
    figure, ax = panel(3.2)
    for number, ((case, way), rows) in enumerate(answers.groupby(["case", "tuning"], sort=False)):
        label = ", ".join(label_item for label_item in (str(case), str(way)) if label_item != "base")
        ax.plot(rows.along, rows.answer, marker="o", ms=3, label=label, **line_of(number))
    scale_up(ax, "x", answers.along, from_zero=False)
    scale_up(ax, "y", answers.answer)
    first, second = answers.unit.iloc[0] or "-", answers.along_unit.iloc[0] or "-"
    ax.set(xlabel=f"{names[1]} ({second})", ylabel=f"{names[0]} ({first})")
    return figure


def indices(frame: pd.DataFrame) -> Figure:
    """Draw first-order and total indices of every source, frozen and re-tuned."""
    figure, grid = canvas(1, 2, 0.9 + 0.26 * len(frame), sharey=True)
    at = np.arange(len(frame))[::-1]
    for ax, way in zip(grid[0], ("frozen", "retuned"), strict=True):
        for shift, order, number in ((0.2, "first", 0), (-0.2, "total", 1)):
            colour = line_of(number)["color"]
            ax.barh(at + shift, frame[f"{way}_{order}"], 0.36, color=colour, label=order)
        ax.set(yticks=named_ticks(list(frame.source)[::-1]), xlabel=f"index, {way.replace('retuned', 're-tuned')} (-)")
    return figure
