"""Many designs: which axes matter, and what share of the designs meets the requirements in each part of an axis."""

import numpy as np

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.space import ALL, axis_label, people_of
from lvnav_trade.plots.figure import GREY, Figure, canvas, named_ticks
from lvnav_trade.plots.style import PALETTE, drawing
from lvnav_trade.store.read import Tables

_ACROSS = 3


@drawing
def effects(tables: Tables, requirement: str) -> Figure:
    """Draw for every axis the part of the error's variance that it explains alone, and the rank correlation with its
    95 % interval.
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
def regions(tables: Tables) -> Figure:
    """Draw the share of the designs that meet all requirements over each axis, with its 95 % interval."""
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
        ax.set(ylim=(0.0, 1.0))
        if number % columns == 0:
            ax.set(ylabel="share that meets all (-)")
    return figure
