"""Delays of the signals over time: of troposphere and ionosphere, what a correction leaves of them, and latency."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.plots.style import GREY, PALETTE, canvas, drawing, event_key, legend_below, over_time, panel, scale_up
from lvnav_trade.store import Tables

LAYERS = ("troposphere", "ionosphere")
_LEAST = 1e-3
"""Metres: less is not drawn where an axis is logarithmic."""


def layers_of(rows: pd.DataFrame) -> list[str]:
    """Return the layers that delay, or are corrected for, in rows of the table `satellites`."""
    return [layer for layer in LAYERS if (rows[[f"{layer}_m", f"{layer}_left_m"]].abs() >= _LEAST).any(axis=None)]


@drawing
def delays(tables: Tables, case: str) -> Figure:
    """Draw the true delay of every satellite tracked, and below it what the filter's correction leaves of it."""
    rows = pick(tables.satellites, case=case)
    layers = layers_of(rows) or list(LAYERS[:1])
    figure, grid = canvas(2, len(layers), 2.3, sharex=True)
    for panels, layer in zip(grid.T, layers, strict=True):
        true, left = panels
        _lines(true, rows, f"{layer}_m", PALETTE[0])
        _lines(left, rows, f"{layer}_left_m", PALETTE[1])
        drawn = rows[f"{layer}_m"][rows[f"{layer}_m"] >= _LEAST]
        scale_up(true.yaxis, drawn)
        if true.get_yscale() == "log":
            true.set_ylim(bottom=0.7 * drawn.min())
        left.axhline(0.0, color="black", lw=0.7)
        true.set_ylabel(f"{layer}, true\ndelay (m)")
        left.set_ylabel(f"{layer}, left by\nthe correction (m)")
        over_time(panels, tables, case, numbers=len(layers) > 1)
    legend_below(figure, grid[0, 0])
    if len(layers) > 1:
        figure.legends[0].set_title(event_key(pick(tables.events, case=case)), FontProperties(size=7.5))
        figure.legends[0].get_title().set_color(GREY)
    return figure


def _lines(axes: Any, rows: pd.DataFrame, column: str, colour: str) -> None:
    """Draw a thin line for each satellite, broken where it is not tracked, and their median as a thick one."""
    times = pd.Index(np.sort(rows.t_s.unique()))
    for number, (_, one) in enumerate(rows.groupby("satellite")):
        label = "each satellite tracked" if number == 0 else None
        axes.plot(times, one.set_index("t_s")[column].reindex(times), color=colour, lw=0.6, alpha=0.6, label=label)
    median = rows.groupby("t_s")[column].median().reindex(times)
    axes.plot(times, median, color="black", lw=1.7, label="their median")


@drawing
def latency(tables: Tables, case: str) -> Figure:
    """Draw how old measurements are when the filter takes them for present."""
    rows = pick(tables.satellites, case=case).drop_duplicates("t_s")
    figure, ax = panel(2.3)
    age = rows.latency_s * 1e3
    ax.step(rows.t_s, age, where="post", color=PALETTE[0])
    ax.set(ylim=(0.0, max(1.0, 1.15 * float(age.max()))), ylabel="age of the\nmeasurements (ms)")
    over_time([ax], tables, case)
    return figure
