"""What filters with a logic do over the flight."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots.style import PALETTE, canvas, look, mark_events
from lvnav_trade.records import MODES
from lvnav_trade.store import Tables, load

_LOOKS = {
    "waiting": {"facecolor": "0.85"},
    "converging": {"facecolor": PALETTE[5], "hatch": "..."},
    "aiding": {"facecolor": PALETTE[0]},
    "predicting": {"facecolor": PALETTE[4], "hatch": "////"},
    "stopped": {"facecolor": PALETTE[1], "hatch": "xxx"},
}
"""Look of each mode: hatching tells them apart where there is no colour."""


def logic(results: Path | str | Tables, case: str) -> Figure:
    """Draw the part of runs in each mode over time, modes on top of each other; events as lines, faults shaded."""
    tables = load(results)
    rows = METRICS["modes"](tables)
    wide = rows[rows.case == tables.labels[case]].pivot(index="t_s", columns="mode", values="run_ratio")
    wide = wide.reindex(columns=list(MODES)).astype(float)
    history = tables.history[tables.history.case == case]
    with look():
        figure, grid = canvas(1, 1, 2.2)
        axes = grid[0, 0]
        lower = 0.0 * wide[MODES[0]]
        for mode in MODES:
            upper = lower + wide[mode]
            if (wide[mode] > 0.0).any():
                axes.fill_between(
                    wide.index, 100.0 * lower, 100.0 * upper, label=mode, edgecolor="white", linewidth=0.0,
                    step="post", **_LOOKS[mode],
                )  # fmt: skip
            lower = upper
        if wide.empty:
            axes.text(0.5, 0.5, "the filter has no logic", transform=axes.transAxes, ha="center", color="0.4")
        axes.set_xlim(history.t_s.min(), history.t_s.max())
        axes.set_ylim(0.0, 100.0)
        axes.set_xlabel("time since lift-off (s)")
        axes.set_ylabel("runs (%)")
        mark_events(axes, tables.events[tables.events.case == case])
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure
