"""Normalised errors and innovations squared over time against their bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from lvnav_trade.metrics.errors.covariances import REJECTS_TOO_MUCH
from lvnav_trade.metrics.filter.consistency import nees, nis
from lvnav_trade.plots.style import PALETTE, canvas, legend_below, look, mark_events, scale_up, with_gaps
from lvnav_trade.store import Tables, load


def consistency(results: Path | str | Tables, case: str) -> Figure:
    """Draw ANEES and ANIS of a case per degree of freedom (1 is a matched filter) with their 95 % bounds.

    A case with a gate has a third panel: the part of rows that it rejected, and what linear covariance expects of the
    most endangered row. ANIS is of accepted rows, over what the gate leaves of a matched filter's.
    """
    tables = load(results)
    events = tables.events[tables.events.case == case]
    label = tables.labels[case]
    gated = not pd.isna(tables.cases.set_index("case").gate_ratio[case])
    rows = nis(tables)
    pieces = (
        (nees(tables), "anees_ratio", "ANEES per degree\nof freedom (-)"),
        (rows, "anis_ratio", "ANIS per row,\ncorrected (-)" if gated else "ANIS per row (-)"),
    )
    with look():
        figure, grid = canvas(2 + gated, 1, 2.1, sharex=True)
        for ax, (frame, value, name) in zip(grid[:, 0], pieces, strict=False):
            _panel(ax, with_gaps(frame[frame.case == label]), value)
            ax.set_ylabel(name)
        if gated:
            _gate(grid[2, 0], with_gaps(rows[rows.case == label]))
        for number, ax in enumerate(grid[:, 0]):
            ax.margins(x=0.01)
            mark_events(ax, events, names=number == 0)
        grid[-1, 0].set_xlabel("time since lift-off (s)")
        legend_below(figure, grid[0, 0])
    return figure


def _gate(ax: Any, rows: pd.DataFrame) -> None:
    ax.plot(rows.t_s, 100.0 * rows.rejected_ratio, color=PALETTE[0], lw=1.0)
    ax.plot(rows.t_s, 100.0 * rows.false_rejection_ratio, color=PALETTE[1], ls="--", lw=1.1)
    ax.axhline(100.0 * REJECTS_TOO_MUCH, color="black", ls=":", lw=0.9)
    ax.set_ylabel("rows rejected (%)\ndotted: LinCov's limit")
    ax.set_ylim(bottom=0.0)


def _panel(ax: Any, rows: pd.DataFrame, value: str) -> None:
    if rows[value].notna().any():
        ax.fill_between(
            rows.t_s,
            rows.low_ratio,
            rows.high_ratio,
            color="#9ca3af",
            alpha=0.35,
            lw=0,
            label="95 % of a matched filter",
        )
        ax.plot(rows.t_s, rows[value], color=PALETTE[0], lw=1.0, label="Monte Carlo")
    ax.plot(rows.t_s, rows.expected_ratio, color=PALETTE[1], ls="--", lw=1.1, label="LinCov expectation")
    scale_up(ax.yaxis, pd.concat([rows[value], rows.expected_ratio]), from_zero=False)
