"""How a filter behaves: normalised errors and innovations squared against their bounds, and modes of its logic."""

from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.metrics.errors.covariances import REJECTS_TOO_MUCH
from lvnav_trade.metrics.filter.consistency import nees, nis
from lvnav_trade.metrics.filter.logic import modes
from lvnav_trade.plots.style import PALETTE, canvas, drawing, legend_below, over_time, panel, scale_up, with_gaps
from lvnav_trade.records import MODES
from lvnav_trade.store import Tables

_LOOKS = {
    "waiting": {"facecolor": "0.85"},
    "converging": {"facecolor": PALETTE[5], "hatch": "..."},
    "aiding": {"facecolor": PALETTE[0]},
    "predicting": {"facecolor": PALETTE[4], "hatch": "////"},
    "stopped": {"facecolor": PALETTE[1], "hatch": "xxx"},
}
"""Look of each mode: hatching tells them apart where there is no colour."""


@drawing
def consistency(tables: Tables, case: str) -> Figure:
    """Draw ANEES and ANIS of a case per degree of freedom (1 is a matched filter) with their 95 % bounds.

    A case with a gate has a third panel: the part of rows that it rejected, and what linear covariance expects of the
    most endangered row. ANIS is of accepted rows, over what the gate leaves of a matched filter's.
    """
    gated = not pd.isna(tables.cases.set_index("case").gate_ratio[case])
    errors, innovations = (with_gaps(pick(found, case=tables.labels[case])) for found in (nees(tables), nis(tables)))
    figure, grid = canvas(2 + gated, 1, 2.1, sharex=True)
    _panel(grid[0, 0], errors, "anees_ratio", "ANEES per degree\nof freedom (-)")
    _panel(grid[1, 0], innovations, "anis_ratio", "ANIS per row,\ncorrected (-)" if gated else "ANIS per row (-)")
    if gated:
        _gate(grid[2, 0], innovations)
    over_time(grid[:, 0], tables, case)
    return legend_below(figure, grid[0, 0])


def _gate(ax: Any, rows: pd.DataFrame) -> None:
    ax.plot(rows.t_s, 100.0 * rows.rejected_ratio, color=PALETTE[0], lw=1.0)
    ax.plot(rows.t_s, 100.0 * rows.false_rejection_ratio, color=PALETTE[1], ls="--", lw=1.1)
    ax.axhline(100.0 * REJECTS_TOO_MUCH, color="black", ls=":", lw=0.9)
    ax.set_ylabel("rows rejected (%)\ndotted: LinCov's limit")
    ax.set_ylim(bottom=0.0)


def _panel(ax: Any, rows: pd.DataFrame, value: str, name: str) -> None:
    if rows[value].notna().any():
        bounds = {"color": "#9ca3af", "alpha": 0.35, "lw": 0, "label": "95 % of a matched filter"}
        ax.fill_between(rows.t_s, rows.low_ratio, rows.high_ratio, **bounds)
        ax.plot(rows.t_s, rows[value], color=PALETTE[0], lw=1.0, label="Monte Carlo")
    ax.plot(rows.t_s, rows.expected_ratio, color=PALETTE[1], ls="--", lw=1.1, label="LinCov expectation")
    scale_up(ax.yaxis, pd.concat([rows[value], rows.expected_ratio]), from_zero=False)
    ax.set_ylabel(name)


@drawing
def logic(tables: Tables, case: str) -> Figure:
    """Draw the part of runs in each mode over time, modes on top of each other; events as lines, faults shaded."""
    wide = pick(modes(tables), case=tables.labels[case]).pivot(index="t_s", columns="mode", values="run_ratio")
    upper = 100.0 * wide.reindex(columns=list(MODES)).astype(float).cumsum(axis=1)
    lower = upper.shift(axis=1, fill_value=0.0)
    history = pick(tables.history, case=case)
    figure, axes = panel(2.2)
    for mode in MODES:
        if (upper[mode] > lower[mode]).any():
            edge = {"edgecolor": "white", "linewidth": 0.0, "step": "post"}
            axes.fill_between(wide.index, lower[mode], upper[mode], label=mode, **edge, **_LOOKS[mode])
    if wide.empty:
        axes.text(0.5, 0.5, "the filter has no logic", transform=axes.transAxes, ha="center", color="0.4")
    axes.set(xlim=(history.t_s.min(), history.t_s.max()), ylim=(0.0, 100.0), ylabel="runs (%)")
    over_time([axes], tables, case, margin=0.0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure
