"""Errors along a numeric axis with their limits and crossings; tornado plot of axes varied one at a time."""

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import drawing, line_of, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import Tables

_MOST = 8  # largest number of curves in a panel


@drawing
def curves(tables: Tables, axis: str) -> Figure:
    """Draw, for each requirement, the P-quantile of the error along a numeric axis, where P is the required
    probability.

    Lines are linear covariance, dots are runs, the dashed line is the limit, crosses mark where a curve reaches it.
    """
    frame = METRICS["curves"](tables)
    frame = frame[frame.axis == axis]
    crossings = METRICS["crossings"](tables)
    crossings = crossings[(crossings.axis == axis) & (crossings.by == "linear covariance")]
    names = list(dict.fromkeys(frame.requirement))
    figure, grid = canvas(len(names), 1, 2.6)
    axis_name = axis.replace("_", " ")
    for ax, name in zip(grid[:, 0], names, strict=True):
        rows = frame[frame.requirement == name]
        requirement_crossings = crossings[crossings.requirement == name]
        _draw_curves(ax, rows, requirement_crossings)
        axis_unit = rows.axis_unit.iloc[0] or "-"
        unit = rows.unit.iloc[0]
        ax.set(
            xlabel=f"{axis_name} ({axis_unit})",
            ylabel=f"{name} ({unit})",
        )
    return figure


def _draw_curves(ax: Panel, rows: pd.DataFrame, crossings: pd.DataFrame) -> None:
    """Draw the curves of one requirement, one for each combination of the other axes, with limit and crossings.

    rows : rows of the curves of this requirement
    crossings : rows with the values at which the curves reach the limit
    """
    groups = list(rows.groupby("others", sort=False))
    for number, (other_levels, curve) in enumerate(groups[:_MOST]):
        style = line_of(number)
        ax.plot(curve.value, curve.lincov, label=other_levels or "linear covariance", **style)
        run_errors = curve.monte_carlo.replace(np.inf, np.nan)  # infinite where a run failed
        ax.plot(curve.value, run_errors, ls="none", marker="o", ms=3, color=style["color"])
    limit = float(rows.limit.iloc[0])
    ax.axhline(limit, color=GREY, ls="--", lw=1.0)
    ax.plot(
        crossings.crossing,
        np.full(len(crossings), limit),
        ls="none",
        marker="x",
        color="black",
        ms=5,
    )
    run_errors = rows.monte_carlo.replace(np.inf, np.nan)
    scale_up(ax, "y", [*rows.lincov, *run_errors, limit])
    scale_up(ax, "x", rows.value, from_zero=False)


@drawing
def tornado(tables: Tables, requirement: str) -> Figure:
    """Draw the change of a requirement's error from the base for every axis that is varied alone."""
    frame = METRICS["tornado"](tables)
    frame = frame[frame.requirement == requirement].iloc[::-1]
    figure, ax = panel(0.9 + 0.3 * len(frame))
    heights = np.arange(len(frame))
    bottom = heights - 0.3
    top = heights + 0.3
    ax.boxes(frame.low, frame.high, bottom, top, color=line_of(0)["color"])
    ax.axvline(float(frame.base.iloc[0]), color="black", lw=1.0)
    ax.axvline(float(frame.limit.iloc[0]), color=GREY, ls="--", lw=1.0)
    for height, row in enumerate(frame.itertuples()):
        ax.text(row.low, height, f"{row.low_level} ", ha="right")
        ax.text(row.high, height, f" {row.high_level}", ha="left")
    axis_names = [name.replace("_", " ") for name in frame.axis]
    unit = frame.unit.iloc[0]
    ax.set(
        xlabel=f"{requirement} ({unit})",
        yticks=named_ticks(axis_names),
        margin=0.25,
    )
    return figure


@drawing
def pareto(tables: Tables) -> Figure:
    """Draw the largest ratio of error to limit of every case against its cost, or against its mass without costs.

    Dominated cases are grey; a cross marks a violated requirement.
    """
    frame = METRICS["pareto"](tables)
    if frame.cost.notna().all():
        column, label = "cost", "cost"
    else:
        column, label = "mass_kg", "mass (kg)"
    figure, ax = panel(3.4)
    for number, row in enumerate(frame.sort_values(column).itertuples()):
        colour = line_of(0)["color"] if row.front else GREY
        marker = "o" if row.meets else "x"
        x = float(getattr(row, column))
        ax.plot([x], [row.error_ratio], ls="none", marker=marker, color=colour, ms=5)
        alignment = "bottom" if number % 2 == 0 else "top"  # names of neighbours do not overlap
        ax.text(x, row.error_ratio, f"  {row.case}", ha="left", va=alignment, color=colour)
    ax.axhline(1.0, color=GREY, ls="--", lw=1.0)
    scale_up(ax, "x", frame[column], from_zero=False)
    scale_up(ax, "y", frame.error_ratio)
    ax.set(xlabel=label, ylabel="largest error over its limit (-)", margin=0.2)
    return figure
