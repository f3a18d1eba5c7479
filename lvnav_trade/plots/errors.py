"""Errors over time: envelopes of one case, all cases on one axis, ranking."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.intervals import rms_interval
from lvnav_trade.metrics.basics.select import lincov_rms
from lvnav_trade.metrics.errors.ranking import ranking
from lvnav_trade.plots.style import PALETTE, canvas, legend_below, line_of, look, mark_events, scale_up
from lvnav_trade.store import Tables, load


def rows_of(tables: Tables, case: str, quantity: str, axis: str) -> pd.DataFrame:
    """Return the history of one error of a case."""
    history = tables.history
    return history[(history.case == case) & (history.quantity == quantity) & (history.axis == axis)]


def envelope(results: Path | str | Tables, case: str, quantity: str) -> Figure:
    """Draw the errors of one quantity of a case, an axis below the other.

    Monte-Carlo RMS with its 95 % interval, the filter's own sigma in the runs, LinCov formal (one sigma) and true (RMS:
    sigma and mean together).
    """
    tables = load(results)
    axes_names = list(dict.fromkeys(tables.outputs[tables.outputs.quantity == quantity].axis))
    single = [name for name in axes_names if name != "3d"][:3] or axes_names
    unit, factor = tables.people[quantity, single[0]]
    with look():
        figure, grid = canvas(len(single), 1, 1.95, sharex=True)
        for number, (ax, axis) in enumerate(zip(grid[:, 0], single, strict=True)):
            rows = rows_of(tables, case, quantity, axis)
            _lines(ax, rows, factor)
            ax.set_ylabel(f"{axis}, RMS or\n1 sigma ({unit})")
            scale_up(ax.yaxis, pd.concat([rows.rms_si, rows.lincov_true_si, rows.lincov_formal_si]))
            ax.margins(x=0.01)
            mark_events(ax, tables.events[tables.events.case == case], names=number == 0)
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        legend_below(figure, grid[0, 0])
    return figure


def _lines(ax: Any, rows: pd.DataFrame, factor: float) -> None:
    n = int(rows.run_count.iloc[0])
    if n:
        low, high = rms_interval(rows.rms_si, n * rows.dof_ratio)
        ax.fill_between(rows.t_s, low * factor, high * factor, color=PALETTE[0], alpha=0.2, linewidth=0)
        ax.plot(rows.t_s, rows.rms_si * factor, color=PALETTE[0], label=f"Monte Carlo RMS, {n} runs (95 % band)")
        ax.plot(rows.t_s, rows.filter_sigma_si * factor, color=PALETTE[2], lw=1.0, label="filter's own sigma")
    ax.plot(rows.t_s, rows.lincov_formal_si * factor, color="black", ls=":", lw=1.1, label="LinCov, filter's own")
    ax.plot(rows.t_s, lincov_rms(rows) * factor, color=PALETTE[1], ls="--", lw=1.1, label="LinCov, true error")


def comparison(results: Path | str | Tables, quantity: str) -> Figure:
    """Draw the 3-D error of all cases on one axis: Monte-Carlo RMS, or LinCov's where there are no runs."""
    tables = load(results)
    unit, factor = tables.people[quantity, "3d"]
    with look():
        figure, grid = canvas(1, 1, 3.0 + 0.09 * len(tables.labels))
        ax = grid[0, 0]
        every = []
        for number, (case, label) in enumerate(tables.labels.items()):
            rows = rows_of(tables, case, quantity, "3d")
            error = (rows.rms_si if rows.run_count.iloc[0] else lincov_rms(rows)) * factor
            ax.plot(rows.t_s, error, label=label, **line_of(number))
            every.append(error)
        scale_up(ax.yaxis, pd.concat(every))
        ax.set_xlabel("time since lift-off (s)")
        ax.set_ylabel(f"{quantity} error,\n3D RMS ({unit})")
        ax.margins(x=0.01)
        mark_events(ax, tables.events[tables.events.case == next(iter(tables.labels))])
        legend_below(figure, ax, columns=2)
    return figure


def rank(results: Path | str | Tables) -> Figure:
    """Draw the cases in order of their 3-D velocity error at injection, position beside it, with 95 % intervals."""
    tables = load(results)
    frame = ranking(tables)
    quantities = [name for name in ("velocity", "position") if name in frame]
    with look():
        figure, grid = canvas(1, max(1, len(quantities)), 1.05 + 0.26 * len(frame), sharey=True)
        place = np.arange(len(frame))
        for ax, quantity in zip(grid[0], quantities, strict=False):
            value = frame[quantity].to_numpy(dtype=float)
            spread = np.array([value - frame[f"{quantity}_low"], frame[f"{quantity}_high"] - value], dtype=float)
            ax.barh(place, value, color=PALETTE[0], height=0.6)
            ax.errorbar(value, place, xerr=np.nan_to_num(spread), fmt="none", ecolor="black", capsize=2, lw=0.9)
            ax.set_xlabel(f"{quantity} error at {frame.event.iloc[0]}\n3D RMS ({frame[f'{quantity}_unit'].iloc[0]})")
            scale_up(ax.xaxis, value)
            ax.grid(axis="y", visible=False)
        grid[0, 0].set_yticks(place, frame.case)
        grid[0, 0].set_ylabel("case")
        grid[0, 0].invert_yaxis()
    return figure
