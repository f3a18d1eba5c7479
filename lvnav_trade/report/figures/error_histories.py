"""Figures of errors over time, of one case or several, and of a filter: consistency, autocorrelation, mode logic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import MODES
from lvnav_trade.report.figures.figure import GREY, SHADE, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.integrity import mark_decisions
from lvnav_trade.report.figures.limits import mark_limits, mark_quantiles
from lvnav_trade.report.figures.style import MARKERS, PALETTE, drawing, line_of, message, over_time, scale_up, with_gaps
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import REJECTS_TOO_MUCH, by_case
from lvnav_trade.results.statistics.probability import rms_interval
from lvnav_trade.results.statistics.select import cases_of, history_of, lincov_rms, phase, pick
from lvnav_trade.results.tables.read import Tables

MOST_COMPARED = 12  # largest number of cases in one panel; of more cases the best and the two worst are drawn
_MARKED = 12  # number of markers on a line without its own dashes
MOST_RANKED = 30  # largest number of cases in the ranking
_LEAST = 0.2  # smallest range of autocorrelation in a panel, so that random values are not magnified
_ONE_FLIGHT = 600  # innovations of a channel in one flight, one per second
_SLOW_FAST = "each range, position, attitude", "each range rate, velocity"  # channels in the first and second colour
_OWN = "dots: filter's own sigma over its true error"
Cases = Sequence[Mapping[str, str]]
# Style of each mode; hatching distinguishes them in grey prints
_LOOKS = {
    "waiting": {"color": "#d1d5db"},
    "converging": {"color": PALETTE[5], "hatch": "..."},
    "aiding": {"color": PALETTE[0]},
    "predicting": {"color": PALETTE[4], "hatch": "////"},
    "stopped": {"color": PALETTE[1], "hatch": "xxx"},
}


@drawing
def envelope(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw the errors of one quantity of a case over time, one panel per axis.

    The lines are the Monte Carlo RMS with its 95 % interval, the formal sigma of the runs, and by linear covariance the
    formal sigma and the true RMS error (sigma and mean combined).
    """
    axes_names = list(dict.fromkeys(tables.outputs[tables.outputs.quantity == quantity].axis))
    single = [name for name in axes_names if name != "3d"][:3] or axes_names
    unit, factor = tables.people[quantity, single[0]]
    figure, grid = canvas(len(single), 1, 1.95, sharex=True)
    for ax, axis in zip(grid[:, 0], single, strict=True):
        rows = history_of(tables, case, quantity, axis)
        _lines(ax, rows, factor, tables.labels[case] in _outside(tables))
        ax.set(ylabel=f"{axis}, RMS or\n1 sigma ({unit})")
        scale_up(ax, "y", pd.concat([rows.rms_si, rows.lincov_true_si, rows.lincov_formal_si]) * factor)
        mark_decisions(ax, tables, case)
    over_time(grid[:, 0], tables, case)
    return figure


@drawing
def worst_run(tables: Tables, case: str, run: str) -> Figure:
    """Draw the errors of one stored run over time, with three formal sigmas and the RMS of all runs."""
    rows = pick(tables.traces, case=case)
    rows = rows[rows.run_number == int(run)]
    if rows.empty:
        return message(f"run {run} is not kept over time", "time since lift-off (s)", "error")
    quantities = list(dict.fromkeys(rows.quantity))
    figure, grid = canvas(len(quantities), 1, 1.95, sharex=True)
    for ax, quantity in zip(grid[:, 0], quantities, strict=True):
        of_run, of_all = rows[rows.quantity == quantity], history_of(tables, case, quantity, "3d")
        unit, factor = tables.people[quantity, "3d"]
        ax.plot(of_run.t_s, of_run.error_si * factor, color=PALETTE[1], label=f"run {run}")
        ax.plot(of_run.t_s, 3.0 * of_run.sigma_si * factor, color=PALETTE[2], lw=1.0, label="3 x filter's own sigma")
        ax.plot(of_all.t_s, of_all.rms_si * factor, color=PALETTE[0], ls="--", lw=1.0, label="RMS of all runs")
        ax.set(ylabel=f"{quantity},\n3D ({unit})")
        scale_up(ax, "y", pd.concat([of_run.error_si, of_all.rms_si]) * factor)
    over_time(grid[:, 0], tables, case)
    return figure


def _outside(tables: Tables) -> set[str]:
    """Return the labels of the cases with runs to which linear covariance is not applicable."""
    frame = by_case(tables)
    return set(frame.case[frame.verdict == "not applicable"])


def _lines(ax: Panel, rows: pd.DataFrame, factor: float, runs_alone: bool) -> None:
    n = int(rows.run_count.iloc[0])
    if n:
        low, high = rms_interval(rows.rms_si, rows.run_count * rows.dof_ratio)
        ax.fill_between(rows.t_s, low * factor, high * factor, color=PALETTE[0], alpha=0.2)
        ax.plot(rows.t_s, rows.rms_si * factor, color=PALETTE[0], label=f"Monte Carlo RMS, {n} runs (95 % band)")
        ax.plot(rows.t_s, rows.filter_sigma_si * factor, color=PALETTE[2], lw=1.0, label="filter's own sigma")
    if runs_alone:
        return
    ax.plot(rows.t_s, rows.lincov_formal_si * factor, color="black", ls=":", lw=1.1, label="LinCov, filter's own")
    ax.plot(rows.t_s, lincov_rms(rows) * factor, color=PALETTE[1], ls="--", lw=1.1, label="LinCov, true error")


@drawing
def comparison(tables: Tables, quantity: str) -> Figure:
    """Draw the 3-D error of all cases over time in one panel: RMS of the runs, or of linear covariance without runs."""
    unit, factor = tables.people[quantity, "3d"]
    label = f"{quantity} error,\n3D RMS ({unit})"
    order = list(METRICS["ranking"](tables).case)
    selected = {*order[: MOST_COMPARED - 2], *order[-2:]}
    every = _frames(tables, quantity, (), "3d", None)
    frames = {case: rows for case, rows in every.items() if tables.labels[case] in selected}
    figure = _together(tables, frames, factor, label, 3.0, dashes=False)
    (ax,) = figure.panels
    limits = mark_limits(ax, tables, next(iter(frames)), quantity)
    scale_up(ax, "y", [*ax.spans.get("y", ()), *limits])
    return figure


def _together(
    tables: Tables, frames: dict[str, pd.DataFrame], factor: float, label: str, height: float, dashes: bool
) -> Figure:
    (figure, ax), all_values = panel(height + 0.09 * len(frames)), []
    for number, (case, rows) in enumerate(frames.items()):
        expected, has_runs = rows.expected_si * factor, _has_runs(rows)
        values = rows.rms_si * factor if has_runs else expected
        _line(ax, number, rows.t_s, values, expected if has_runs and dashes else None, tables.labels[case])
        all_values += [values, expected] if dashes else [values]
    scale_up(ax, "y", pd.concat(all_values))
    ax.set(ylabel=label)
    over_time([ax], tables, next(iter(frames)))
    return figure


@drawing
def rank(tables: Tables) -> Figure:
    """Draw the cases in order of their 3-D velocity error at injection, and their position errors, with 95 % intervals.

    Of many cases only the best are drawn.
    """
    frame = METRICS["ranking"](tables).head(MOST_RANKED)
    quantities = [name for name in ("velocity", "position") if name in frame]
    figure, grid = canvas(1, max(1, len(quantities)), 1.05 + 0.26 * len(frame), sharey=True)
    place = np.arange(len(frame))
    for ax, quantity in zip(grid[0], quantities, strict=False):
        value = frame[quantity].to_numpy(dtype=float)
        ax.barh(place, value, 0.6, color=PALETTE[0])
        ax.hlines(place, frame[f"{quantity}_low"], frame[f"{quantity}_high"], color="black", lw=1.4)
        ax.set(xlabel=f"{quantity} error at {frame.event.iloc[0]}\n3D RMS ({frame[f'{quantity}_unit'].iloc[0]})")
        scale_up(ax, "x", [*value, *mark_quantiles(ax, tables, frame, quantity)])
        ax.set(ylim=(len(frame) - 0.5, -0.5), yticks=named_ticks(frame.case), grid=False)
    grid[0, 0].set(ylabel="case")
    return figure


@drawing
def errors(tables: Tables, quantity: str, cases: Cases = (), axis: str = "3d", during: str | None = None) -> Figure:
    """Draw an error of several cases over time: RMS of the runs as lines, of linear covariance as thin dashes.

    cases : levels of the cases; all cases if empty
    during : phase; the whole history if None
    """
    unit, factor = tables.people[quantity, axis]
    label = f"{_named(quantity, axis)}\n({unit}; short dashes: LinCov)"
    return _together(tables, _frames(tables, quantity, cases, axis, during), factor, label, 3.2, dashes=True)


@drawing
def relative(tables: Tables, quantity: str, cases: Cases = (), axis: str = "3d", during: str | None = None) -> Figure:
    """Draw an error of several cases relative to the first: of the runs as lines, of linear covariance as thin dashes.

    The dotted line is the formal sigma over the true error, which is one for a consistent filter. The arguments are
    those of `errors`.
    """
    frames = _frames(tables, quantity, cases, axis, during or "flight")
    first, base = next(iter(frames.items()))
    (figure, ax), all_values = panel(3.2 + 0.09 * len(frames)), []
    for number, (case, rows) in enumerate(frames.items()):
        if number:
            expected = _over(rows, "expected_si", base)
            values = _over(rows, "rms_si", base) if _has_runs(rows) and _has_runs(base) else expected
            _line(ax, number, rows.t_s, values, expected, tables.labels[case])
            all_values += [*values, *expected]
        formal = rows.lincov_formal_si / rows.expected_si
        ax.plot(rows.t_s, formal, color=line_of(number)["color"], ls=":", lw=1.2, label=None if number else _OWN)
        all_values += [*formal]
    ax.axhline(1.0, color=line_of(0)["color"], lw=1.2, label=f"{tables.labels[first]} (the base)")
    scale_up(ax, "y", all_values, from_zero=max(all_values, default=0.0) > 1.5)  # a few percent should be seen
    ax.set(ylabel=f"{_named(quantity, axis)},\nover the base (-; short dashes: LinCov)")
    over_time([ax], tables, first)
    return figure


def _frames(tables: Tables, quantity: str, cases: Cases, axis: str, during: str | None) -> dict[str, pd.DataFrame]:
    """Return the history of an error of several cases in a phase, by digest, with the RMS error by linear covariance.

    The latter is NaN for a case to which linear covariance is not applicable.
    """
    frames = {}
    for case in dict.fromkeys(case for levels in cases for case in cases_of(tables, levels)) or tables.labels:
        rows = history_of(tables, case, quantity, axis)
        if during is not None:
            rows = rows[rows.t_s.between(*phase(tables, case, during))]
        alone = tables.labels[case] in _outside(tables)
        frames[case] = rows.assign(expected_si=np.nan if alone else lincov_rms(rows))
    return frames


def _has_runs(rows: pd.DataFrame) -> bool:
    return bool(len(rows) and rows.run_count.iloc[0])


def _line(
    ax: Panel, number: int, t: pd.Series[float], shown: pd.Series[float], expected: pd.Series[float] | None, label: str
) -> None:
    """Draw the line of a case, and the expectation of linear covariance as a second line if it is given."""
    style = line_of(number)
    if expected is not None:  # dashes mark the expectation, so cases are distinguished by markers
        interval = max(1, len(t) // _MARKED)
        ax.plot(
            t, shown, label=label, color=style["color"], marker=MARKERS[number % len(MARKERS)], ms=4.5, every=interval
        )
        ax.plot(t, expected, color=style["color"], ls=(0, (2, 2)), lw=0.9, group=label)
    else:
        ax.plot(t, shown, label=label, **style)


def _named(quantity: str, axis: str) -> str:
    return f"{quantity.replace('_', ' ')} error, {'3D' if axis == '3d' else axis} RMS"


def _over(rows: pd.DataFrame, column: str, base: pd.DataFrame) -> pd.Series[float]:
    return rows[column] / base.set_index("t_s")[column].reindex(rows.t_s).to_numpy()


@drawing
def autocorrelation(tables: Tables, cases: Cases = (), channels: str = "") -> Figure:
    """Draw the autocorrelation of every innovation channel of selected cases, one panel each.

    The grey band contains the value of one flight with white innovations with 95 % probability.

    channels : word that selects channels
    """
    labels = [tables.labels[case] for levels in cases for case in cases_of(tables, levels)]
    frame = METRICS["autocorrelation"](tables)
    frame = frame[frame.channel.str.contains(channels, regex=False) & (frame.pair_count >= 100)]
    if frame.empty:
        return message("there are no runs to correlate", "lag (epochs)", "autocorrelation (-)")
    selected = list(dict.fromkeys(labels or frame.case))
    columns = min(3, len(selected))
    figure, grid = canvas(-(-len(selected) // columns), columns, 2.3)
    bound = 1.96 / np.sqrt(_ONE_FLIGHT)
    extent = [-_LEAST, _LEAST, *frame[frame.case.isin(selected) & (frame.lag_number > 0)].autocorrelation_ratio]
    limits = 1.1 * float(np.min(extent)), 1.1 * float(np.max(extent))
    for ax, label in zip(grid.ravel(), selected, strict=False):
        ax.axhspan(-bound, bound, color=SHADE, alpha=0.35, label="95 % of one run, if white")
        for channel, rows in frame[frame.case == label].groupby("channel", sort=False):
            lags = rows[rows.lag_number > 0]
            colour = PALETTE[1] if "rate" in str(channel) or "vel" in str(channel) else PALETTE[0]
            legend_entry = _SLOW_FAST[colour == PALETTE[1]]
            ax.plot(
                lags.lag_number, lags.autocorrelation_ratio, color=colour, lw=0.8, marker=".", ms=3, label=legend_entry
            )
        ax.set(title=label.replace(", ", "\n"), xlabel="lag (epochs)", ylim=limits)
    for ax in grid[:, 0]:
        ax.set(ylabel="autocorrelation (-)")
    return figure


@drawing
def consistency(tables: Tables, case: str) -> Figure:
    """Draw ANEES and ANIS of a case per degree of freedom (1 for a consistent filter) with their 95 % bounds.

    A case with a gate has a third panel: the share of rejected measurements, and its expectation by linear covariance
    for the measurement with the largest. ANIS is of accepted measurements, relative to its expectation after the gate.
    """
    gated = not pd.isna(tables.cases.set_index("case").gate_ratio[case])
    errors, innovations = (with_gaps(pick(METRICS[name](tables), case=tables.labels[case])) for name in ("nees", "nis"))
    figure, grid = canvas(2 + gated, 1, 2.1, sharex=True)
    _panel(grid[0, 0], errors, "anees_ratio", "ANEES per degree\nof freedom (-)")
    _panel(
        grid[1, 0],
        innovations,
        "anis_ratio",
        "ANIS per measurement,\ncorrected (-)" if gated else "ANIS per measurement (-)",
    )
    mark_decisions(grid[1, 0], tables, case)
    if gated:
        _gate(grid[2, 0], innovations)
    over_time(grid[:, 0], tables, case)
    return figure


def _gate(ax: Panel, rows: pd.DataFrame) -> None:
    ax.plot(rows.t_s, 100.0 * rows.rejected_ratio, color=PALETTE[0], lw=1.0)
    ax.plot(rows.t_s, 100.0 * rows.false_rejection_ratio, color=PALETTE[1], ls="--", lw=1.1)
    ax.axhline(100.0 * REJECTS_TOO_MUCH, color="black", ls=":", lw=0.9)
    ax.set(ylabel="measurements rejected (%)\ndotted: LinCov's limit", ylim=(0.0, None))


def _panel(ax: Panel, rows: pd.DataFrame, value: str, name: str) -> None:
    if rows[value].notna().any():
        bounds = {"color": SHADE, "alpha": 0.35, "label": "95 % of a matched filter"}
        ax.fill_between(rows.t_s, rows.low_ratio, rows.high_ratio, **bounds)
        ax.plot(rows.t_s, rows[value], color=PALETTE[0], lw=1.0, label="Monte Carlo")
    ax.plot(rows.t_s, rows.expected_ratio, color=PALETTE[1], ls="--", lw=1.1, label="LinCov expectation")
    scale_up(ax, "y", pd.concat([rows[value], rows.expected_ratio]), from_zero=False)
    ax.set(ylabel=name)


@drawing
def logic(tables: Tables, case: str) -> Figure:
    """Draw the fraction of runs in each mode over time as stacked areas, with events as lines and faults shaded."""
    wide = pick(METRICS["modes"](tables), case=tables.labels[case]).pivot(
        index="t_s", columns="filter_mode", values="run_ratio"
    )
    upper = 100.0 * wide.reindex(columns=list(MODES)).astype(float).cumsum(axis=1)
    lower = upper.shift(axis=1, fill_value=0.0)
    history = pick(tables.history, case=case)
    figure, axes = panel(2.2)
    for mode in MODES:
        if (upper[mode] > lower[mode]).any():
            axes.fill_between(wide.index, lower[mode], upper[mode], step=True, label=mode, ec="white", **_LOOKS[mode])
    if wide.empty:
        axes.text(0.5, 0.5, "the filter has no mode logic", x_part=True, y_part=True, ha="center", color=GREY)
    axes.set(xlim=(history.t_s.min(), history.t_s.max()), ylim=(0.0, 100.0), ylabel="runs (%)")
    over_time([axes], tables, case, margin=0.0)
    return figure
