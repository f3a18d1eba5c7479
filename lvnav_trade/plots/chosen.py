"""Errors of chosen cases on one axis, Monte Carlo beside linear covariance, and autocorrelations of innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lvnav_trade.metrics.published import cases_of
from lvnav_trade.metrics.select import lincov_rms
from lvnav_trade.metrics.spans import phase
from lvnav_trade.metrics.whiteness import autocorrelation
from lvnav_trade.plots.errors import rows_of
from lvnav_trade.plots.style import PALETTE, canvas, legend_below, line_of, look, mark_events, scale_up
from lvnav_trade.store import Tables, load

_LEAST = 0.2
"""Autocorrelation that is always within the panels: chance is not blown up."""
_ONE_FLIGHT = 600
"""Innovations of a channel in one flight, one a second."""
_LONG = 45
"""Letters of a label that leave no room for another beside it."""
_OWN = "dots: filter's own sigma over its true error"


def errors(
    results: Path | str | Tables,
    quantity: str,
    cases: Sequence[Mapping[str, str]] = (),
    axis: str = "3d",
    during: str | None = None,
) -> Figure:
    """Draw one error of chosen cases (all if none is) over time: Monte-Carlo RMS as lines, LinCov's as thin dashes."""
    tables = load(results)
    chosen = [case for wanted in cases for case in cases_of(tables, wanted)] or list(tables.labels)
    unit, factor = tables.people[quantity, axis]
    with look():
        figure, grid = canvas(1, 1, 3.2 + 0.09 * len(chosen))
        ax = grid[0, 0]
        every = []
        for number, case in enumerate(dict.fromkeys(chosen)):
            rows = rows_of(tables, case, quantity, axis)
            if during is not None:
                first, last = phase(tables, case, during)
                rows = rows[rows.t_s.between(first, last)]
            expected = lincov_rms(rows) * factor
            style = line_of(number)
            if len(rows) and rows.run_count.iloc[0]:
                ax.plot(rows.t_s, rows.rms_si * factor, label=tables.labels[case], **style)
                ax.plot(rows.t_s, expected, color=style["color"], ls=(0, (2, 2)), lw=0.7)
                every.append(rows.rms_si * factor)
            else:
                ax.plot(rows.t_s, expected, label=tables.labels[case], **style)
            every.append(expected)
        scale_up(ax.yaxis, pd.concat(every))
        ax.set_xlabel("time since lift-off (s)")
        what = f"{quantity.replace('_', ' ')} error, {'3D' if axis == '3d' else axis} RMS"
        ax.set_ylabel(f"{what}\n({unit}, 1 sigma; short dashes: LinCov)")
        ax.margins(x=0.01)
        mark_events(ax, tables.events[tables.events.case == chosen[0]])
        legend_below(figure, ax, columns=_columns(ax))
    return figure


def relative(
    results: Path | str | Tables,
    quantity: str,
    cases: Sequence[Mapping[str, str]] = (),
    axis: str = "3d",
    during: str | None = None,
) -> Figure:
    """Draw one error of chosen cases over that of the first one: Monte-Carlo RMS as lines, LinCov's as thin dashes.

    Short dots: the filter's own sigma over its true error, which a filter that knows its errors keeps at one.
    """
    tables = load(results)
    chosen = list(dict.fromkeys(case for wanted in cases for case in cases_of(tables, wanted))) or list(tables.labels)
    frames = []
    for case in chosen:
        rows = rows_of(tables, case, quantity, axis)
        first, last = phase(tables, case, during or "flight")
        frames.append(rows[rows.t_s.between(first, last)].assign(expected_si=lincov_rms))
    base = frames[0]
    with look():
        figure, grid = canvas(1, 1, 3.2 + 0.09 * len(chosen))
        ax = grid[0, 0]
        every = []
        for number, (case, rows) in enumerate(zip(chosen, frames, strict=True)):
            style = line_of(number)
            label = tables.labels[case]
            if number:
                expected = _over(rows, "expected_si", base)
                runs = len(rows) and rows.run_count.iloc[0] and base.run_count.iloc[0]
                shown = _over(rows, "rms_si", base) if runs else expected
                ax.plot(rows.t_s, shown, label=label, **style)
                ax.plot(rows.t_s, expected, color=style["color"], ls=(0, (2, 2)), lw=0.7)
                every += [*shown, *expected]
            own = rows.lincov_formal_si / rows.expected_si
            ax.plot(rows.t_s, own, color=style["color"], ls=":", lw=1.2, label=None if number else _OWN)
            every += [*own]
        ax.axhline(1.0, color=line_of(0)["color"], lw=1.2, label=f"{tables.labels[chosen[0]]} (the base)")
        scale_up(ax.yaxis, every, from_zero=max(every, default=0.0) > 1.5)  # a few percent should be seen
        ax.set_xlabel("time since lift-off (s)")
        what = f"{quantity.replace('_', ' ')} error, {'3D' if axis == '3d' else axis} RMS"
        ax.set_ylabel(f"{what},\nover the base (-; short dashes: LinCov)")
        ax.margins(x=0.01)
        mark_events(ax, tables.events[tables.events.case == chosen[0]])
        legend_below(figure, ax, columns=_columns(ax))
    return figure


def _columns(ax: Axes) -> int:
    """Return how many columns a legend may have beside each other in the width of the page."""
    return 1 if any(len(label) > _LONG for label in ax.get_legend_handles_labels()[1]) else 2


def _over(rows: pd.DataFrame, column: str, base: pd.DataFrame) -> pd.Series[float]:
    """Return a column over that of other rows at the same times."""
    below = base.set_index("t_s")[column].reindex(rows.t_s).to_numpy()
    return rows[column] / below


def autocorrelations(
    results: Path | str | Tables, cases: Sequence[Mapping[str, str]] = (), channels: str = ""
) -> Figure:
    """Draw the autocorrelation of every innovation channel of chosen cases, a panel each; `channels` picks by a word.

    Grey: where the value of one flight of white innovations lies with 95 % probability.
    """
    tables = load(results)
    labels = [tables.labels[case] for wanted in cases for case in cases_of(tables, wanted)]
    frame = autocorrelation(tables)
    frame = frame[frame.channel.str.contains(channels, regex=False) & (frame.pair_count >= 100)]
    shown = list(dict.fromkeys(labels)) or list(dict.fromkeys(frame.case))
    columns = min(3, max(1, len(shown)))
    with look():
        figure, grid = canvas(-(-max(1, len(shown)) // columns), columns, 2.3, sharex=True, sharey=True)
        for ax, label in zip(grid.ravel(), shown, strict=False):
            bound = 1.96 / np.sqrt(_ONE_FLIGHT)
            ax.axhspan(-bound, bound, color="#9ca3af", alpha=0.35, lw=0)
            for _, rows in frame[frame.case == label].groupby("channel", sort=False):
                lags = rows[rows.lag_number > 0]
                colour = (
                    PALETTE[1] if "rate" in str(rows.channel.iloc[0]) or "vel" in rows.channel.iloc[0] else PALETTE[0]
                )
                ax.plot(lags.lag_number, lags.autocorrelation_ratio, color=colour, lw=0.8, marker=".", ms=3)
            ax.set_title(label.replace(", ", "\n"), fontsize=7)
        for ax in grid.ravel():
            ax.set_ylabel("autocorrelation (-)")
            ax.set_xlabel("lag (epochs)")
            ax.label_outer()
        low, high = grid[0, 0].get_ylim()
        grid[0, 0].set_ylim(min(low, -_LEAST), max(high, _LEAST))  # all panels share it
    return figure
