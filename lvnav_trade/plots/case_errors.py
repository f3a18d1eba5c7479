"""Errors of chosen cases on one axis, Monte Carlo beside linear covariance, and autocorrelations of innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lvnav_trade.metrics.basics.select import lincov_rms
from lvnav_trade.metrics.basics.spans import phase
from lvnav_trade.metrics.filter.whiteness import autocorrelation
from lvnav_trade.metrics.published.published import cases_of
from lvnav_trade.plots.errors import rows_of
from lvnav_trade.plots.style import PALETTE, canvas, legend_below, line_of, look, mark_events, scale_up
from lvnav_trade.store import Tables, load

_LEAST = 0.2
"""Autocorrelation that is always within the panels: chance is not blown up."""
_ONE_FLIGHT = 600
"""Innovations of a channel in one flight, one a second."""
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
    frames = _frames(tables, quantity, cases, axis, during)
    unit, factor = tables.people[quantity, axis]
    with look():
        figure, ax = _axes(frames)
        every = []
        for number, (case, rows) in enumerate(frames.items()):
            expected, flown = rows.expected_si * factor, _has_runs(rows)
            shown = rows.rms_si * factor if flown else expected
            _line(ax, number, rows.t_s, shown, expected if flown else None, tables.labels[case])
            every += [shown, expected]
        scale_up(ax.yaxis, pd.concat(every))
        ax.set_ylabel(f"{_named(quantity, axis)}\n({unit}; short dashes: LinCov)")
        _finish(figure, ax, tables, next(iter(frames)))
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
    frames = _frames(tables, quantity, cases, axis, during or "flight")
    first = next(iter(frames))
    base = frames[first]
    with look():
        figure, ax = _axes(frames)
        every = []
        for number, (case, rows) in enumerate(frames.items()):
            if number:
                expected = _over(rows, "expected_si", base)
                shown = _over(rows, "rms_si", base) if _has_runs(rows) and _has_runs(base) else expected
                _line(ax, number, rows.t_s, shown, expected, tables.labels[case])
                every += [*shown, *expected]
            own = rows.lincov_formal_si / rows.expected_si
            colour = line_of(number)["color"]
            ax.plot(rows.t_s, own, color=colour, ls=":", lw=1.2, label=None if number else _OWN)
            every += [*own]
        ax.axhline(1.0, color=line_of(0)["color"], lw=1.2, label=f"{tables.labels[first]} (the base)")
        scale_up(ax.yaxis, every, from_zero=max(every, default=0.0) > 1.5)  # a few percent should be seen
        ax.set_ylabel(f"{_named(quantity, axis)},\nover the base (-; short dashes: LinCov)")
        _finish(figure, ax, tables, first)
    return figure


def _frames(
    tables: Tables, quantity: str, cases: Sequence[Mapping[str, str]], axis: str, during: str | None
) -> dict[str, pd.DataFrame]:
    """Return the history of an error of the chosen cases (all if none is) in a phase, with what LinCov expects."""
    chosen = [case for wanted in cases for case in cases_of(tables, wanted)] or list(tables.labels)
    frames = {}
    for case in dict.fromkeys(chosen):
        rows = rows_of(tables, case, quantity, axis)
        if during is not None:
            rows = rows[rows.t_s.between(*phase(tables, case, during))]
        frames[case] = rows.assign(expected_si=lincov_rms)
    return frames


def _has_runs(rows: pd.DataFrame) -> bool:
    return bool(len(rows) and rows.run_count.iloc[0])


def _axes(frames: Mapping[str, pd.DataFrame]) -> tuple[Figure, Axes]:
    figure, grid = canvas(1, 1, 3.2 + 0.09 * len(frames))
    return figure, grid[0, 0]


def _line(
    ax: Axes, number: int, t: pd.Series[float], shown: pd.Series[float], expected: pd.Series[float] | None, label: str
) -> None:
    """Draw a case, and beside it what LinCov expects where that is another line."""
    style = line_of(number)
    ax.plot(t, shown, label=label, **style)
    if expected is not None:
        ax.plot(t, expected, color=style["color"], ls=(0, (2, 2)), lw=0.7)


def _named(quantity: str, axis: str) -> str:
    return f"{quantity.replace('_', ' ')} error, {'3D' if axis == '3d' else axis} RMS"


def _finish(figure: Figure, ax: Axes, tables: Tables, case: str) -> None:
    """Label time, mark the events of a case and put the legend below."""
    ax.set_xlabel("time since lift-off (s)")
    ax.margins(x=0.01)
    mark_events(ax, tables.events[tables.events.case == case])
    legend_below(figure, ax, columns=2)


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
