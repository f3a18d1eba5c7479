"""The error budget: variance by source over time with the filter's own on it, and when each source acted."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from lvnav_trade.metrics.basics.select import history_of, pick
from lvnav_trade.metrics.errors.covariances import contributions
from lvnav_trade.plots.style import PALETTE, canvas, drawing, legend_below, mark_events, over_time
from lvnav_trade.store.read import Tables

MOST_SOURCES = 7
MOST_ROWS = 12
_SOURCES = (*PALETTE[:6], "#8C6D31")
REST = "all others"
_REST = "#c4c9d1"
# Every other layer is hatched: neighbours differ in black and white.
_HATCHES = ("", "////", "", "....", "", "xxxx", "", "")
_BIASED = 0.01  # part of the mean square from which on the mean error is drawn beside the variance
# Percent: smaller contributions are left white, sources with a smaller sum are drawn together.
_LEAST, _LEAST_ROW = 1e-2, 0.05


@drawing
def budget(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw the true variance of a 3-D error over time, source on source, and its parts.

    Above, a sandpile: heights are variances on an axis scaled and labelled as their root, so that the top of the pile
    reads as one sigma of the true error and squares add; the line is the filter's own sigma. Where the pile rises above
    the line the filter is optimistic, by what lies between. Below, the same layers as parts of the true variance.
    """
    rows = pick(tables.budget, case=case, event="", quantity=quantity, axis="3d")
    layers = _layers(rows.pivot_table(index="t_s", columns="source", values="share_ratio", sort=False) * 100.0)
    unit, factor = tables.people[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d").set_index("t_s")
    true, formal, mean = ((history[f"lincov_{name}_si"] * factor) ** 2 for name in ("true", "formal", "mean"))
    figure, grid = canvas(2, 1, 2.35, sharex=True)
    pile, parts = grid[:, 0]
    variance = layers.mul(true.reindex(layers.index), axis=0) / 100.0
    _stack(pile, variance)
    pile.plot(formal.index, formal, color="black", lw=2.6)
    pile.plot(formal.index, formal, color="white", lw=1.1, ls="--")
    biased = bool((mean >= _BIASED * (mean + true)).any())
    if biased:
        pile.plot(mean.index, mean, color="black", lw=1.0, ls="-.", label="mean, the same in every flight")
    _root_axis(pile, float(max(variance.sum(axis=1).max(), formal.max(), mean.max() if biased else 0.0)))
    pile.set_ylabel(f"{quantity} error, 3D\n({unit}, 1 sigma)")
    _stack(parts, layers)
    parts.set(ylim=(0, 100), ylabel="part of the true\nvariance (%)")
    over_time(grid[:, 0], tables, case, margin=0.0)
    pile.plot([], [], color="black", lw=1.6, ls=(0, (3, 1)), label="filter's own sigma")
    return legend_below(figure, pile)


def _layers(share: pd.DataFrame) -> pd.DataFrame:
    order = share.mean().sort_values(ascending=False, kind="stable").index
    found = share[list(order[:MOST_SOURCES])].copy()
    if len(order) > MOST_SOURCES:
        found[REST] = share[list(order[MOST_SOURCES:])].sum(axis=1)
    return found


def _stack(ax: Any, layers: pd.DataFrame) -> None:
    ax.grid(visible=False)
    colours = [_REST if name == REST else _SOURCES[k] for k, name in enumerate(layers.columns)]
    drawn = ax.stackplot(layers.index, layers.to_numpy().T, labels=list(layers.columns), colors=colours, linewidth=0)
    for layer, hatch in zip(drawn, _HATCHES, strict=False):
        layer.set_hatch(hatch)
        layer.set_edgecolor("white")


def _root_axis(ax: Any, top: float) -> None:
    ax.set_yscale("function", functions=(lambda y: np.sqrt(np.maximum(y, 0.0)), np.square))
    ax.set_ylim(0.0, max(top * 1.08, 1e-300))
    step = _round_step(np.sqrt(top) / 4.0) if top > 0 else 1.0
    ax.set_yticks(np.arange(0.0, np.sqrt(max(top, 0.0)) * 1.04 + 1e-12, step) ** 2)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{np.sqrt(max(y, 0.0)):.4g}"))
    ax.minorticks_off()


def _round_step(step: float) -> float:
    """Return 1, 2 or 5 times a power of ten, next above."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= step * 0.999))


@drawing
def heatmap(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw what each source put into a 3-D error at the explained event, and when: sources x time, largest on top.

    What is drawn once (constant errors, initial errors) stands in a column of its own: the start. At the right the sum.
    """
    rows = pick(contributions(tables), case=tables.labels[case], metric=f"{quantity}_error")
    total = rows.groupby("source", sort=False).share_ratio.sum().sort_values(ascending=False, kind="stable") * 100.0
    names = list(total.index[total >= _LEAST_ROW][:MOST_ROWS])
    rest = [name for name in total.index if name not in names]
    edges = np.unique(np.concatenate([rows.t_start_s, rows.t_end_s]))
    wide = rows.pivot_table(index="source", columns="t_start_s", values="share_ratio", sort=False) * 100.0
    if rest:
        wide.loc[REST] = wide.loc[rest].sum()
        total[REST] = total[rest].sum()
        names.append(REST)
    image = wide.reindex(index=names, columns=edges[:-1]).to_numpy()
    event = rows.event.iloc[0].replace("_", " ")
    figure, grid = canvas(1, 2, 1.15 + 0.25 * max(2, len(names)), sharey=True, width_ratios=[1, 18])
    start, ax = grid[0]
    scale = LogNorm(_LEAST, max(float(np.nanmax(image)), 10 * _LEAST))
    _cells(start, np.array([0.0, 1.0]), image[:, :1], scale)
    label = f"part of the variance at\n{event}, per {edges[1] - edges[0]:g} s (%)"
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    cells = _cells(ax, edges[1:], image[:, 1:], scale)
    figure.colorbar(cells, ax=ax, pad=0.09, fraction=0.035, label=label, format=plain)
    start.set(yticks=np.arange(len(names)) + 0.5, yticklabels=names, xticks=[0.5], xticklabels=["at the\nstart"])
    start.set(xlabel="drawn", ylabel="error source", ylim=(len(names), 0.0))
    for row, name in enumerate(names):
        ax.text(1.01, row + 0.5, f"{total[name]:.1f} %", transform=ax.get_yaxis_transform(), va="center", fontsize=7.5)
    ax.set_xlabel("time since lift-off (s), when the error was made")
    mark_events(ax, pick(tables.events, case=case))
    return figure


def _cells(ax: Any, edges: Any, image: Any, scale: LogNorm) -> Any:
    ax.grid(visible=False)
    ax.tick_params(axis="y", length=0)
    shown = np.ma.masked_less(np.ma.masked_invalid(image), _LEAST)
    return ax.pcolormesh(edges, np.arange(image.shape[0] + 1), shown, norm=scale, cmap="YlGnBu")
