"""Error budget: variance by source over time compared with the filter's own, and when each source contributed."""

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.figure import Figure, Panel, canvas, named_ticks
from lvnav_trade.report.figures.style import PALETTE, drawing, over_time
from lvnav_trade.results.evaluation.covariances import contributions
from lvnav_trade.results.statistics.select import cache_result, history_of, pick
from lvnav_trade.results.tables.read import Tables

MOST_SOURCES = 7
MOST_ROWS = 12
_SOURCES = (*PALETTE[:6], "#8C6D31")
REST = "all others"
_REST = "#c4c9d1"
# Every other layer is hatched: neighbours differ in black and white.
_HATCHES = ("", "////", "", "....", "", "xxxx", "", "")
_MAP = "YlGnBu"
_BIASED = 0.01  # share of the mean square from which the mean error is drawn in addition to the variance
# Percent: smaller contributions are white; sources with a smaller sum are combined.
_LEAST, _LEAST_ROW = 1e-2, 0.05


@drawing
def budget(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw the true variance of a 3-D error over time, stacked by source, and the shares of the sources.

    In the upper panel, heights are variances, and the axis is labelled with their square root. The top of the stack is
    therefore one sigma of the true error. The line is the filter's own sigma; the filter is optimistic where the stack
    exceeds it. The lower panel has the same layers as shares of the true variance.
    """
    rows = pick(tables.budget, case=case, event="", quantity=quantity, axis="3d")
    share = rows.pivot_table(index="t_s", columns="source", values="share_ratio", sort=False)
    share *= 100.0
    order = _source_order(tables)
    layers = _layers(share, order)
    colours = _colours(list(layers), order)

    unit, factor = tables.display_units[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d").set_index("t_s")
    true_variance = (history.lincov_true_si * factor) ** 2
    formal_variance = (history.lincov_formal_si * factor) ** 2
    mean_square = (history.lincov_mean_si * factor) ** 2
    variances = layers.mul(true_variance.reindex(layers.index), axis=0) / 100.0
    top = [variances.sum(axis=1).max(), formal_variance.max(), 0.0]

    figure, grid = canvas(2, 1, 2.35, sharex=True)
    stack, shares = grid[:, 0]
    _draw_layers(stack, variances, colours)
    stack.plot(formal_variance.index, formal_variance, color="black", lw=2.6)
    stack.plot(
        formal_variance.index,
        formal_variance,
        color="white",
        lw=1.1,
        ls="--",
        label="filter's own sigma (white on black)",
    )
    if (mean_square >= _BIASED * (mean_square + true_variance)).any():
        stack.plot(
            mean_square.index,
            mean_square,
            color="black",
            lw=1.0,
            ls="-.",
            label="mean, the same in every run",
        )
        top[-1] = mean_square.max()
    _set_root_axis(stack, float(max(top)))
    stack.set(ylabel=f"{quantity} error, 3D\n({unit}, 1 sigma)")
    _draw_layers(shares, layers, colours)
    shares.set(ylim=(0.0, 100.0), ylabel="part of the true\nvariance (%)")
    over_time(grid[:, 0], tables, case, margin=0.0)
    return figure


@cache_result
def _source_order(tables: Tables) -> list[str]:
    """Return the sources of all cases and quantities, largest mean share first: all stacks of a report agree."""
    rows = pick(tables.budget, event="", axis="3d")
    mean_share = rows.groupby("source", sort=False).share_ratio.mean()
    return list(mean_share.sort_values(ascending=False, kind="stable").index)


def _layers(share: pd.DataFrame, order: list[str]) -> pd.DataFrame:
    """Return the shares over time of the largest sources, in an order of all sources, and of all others together."""
    mean_share = share.mean().sort_values(ascending=False, kind="stable")
    largest = list(mean_share.index[:MOST_SOURCES])
    ordered_sources = sorted(largest, key=order.index)
    layers = share[ordered_sources].copy()
    if share.shape[1] > MOST_SOURCES:
        layers[REST] = share.drop(columns=largest).sum(axis=1)
    return layers


def _colours(names: list[str], order: list[str]) -> list[str]:
    """Return a colour for each layer by its position in the order; if two layers share a colour, the later gets
    another.
    """
    colours: dict[str, str] = {REST: _REST}
    for name in names:
        if name == REST:
            continue
        first = order.index(name) % len(_SOURCES)
        candidates = (*_SOURCES[first:], *_SOURCES[:first])
        unused_colours = [colour for colour in candidates if colour not in colours.values()]
        colours[name] = unused_colours[0]
    return [colours[name] for name in names]


def _draw_layers(ax: Panel, layers: pd.DataFrame, colours: list[str]) -> None:
    """Draw the columns of a table, by time, as stacked areas, each in its colour."""
    ax.set(grid=False)
    upper = layers.cumsum(axis=1)
    lower = upper.shift(axis=1, fill_value=0.0)
    for name, colour, hatch in zip(layers.columns, colours, _HATCHES, strict=False):
        ax.fill_between(
            layers.index,
            lower[name],
            upper[name],
            color=colour,
            hatch=hatch,
            ec="white",
            label=name,
        )


def _set_root_axis(ax: Panel, top: float) -> None:
    """Set the ordinate of a panel of variances, labelled with their square roots.

    top : largest variance
    """
    step = _round_step(np.sqrt(top) / 4.0) if top > 0 else 1.0
    largest_sigma = np.sqrt(max(top, 0.0))
    sigmas = np.arange(0.0, largest_sigma * 1.04 + 1e-12, step)
    ticks = [(sigma**2, f"{sigma:.4g}") for sigma in map(float, sigmas)]
    ax.set(yscale="root", ylim=(0.0, max(top * 1.08, 1e-300)), yticks=ticks)


def _round_step(step: float) -> float:
    """Return the next larger number of the form 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(step))
    for multiple in (1.0, 2.0, 5.0):
        if multiple * power >= step * 0.999:
            return float(multiple * power)
    return float(10.0 * power)


@drawing
def heatmap(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw the contribution of each source to a 3-D error at the diagnosed event, by the time at which it acted.

    Sources are rows, largest on top, and times are columns. Errors drawn once (constant and initial errors) are in the
    first column, the start. The sum is at the right.
    """
    rows = pick(contributions(tables), case=tables.labels[case], metric=f"{quantity}_error")
    event = rows.event.iloc[0].replace("_", " ")
    edges = np.unique(np.concatenate([rows.t_start_s, rows.t_end_s]))
    shares, totals = _source_shares(rows)
    image = shares.reindex(columns=edges[:-1]).to_numpy()
    largest = float(np.nanmax(image))
    scale = (_LEAST, max(largest, 10 * _LEAST))
    image = np.where(image >= _LEAST, image, np.nan)

    height = 1.15 + 0.25 * max(2, len(shares))
    figure, grid = canvas(1, 2, height, sharey=True, widths=[1, 18])
    start, ax = grid[0]
    row_edges = np.arange(len(shares) + 1)
    start.cells([0.0, 1.0], row_edges, image[:, :1], scale, cmap=_MAP)
    bin_width = edges[1] - edges[0]
    label = f"part of the variance at\n{event}, per {bin_width:g} s (%)"
    ax.cells(edges[1:], row_edges, image[:, 1:], scale, cmap=_MAP, label=label)
    for axes in (start, ax):
        axes.set(
            ylim=(float(len(shares)), 0.0),
            yticks=named_ticks(list(shares.index), 0.5),
            grid=False,
        )
    start.set(
        xticks=[(0.5, "start")],
        xlim=(0.0, 1.0),
        xlabel="drawn",
        ylabel="error source",
    )
    totals_text = [f"{total:.1f} %" for total in totals]
    row_centres = row_edges[:-1] + 0.5
    ax.text(1.01, row_centres, totals_text, x_part=True, ha="left")
    ax.set(xlim=(float(edges[1]), float(edges[-1])))
    over_time([ax], tables, case, margin=0.0, label="time since lift-off (s) at which the error enters")
    return figure


def _source_shares(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[float]]:
    """Return the share of the variance (%) by source and start of the interval, and the total of each source.

    The largest sources come first; the others are combined.

    rows : rows of `contributions` for one case and quantity
    """
    total = rows.groupby("source", sort=False).share_ratio.sum()
    total = total.sort_values(ascending=False, kind="stable") * 100.0
    large_names = total.index[total >= _LEAST_ROW]
    names = list(large_names[:MOST_ROWS])
    smaller = [name for name in total.index if name not in names]
    shares = rows.pivot_table(index="source", columns="t_start_s", values="share_ratio", sort=False)
    shares *= 100.0
    if smaller:
        shares.loc[REST] = shares.loc[smaller].sum()
        total[REST] = total[smaller].sum()
        names.append(REST)
    return shares.reindex(index=names), [total[name] for name in names]
