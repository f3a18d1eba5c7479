"""Decisions of tests for faults: by themselves, and as marks on figures of errors and innovations."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import ISOLATED
from lvnav_trade.report.figures.figure import Figure, Panel, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, message, over_time
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.statistics.select import ends_of, pick
from lvnav_trade.results.tables.read import Tables

_COLOURS = dict(zip(ISOLATED[1:], (PALETTE[0], PALETTE[4], PALETTE[1], PALETTE[5], PALETTE[2]), strict=True))


def _of_case(tables: Tables, case: str) -> pd.DataFrame:
    """Return part of runs, and whether linear covariance, by epoch and by what is isolated."""
    rows = pick(METRICS["decisions"](tables), case=tables.labels[case])
    return rows.groupby(["isolated", "t_s"]).agg(run_ratio=("run_ratio", "sum"), lincov=("lincov", "any")).reset_index()


@drawing
def decisions(tables: Tables, case: str) -> Figure:
    """Draw what the filter of a case isolates: part of runs epoch by epoch; open marks stand for linear covariance."""
    rows, (figure, ax) = _of_case(tables, case), panel(2.4)
    if rows.empty:
        return message("nothing is isolated", "time since lift-off (s)", "runs (%)")
    for isolated, colour in _COLOURS.items():
        mine = rows[rows.isolated == isolated]
        if len(mine):
            ax.plot(mine.t_s, 100.0 * mine.run_ratio, ls="none", marker="o", ms=3, color=colour, label=isolated)
            nominal = mine[mine.lincov]
            ax.plot(nominal.t_s, np.full(len(nominal), 103.0), ls="none", marker="o", ms=4, mfc="none", color=colour)
    ax.set(xlim=ends_of(tables, case), ylim=(0.0, 107.0), ylabel="runs (%)")
    over_time([ax], tables, case, margin=0.0)
    return figure


def mark_decisions(ax: Panel, tables: Tables, case: str) -> None:
    """Mark the epochs at which runs of a case isolate something, at the foot of a panel, by what they isolate."""
    if pick(tables.integrity, case=case).empty:
        return
    rows = _of_case(tables, case)
    for isolated, colour in _COLOURS.items():
        mine = rows[(rows.isolated == isolated) & (rows.run_ratio > 0.0)]
        if len(mine):
            label = f"decisions: {isolated}"
            ax.plot(mine.t_s, np.zeros(len(mine)), ls="none", marker="^", ms=4, color=colour, label=label)
