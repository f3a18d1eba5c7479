"""Errors along a numeric axis with their limits and crossings; tornado plot of axes varied one at a time."""

import numpy as np

from lvnav_trade.report.figures.figure import GREY, Figure, canvas, named_ticks, panel
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
    crossing = METRICS["crossings"](tables)
    crossing = crossing[(crossing.axis == axis) & (crossing.by == "linear covariance")]
    names = list(dict.fromkeys(frame.requirement))
    figure, grid = canvas(len(names), 1, 2.6)
    for ax, name in zip(grid[:, 0], names, strict=True):
        rows = frame[frame.requirement == name]
        for number, (other_levels, curve) in enumerate(list(rows.groupby("others", sort=False))[:_MOST]):
            ax.plot(curve.value, curve.lincov, label=other_levels or "linear covariance", **line_of(number))
            dots = {"ls": "none", "marker": "o", "ms": 3, "color": line_of(number)["color"]}
            ax.plot(curve.value, curve.monte_carlo.replace(np.inf, np.nan), **dots)
        limit, unit = float(rows.limit.iloc[0]), rows.unit.iloc[0]
        ax.axhline(limit, color=GREY, ls="--", lw=1.0)
        crossings = crossing[crossing.requirement == name].crossing
        ax.plot(crossings, np.full(len(crossings), limit), ls="none", marker="x", color="black", ms=5)
        errors = [*rows.lincov, *rows.monte_carlo.replace(np.inf, np.nan), limit]
        scale_up(ax, "y", errors)
        scale_up(ax, "x", rows.value, from_zero=False)
        ax.set(ylabel=f"{name} ({unit})", xlabel=f"{axis.replace('_', ' ')} ({rows.axis_unit.iloc[0] or '-'})")
    return figure


@drawing
def tornado(tables: Tables, requirement: str) -> Figure:
    """Draw the change of a requirement's error from the base for every axis that is varied alone."""
    frame = METRICS["tornado"](tables)
    frame = frame[frame.requirement == requirement].iloc[::-1]
    figure, ax = panel(0.9 + 0.3 * len(frame))
    at = np.arange(len(frame))
    ax.boxes(frame.low, frame.high, at - 0.3, at + 0.3, color=line_of(0)["color"])
    ax.axvline(float(frame.base.iloc[0]), color="black", lw=1.0)
    ax.axvline(float(frame.limit.iloc[0]), color=GREY, ls="--", lw=1.0)
    for row, low, high in zip(at, frame.low_level, frame.high_level, strict=True):
        ends = frame.iloc[row]
        ax.text(ends.low, row, f"{low} ", ha="right")
        ax.text(ends.high, row, f" {high}", ha="left")
    ax.set(yticks=named_ticks([name.replace("_", " ") for name in frame.axis]), margin=0.25)
    ax.set(xlabel=f"{requirement} ({frame.unit.iloc[0]})")
    return figure


@drawing
def pareto(tables: Tables) -> Figure:
    """Draw the largest ratio of error to limit of every case against its cost, or against its mass without costs.

    Dominated cases are grey; a cross marks a violated requirement.
    """
    frame = METRICS["pareto"](tables)
    column, label = ("cost", "cost") if frame.cost.notna().all() else ("mass_kg", "mass (kg)")
    figure, ax = panel(3.4)
    for number, row in enumerate(frame.sort_values(column).itertuples()):
        colour = line_of(0)["color"] if row.front else GREY
        x = float(getattr(row, column))
        ax.plot([x], [row.error_ratio], ls="none", marker="o" if row.meets else "x", color=colour, ms=5)
        ax.text(x, row.error_ratio, f"  {row.case}", ha="left", va=("bottom", "top")[number % 2], color=colour)
    ax.axhline(1.0, color=GREY, ls="--", lw=1.0)
    scale_up(ax, "x", frame[column], from_zero=False)
    scale_up(ax, "y", frame.error_ratio)
    ax.set(xlabel=label, ylabel="largest error over its limit (-)", margin=0.2)
    return figure
