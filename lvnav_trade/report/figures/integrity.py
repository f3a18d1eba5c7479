"""Figures of fault tests, protection levels, and the validity of linear covariance."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import ISOLATED
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, message, over_time
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.protection_levels import protection_series
from lvnav_trade.results.statistics.select import ends_of, history_of, pick
from lvnav_trade.results.tables.read import Tables

_CHANNEL_COLOURS = (PALETTE[0], PALETTE[4], PALETTE[1], PALETTE[5], PALETTE[2])
_COLOURS = dict(zip(ISOLATED[1:], _CHANNEL_COLOURS, strict=True))


def _isolation_shares(tables: Tables, case: str) -> pd.DataFrame:
    """Return the share of runs, and whether linear covariance, isolates a channel, by epoch and channel."""
    rows = pick(METRICS["decisions"](tables), case=tables.labels[case])
    groups = rows.groupby(["isolated_element", "t_s"])
    shares = groups.agg(
        run_ratio=("run_ratio", "sum"),
        lincov=("lincov", "any"),
    )
    return shares.reset_index()


@drawing
def decisions(tables: Tables, case: str) -> Figure:
    """Draw the share of runs that isolate each channel, by epoch, for one case; open markers are linear covariance."""
    rows = _isolation_shares(tables, case)
    figure, ax = panel(2.4)
    if rows.empty:
        return message("no failure is isolated", "time since lift-off (s)", "runs (%)")
    for element, colour in _COLOURS.items():
        channel_rows = rows[rows.isolated_element == element]
        if channel_rows.empty:
            continue
        ax.plot(
            channel_rows.t_s,
            100.0 * channel_rows.run_ratio,
            ls="none",
            marker="o",
            ms=3,
            color=colour,
            label=element,
        )
        nominal = channel_rows[channel_rows.lincov]
        ax.plot(
            nominal.t_s,
            np.full(len(nominal), 103.0),  # above the shares
            ls="none",
            marker="o",
            ms=4,
            mfc="none",
            color=colour,
        )
    ax.set(xlim=ends_of(tables, case), ylim=(0.0, 107.0), ylabel="runs (%)")
    over_time([ax], tables, case, margin=0.0)
    return figure


def mark_decisions(ax: Panel, tables: Tables, case: str) -> None:
    """Mark the epochs at which runs of a case isolate a channel at the lower edge of a panel, by channel."""
    if pick(tables.integrity, case=case).empty:
        return
    rows = _isolation_shares(tables, case)
    for element, colour in _COLOURS.items():
        channel_rows = rows[(rows.isolated_element == element) & (rows.run_ratio > 0.0)]
        if len(channel_rows):
            ax.plot(
                channel_rows.t_s,
                np.zeros(len(channel_rows)),
                ls="none",
                marker="^",
                ms=4,
                color=colour,
                label=f"decisions: {element}",
            )


@drawing
def protection(tables: Tables, case: str) -> Figure:
    """Draw the protection levels of a case, with and without a failed satellite, over the RMS error.

    The RMS error is that of the runs, and by linear covariance.
    """
    figure, grid = canvas(len(PROTECTED), 1, 2.4)
    for ax, quantity in zip(grid.ravel(), PROTECTED, strict=True):
        levels = protection_series(tables, case, quantity)
        errors = history_of(tables, case, quantity, "3d")
        unit, factor = tables.display_units[quantity, "3d"]
        ax.set(yscale="log", ylabel=f"{quantity} ({unit})")
        level = factor * levels.level_si
        fault_free_level = factor * levels.fault_free_si
        ax.plot(levels.t_s, level, color=PALETTE[1], label="protection level")
        ax.plot(levels.t_s, fault_free_level, color=PALETTE[1], ls="--", label="without faults")
        true_rms = factor * np.hypot(errors.lincov_true_si, errors.lincov_mean_si)
        ax.plot(errors.t_s, true_rms, color=GREY, label="true error (RMS), linear covariance")
        if (errors.run_count > 0).any():
            run_rms = factor * errors.rms_si
            ax.plot(errors.t_s, run_rms, color=PALETTE[0], lw=0.8, label="runs (RMS)")
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
    ratios = _furthest_ratios(tables)
    signs = _validity_signs(tables)
    levels = pd.DataFrame(tables.levels).T
    column_axis, row_axis = levels
    columns = list(dict.fromkeys(levels[column_axis]))
    rows = list(dict.fromkeys(levels[row_axis]))
    image = np.full((len(rows), len(columns)), np.nan)
    figure, ax = panel(1.3 + 0.32 * len(rows))
    texts: dict[tuple[int, int], str] = {}
    for case, label in tables.labels.items():
        row = rows.index(levels.loc[case, row_axis])
        column = columns.index(levels.loc[case, column_axis])
        image[row, column] = ratios.get(label, np.nan)
        sign = signs.get(label, "")
        ratio_text = _ratio_text(image[row, column])
        texts[row, column] = f"{sign} {ratio_text}".strip()
    ax.cells(
        np.arange(len(columns) + 1),
        np.arange(len(rows) + 1),
        image,
        (1.0, _WORST),
        cmap="YlOrBr",
        label="worst ratio of RMS\nto linear covariance (-)",
    )
    for (row, column), text in texts.items():
        colour = "white" if image[row, column] > _DARK else "black"
        ax.text(column + 0.5, row + 0.5, text, ha="center", color=colour)
    ax.set(
        xticks=named_ticks(columns, 0.5),
        xlabel=column_axis.replace("_", " "),
        xlim=(0.0, float(len(columns))),
        yticks=named_ticks(rows, 0.5),
        ylabel=row_axis.replace("_", " "),
        ylim=(0.0, float(len(rows))),
        grid=False,
    )
    return figure


def _furthest_ratios(tables: Tables) -> pd.Series:
    """Return the ratio of RMS to linear covariance that is furthest from one, or its inverse, by label of the case."""
    frame = METRICS["spot_check"](tables)
    tested_rows = frame[frame.unit != ""]
    ratio = tested_rows.ratio.clip(1.0 / _WORST, _WORST)  # infinite where a run failed
    distance = np.abs(np.log(ratio))
    return np.exp(distance).groupby(tested_rows.case).max()


def _validity_signs(tables: Tables) -> dict[str, str]:
    """Return a dash or a cross for the cases to which linear covariance does not apply or whose runs disagree."""
    frame = METRICS["spot_check"](tables)
    refuted_cases = frame[frame.verdict == "disagree"].case
    inapplicable_cases = frame[frame.verdict == "not applicable"].case
    return dict.fromkeys(refuted_cases, "✗") | dict.fromkeys(inapplicable_cases, "–")


def _ratio_text(ratio: float) -> str:
    if np.isnan(ratio):
        return ""
    if ratio >= _WORST:
        return f"> {_WORST:g}"
    return f"{ratio:.2g}"
