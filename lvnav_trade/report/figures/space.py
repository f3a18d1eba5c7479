"""Many designs: which axes matter, and what share of the designs meets the requirements in each part of an axis."""

import numpy as np

from lvnav_trade.report.figures.figure import GREY, Figure, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, scale_up
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.design_space import ALL, axis_label, errors_of, people_of
from lvnav_trade.results.evaluation.designs import designs
from lvnav_trade.results.evaluation.tornado import limit_of, value_of
from lvnav_trade.results.tables.read import Tables

_ACROSS = 3
_ROOM = 1.35  # of the range of errors: what the names of levels need at its end
_BEYOND = 0.06  # of the range of a share: what a dot at one of its ends needs
_SHARES = [(share, f"{share:g}") for share in (0.0, 0.25, 0.5, 0.75, 1.0)]


@drawing
def effects(tables: Tables, requirement: str) -> Figure:
    """Draw for every axis the part of the error's variance that it explains alone, and the rank correlation, with its
    95 % interval of designs that are drawn at random.
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
    """Draw the error of a requirement between the ends of each axis, the axis that moves it most on top: dots at the
    ends, or at each level, with 95 % intervals of designs that are drawn at random.
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
    """Draw the share of the designs that meet all requirements over each axis, with its 95 % interval of designs that
    are drawn at random.
    """
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
