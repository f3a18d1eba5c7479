"""Figures of searches: the error over its limit along a field, boundaries, sensitivity indices."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import GREY, Figure, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import line_of, scale_up


def ratios(scanned: pd.DataFrame, answers: pd.DataFrame, name: str) -> Figure:
    """Draw every requirement's error over its limit along a field, case by case and filter by filter; dots: answers."""
    figure, ax = panel(3.2)
    groups = scanned.groupby(["case", "tuning", "requirement"], sort=False)
    for number, ((case, way, requirement), rows) in enumerate(groups):
        label = ", ".join(part for part in (str(case), str(way), str(requirement)) if part != "base")
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
        label = ", ".join(part for part in (str(case), str(way)) if part != "base")
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
