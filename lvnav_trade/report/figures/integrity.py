"""Figures of fault tests, protection levels, and the validity of linear covariance."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import ISOLATED
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, message, over_time
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.protection_levels import series_of
from lvnav_trade.results.statistics.select import ends_of, history_of, pick
from lvnav_trade.results.tables.read import Tables

_COLOURS = dict(zip(ISOLATED[1:], (PALETTE[0], PALETTE[4], PALETTE[1], PALETTE[5], PALETTE[2]), strict=True))


def _of_case(tables: Tables, case: str) -> pd.DataFrame:
    """Return the share of runs, and whether linear covariance, isolates a channel, by epoch and channel."""
    rows = pick(METRICS["decisions"](tables), case=tables.labels[case])
    return (
        rows.groupby(["isolated_element", "t_s"])
        .agg(run_ratio=("run_ratio", "sum"), lincov=("lincov", "any"))
        .reset_index()
    )


@drawing
def decisions(tables: Tables, case: str) -> Figure:
    """Draw the share of runs that isolate each channel, by epoch, for one case; open markers are linear covariance."""
    rows, (figure, ax) = _of_case(tables, case), panel(2.4)
    if rows.empty:
        return message("no failure is isolated", "time since lift-off (s)", "runs (%)")
    for isolated, colour in _COLOURS.items():
        channel_rows = rows[rows.isolated_element == isolated]
        if len(channel_rows):
            ax.plot(
                channel_rows.t_s,
                100.0 * channel_rows.run_ratio,
                ls="none",
                marker="o",
                ms=3,
                color=colour,
                label=isolated,
            )
            nominal = channel_rows[channel_rows.lincov]
            ax.plot(nominal.t_s, np.full(len(nominal), 103.0), ls="none", marker="o", ms=4, mfc="none", color=colour)
    ax.set(xlim=ends_of(tables, case), ylim=(0.0, 107.0), ylabel="runs (%)")
    over_time([ax], tables, case, margin=0.0)
    return figure


def mark_decisions(ax: Panel, tables: Tables, case: str) -> None:
    """Mark the epochs at which runs of a case isolate a channel at the lower edge of a panel, by channel."""
    if pick(tables.integrity, case=case).empty:
        return
    rows = _of_case(tables, case)
    for isolated, colour in _COLOURS.items():
        channel_rows = rows[(rows.isolated_element == isolated) & (rows.run_ratio > 0.0)]
        if len(channel_rows):
            label = f"decisions: {isolated}"
            ax.plot(
                channel_rows.t_s, np.zeros(len(channel_rows)), ls="none", marker="^", ms=4, color=colour, label=label
            )


@drawing
def protection(tables: Tables, case: str) -> Figure:
    """Draw the protection levels of a case, with and without a failed satellite, over the RMS error.

    The RMS error is that of the runs, and by linear covariance.
    """
    figure, grid = canvas(len(PROTECTED), 1, 2.4)
    for axes, quantity in zip(grid.ravel(), PROTECTED, strict=True):
        rows, errors = series_of(tables, case, quantity), history_of(tables, case, quantity, "3d")
        unit, factor = tables.people[quantity, "3d"]
        axes.set(yscale="log", ylabel=f"{quantity} ({unit})")
        axes.plot(rows.t_s, factor * rows.level_si, color=PALETTE[1], label="protection level")
        axes.plot(rows.t_s, factor * rows.fault_free_si, color=PALETTE[1], ls="--", label="without faults")
        true = np.hypot(errors.lincov_true_si, errors.lincov_mean_si)
        axes.plot(errors.t_s, factor * true, color=GREY, label="true error (RMS), linear covariance")
        if (errors.run_count > 0).any():
            axes.plot(errors.t_s, factor * errors.rms_si, color=PALETTE[0], lw=0.8, label="runs (RMS)")
    over_time(list(grid.ravel()), tables, case)
    return figure


_WORST = 100.0  # ratio at the end of the colour scale
_DARK = 15.0  # ratio above which the colour needs white letters


def is_a_grid(tables: Tables) -> bool:
    """Return whether two axes vary and every pair of their levels is one case."""
    levels = pd.DataFrame(tables.levels).T
    return levels.shape[1] == 2 and len(levels) > 3 and len(levels) == int(levels.nunique().prod())


@drawing
def validity(tables: Tables) -> Figure:
    """Draw the ratio of RMS to linear covariance that is furthest from one, for every case of a grid of two axes.

    A cross marks cases that the spot check does not confirm, a dash cases that linear covariance does not describe.
    """
    frame = METRICS["spot_check"](tables)
    sizes = frame[frame.unit != ""]
    # infinite where a run failed
    furthest = np.exp(np.abs(np.log(sizes.ratio.clip(1.0 / _WORST, _WORST)))).groupby(sizes.case).max()
    refuted = frame.verdict.eq("disagree").groupby(frame.case).any()
    outside = frame.verdict.eq("not applicable").groupby(frame.case).any()
    levels = pd.DataFrame(tables.levels).T
    (across, columns), (down, rows) = ((name, list(dict.fromkeys(levels[name]))) for name in levels)
    image, marks = np.full((len(rows), len(columns)), np.nan), {}
    for case, label in tables.labels.items():
        at = rows.index(levels.loc[case, down]), columns.index(levels.loc[case, across])
        image[at] = furthest.get(label, np.nan)
        marks[at] = "–" if outside.get(label, False) else "✗" if refuted.get(label, False) else ""
    figure, ax = panel(1.3 + 0.32 * len(rows))
    label = "worst ratio of RMS\nto linear covariance (-)"
    across_edges, down_edges = (np.arange(count + 1) for count in image.T.shape)
    ax.cells(across_edges, down_edges, image, (1.0, _WORST), cmap="YlOrBr", label=label)
    for (row, column), mark in marks.items():
        ratio = image[row, column]
        size = "" if np.isnan(ratio) else f"> {_WORST:g}" if ratio >= _WORST else f"{ratio:.2g}"
        colour = "white" if ratio > _DARK else "black"
        ax.text(column + 0.5, row + 0.5, f"{mark} {size}".strip(), ha="center", color=colour)
    ax.set(xticks=named_ticks(columns, 0.5), xlabel=across.replace("_", " "), xlim=(0.0, float(len(columns))))
    ax.set(yticks=named_ticks(rows, 0.5), ylabel=down.replace("_", " "), ylim=(0.0, float(len(rows))), grid=False)
    return figure
