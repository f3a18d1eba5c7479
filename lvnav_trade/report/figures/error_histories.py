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
_MARKERS = 12  # number of markers on a line without its own dashes
MOST_RANKED = 30  # largest number of cases in the ranking
_LEAST = 0.2  # smallest range of autocorrelation in a panel, so that random values are not magnified
_INNOVATION_COUNT = 600  # of a channel in one run, one per second
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
    outputs = tables.outputs[tables.outputs.quantity == quantity]
    axes_names = list(dict.fromkeys(outputs.axis))
    single_axes = [name for name in axes_names if name != "3d"][:3] or axes_names
    unit, factor = tables.display_units[quantity, single_axes[0]]
    covariance_applies = tables.labels[case] not in _not_applicable(tables)
    figure, grid = canvas(len(single_axes), 1, 1.95, sharex=True)
    for ax, axis in zip(grid[:, 0], single_axes, strict=True):
        rows = history_of(tables, case, quantity, axis)
        _draw_run_errors(ax, rows, factor)
        if covariance_applies:
            formal_sigma = rows.lincov_formal_si * factor
            true_rms = lincov_rms(rows) * factor
            ax.plot(rows.t_s, formal_sigma, color="black", ls=":", lw=1.1, label="LinCov, filter's own")
            ax.plot(rows.t_s, true_rms, color=PALETTE[1], ls="--", lw=1.1, label="LinCov, true error")
        ax.set(ylabel=f"{axis}, RMS or\n1 sigma ({unit})")
        scale_up(ax, "y", pd.concat([rows.rms_si, rows.lincov_true_si, rows.lincov_formal_si]) * factor)
        mark_decisions(ax, tables, case)
    over_time(grid[:, 0], tables, case)
    return figure


def _draw_run_errors(ax: Panel, rows: pd.DataFrame, factor: float) -> None:
    """Draw the RMS error of the runs with its interval, and the filter's own sigma; nothing without runs.

    rows : rows of the table `history`
    factor : from SI to the unit of the figure
    """
    n_runs = int(rows.run_count.iloc[0])
    if not n_runs:
        return
    low, high = rms_interval(rows.rms_si, rows.run_count * rows.dof_ratio)
    ax.fill_between(rows.t_s, low * factor, high * factor, color=PALETTE[0], alpha=0.2)
    ax.plot(rows.t_s, rows.rms_si * factor, color=PALETTE[0], label=f"Monte Carlo RMS, {n_runs} runs (95 % band)")
    ax.plot(rows.t_s, rows.filter_sigma_si * factor, color=PALETTE[2], lw=1.0, label="filter's own sigma")


@drawing
def worst_run(tables: Tables, case: str, run: str) -> Figure:
    """Draw the errors of one stored run over time, with three formal sigmas and the RMS of all runs."""
    traces = pick(tables.traces, case=case)
    traces = traces[traces.run_number == int(run)]
    if traces.empty:
        return message(f"run {run} is not kept over time", "time since lift-off (s)", "error")
    quantities = list(dict.fromkeys(traces.quantity))
    figure, grid = canvas(len(quantities), 1, 1.95, sharex=True)
    for ax, quantity in zip(grid[:, 0], quantities, strict=True):
        trace = traces[traces.quantity == quantity]
        history = history_of(tables, case, quantity, "3d")
        unit, factor = tables.display_units[quantity, "3d"]
        bound = 3.0 * trace.sigma_si * factor
        rms = history.rms_si * factor
        ax.plot(trace.t_s, trace.error_si * factor, color=PALETTE[1], label=f"run {run}")
        ax.plot(trace.t_s, bound, color=PALETTE[2], lw=1.0, label="3 x filter's own sigma")
        ax.plot(history.t_s, rms, color=PALETTE[0], ls="--", lw=1.0, label="RMS of all runs")
        ax.set(ylabel=f"{quantity},\n3D ({unit})")
        scale_up(ax, "y", pd.concat([trace.error_si, history.rms_si]) * factor)
    over_time(grid[:, 0], tables, case)
    return figure


def _not_applicable(tables: Tables) -> set[str]:
    """Return the labels of the cases with runs to which linear covariance is not applicable."""
    frame = by_case(tables)
    return set(frame.case[frame.verdict == "not applicable"])


@drawing
def comparison(tables: Tables, quantity: str) -> Figure:
    """Draw the 3-D error of all cases over time in one panel: RMS of the runs, or of linear covariance without runs."""
    ranking = list(METRICS["ranking"](tables).case)
    selected_labels = {*ranking[: MOST_COMPARED - 2], *ranking[-2:]}
    frames = _error_histories(tables, quantity, (), "3d", None)
    frames = {case: rows for case, rows in frames.items() if tables.labels[case] in selected_labels}
    unit, factor = tables.display_units[quantity, "3d"]
    figure, ax = panel(3.0 + 0.09 * len(frames))
    _draw_cases(ax, tables, frames, factor, dashes=False)
    ax.set(ylabel=f"{quantity} error,\n3D RMS ({unit})")
    limits = mark_limits(ax, tables, next(iter(frames)), quantity)
    scale_up(ax, "y", [*ax.spans.get("y", ()), *limits])
    return figure


def _draw_cases(ax: Panel, tables: Tables, frames: dict[str, pd.DataFrame], factor: float, dashes: bool) -> None:
    """Draw the RMS errors of cases over time, of the runs or without runs of linear covariance.

    frames : from `_error_histories`
    factor : from SI to the unit of the figure
    dashes : whether to add linear covariance as thin dashes to the errors of the runs
    """
    errors = []
    for number, (case, rows) in enumerate(frames.items()):
        expected_error = rows.expected_si * factor
        has_runs = _has_runs(rows)
        error = rows.rms_si * factor if has_runs else expected_error
        _draw_case(ax, number, error, expected_error if has_runs and dashes else None, rows.t_s, tables.labels[case])
        errors.append(error)
        if dashes:
            errors.append(expected_error)
    scale_up(ax, "y", pd.concat(errors))
    over_time([ax], tables, next(iter(frames)))


@drawing
def rank(tables: Tables) -> Figure:
    """Draw the cases in order of their 3-D velocity error at injection, and their position errors, with 95 % intervals.

    Of many cases only the best are drawn.
    """
    frame = METRICS["ranking"](tables).head(MOST_RANKED)
    quantities = [name for name in ("velocity", "position") if name in frame]
    figure, grid = canvas(1, max(1, len(quantities)), 1.05 + 0.26 * len(frame), sharey=True)
    heights = np.arange(len(frame))
    for ax, quantity in zip(grid[0], quantities, strict=False):
        event = frame.event.iloc[0]
        error = frame[quantity].to_numpy(dtype=float)
        unit = frame[f"{quantity}_unit"].iloc[0]
        ax.barh(heights, error, 0.6, color=PALETTE[0])
        ax.hlines(heights, frame[f"{quantity}_low"], frame[f"{quantity}_high"], color="black", lw=1.4)
        bounds = mark_quantiles(ax, tables, frame, quantity)
        scale_up(ax, "x", [*error, *bounds])
        ax.set(
            xlabel=f"{quantity} error at {event}\n3D RMS ({unit})",
            ylim=(len(frame) - 0.5, -0.5),
            yticks=named_ticks(frame.case),
            grid=False,
        )
    grid[0, 0].set(ylabel="case")
    return figure


@drawing
def errors(tables: Tables, quantity: str, cases: Cases = (), axis: str = "3d", during: str | None = None) -> Figure:
    """Draw an error of several cases over time: RMS of the runs as lines, of linear covariance as thin dashes.

    cases : levels of the cases; all cases if empty
    during : phase; the whole history if None
    """
    frames = _error_histories(tables, quantity, cases, axis, during)
    unit, factor = tables.display_units[quantity, axis]
    figure, ax = panel(3.2 + 0.09 * len(frames))
    _draw_cases(ax, tables, frames, factor, dashes=True)
    ax.set(ylabel=f"{_error_name(quantity, axis)}\n({unit}; short dashes: LinCov)")
    return figure


@drawing
def relative(tables: Tables, quantity: str, cases: Cases = (), axis: str = "3d", during: str | None = None) -> Figure:
    """Draw an error of several cases relative to the first: of the runs as lines, of linear covariance as thin dashes.

    The dotted line is the formal sigma over the true error, which is one for a consistent filter. The arguments are
    those of `errors`.
    """
    frames = _error_histories(tables, quantity, cases, axis, during or "flight")
    first, base = next(iter(frames.items()))
    figure, ax = panel(3.2 + 0.09 * len(frames))
    all_ratios: list[float] = []
    for number, (case, rows) in enumerate(frames.items()):
        if number > 0:
            expected_ratio = _base_ratio(rows, "expected_si", base)
            ratio = expected_ratio
            if _has_runs(rows) and _has_runs(base):
                ratio = _base_ratio(rows, "rms_si", base)
            _draw_case(ax, number, ratio, expected_ratio, rows.t_s, tables.labels[case])
            all_ratios += [*ratio, *expected_ratio]
        formal_ratio = rows.lincov_formal_si / rows.expected_si
        legend_entry = _OWN if number == 0 else None
        ax.plot(rows.t_s, formal_ratio, color=line_of(number)["color"], ls=":", lw=1.2, label=legend_entry)
        all_ratios += [*formal_ratio]
    ax.axhline(1.0, color=line_of(0)["color"], lw=1.2, label=f"{tables.labels[first]} (the base)")
    is_large = max(all_ratios, default=0.0) > 1.5
    scale_up(ax, "y", all_ratios, from_zero=is_large)  # a few percent should be seen
    ax.set(ylabel=f"{_error_name(quantity, axis)},\nover the base (-; short dashes: LinCov)")
    over_time([ax], tables, first)
    return figure


def _error_histories(
    tables: Tables, quantity: str, cases: Cases, axis: str, phase_name: str | None
) -> dict[str, pd.DataFrame]:
    """Return the history of an error of several cases in a phase, by digest, with the RMS error by linear covariance.

    The latter is NaN for a case to which linear covariance is not applicable.
    """
    not_applicable = _not_applicable(tables)
    digests = [case for levels in cases for case in cases_of(tables, levels)]
    frames = {}
    for case in dict.fromkeys(digests) or tables.labels:
        rows = history_of(tables, case, quantity, axis)
        if phase_name is not None:
            start, end = phase(tables, case, phase_name)
            rows = rows[rows.t_s.between(start, end)]
        expected_error = np.nan if tables.labels[case] in not_applicable else lincov_rms(rows)
        frames[case] = rows.assign(expected_si=expected_error)
    return frames


def _draw_case(
    ax: Panel,
    number: int,
    error: pd.Series[float],
    expected_error: pd.Series[float] | None,
    t: pd.Series[float],
    label: str,
) -> None:
    """Draw the line of a case by its number, and the expectation of linear covariance as a second line unless None."""
    style = line_of(number)
    if expected_error is None:
        ax.plot(t, error, label=label, **style)
        return
    # Dashes mark the expectation, so cases are distinguished by markers
    ax.plot(
        t,
        error,
        label=label,
        color=style["color"],
        marker=MARKERS[number % len(MARKERS)],
        ms=4.5,
        every=max(1, len(t) // _MARKERS),
    )
    ax.plot(t, expected_error, color=style["color"], ls=(0, (2, 2)), lw=0.9, group=label)


def _error_name(quantity: str, axis: str) -> str:
    axis_name = "3D" if axis == "3d" else axis
    return f"{quantity.replace('_', ' ')} error, {axis_name} RMS"


def _base_ratio(rows: pd.DataFrame, column: str, base: pd.DataFrame) -> pd.Series[float]:
    """Return a column divided by that of the base at the same times."""
    base_values = base.set_index("t_s")[column].reindex(rows.t_s)
    return rows[column] / base_values.to_numpy()


def _has_runs(rows: pd.DataFrame) -> bool:
    return bool(len(rows) and rows.run_count.iloc[0])


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
    selected_labels = list(dict.fromkeys(labels or frame.case))
    is_drawn = frame.case.isin(selected_labels) & (frame.lag_number > 0)
    extent = [-_LEAST, _LEAST, *frame.autocorrelation_ratio[is_drawn]]
    low = 1.1 * float(np.min(extent))
    high = 1.1 * float(np.max(extent))
    n_columns = min(3, len(selected_labels))
    figure, grid = canvas(-(-len(selected_labels) // n_columns), n_columns, 2.3)
    for ax, label in zip(grid.ravel(), selected_labels, strict=False):
        _draw_autocorrelation(ax, frame[frame.case == label])
        ax.set(title=label.replace(", ", "\n"), xlabel="lag (epochs)", ylim=(low, high))
    for ax in grid[:, 0]:
        ax.set(ylabel="autocorrelation (-)")
    return figure


def _draw_autocorrelation(ax: Panel, rows: pd.DataFrame) -> None:
    """Draw the autocorrelation of every channel of a case; channels of velocities have a colour of their own."""
    bound = 1.96 / np.sqrt(_INNOVATION_COUNT)  # standard deviation of a white sequence: 1 / sqrt(n)
    ax.axhspan(-bound, bound, color=SHADE, alpha=0.35, label="95 % of one run, if white")
    for channel, channel_rows in rows.groupby("channel", sort=False):
        lags = channel_rows[channel_rows.lag_number > 0]
        is_velocity = "rate" in str(channel) or "vel" in str(channel)
        ax.plot(
            lags.lag_number,
            lags.autocorrelation_ratio,
            color=PALETTE[1] if is_velocity else PALETTE[0],
            lw=0.8,
            marker=".",
            ms=3,
            label="each range rate, velocity" if is_velocity else "each range, position, attitude",
        )


@drawing
def consistency(tables: Tables, case: str) -> Figure:
    """Draw ANEES and ANIS of a case per degree of freedom (1 for a consistent filter) with their 95 % bounds.

    A case with a gate has a third panel: the share of rejected measurements, and its expectation by linear covariance
    for the measurement with the largest. ANIS is of accepted measurements, relative to its expectation after the gate.
    """
    label = tables.labels[case]
    has_gate = not pd.isna(tables.cases.set_index("case").gate_ratio[case])
    errors = with_gaps(pick(METRICS["nees"](tables), case=label))
    innovations = with_gaps(pick(METRICS["nis"](tables), case=label))
    figure, grid = canvas(2 + has_gate, 1, 2.1, sharex=True)
    _draw_consistency(grid[0, 0], errors, "anees_ratio")
    grid[0, 0].set(ylabel="ANEES per degree\nof freedom (-)")
    _draw_consistency(grid[1, 0], innovations, "anis_ratio")
    grid[1, 0].set(ylabel="ANIS per measurement,\ncorrected (-)" if has_gate else "ANIS per measurement (-)")
    mark_decisions(grid[1, 0], tables, case)
    if has_gate:
        _draw_rejections(grid[2, 0], innovations)
    over_time(grid[:, 0], tables, case)
    return figure


def _draw_rejections(ax: Panel, rows: pd.DataFrame) -> None:
    """Draw the share of measurements that the gate rejects, and the limit of linear covariance."""
    ax.plot(rows.t_s, 100.0 * rows.rejected_ratio, color=PALETTE[0], lw=1.0)
    ax.plot(rows.t_s, 100.0 * rows.false_rejection_ratio, color=PALETTE[1], ls="--", lw=1.1)
    ax.axhline(100.0 * REJECTS_TOO_MUCH, color="black", ls=":", lw=0.9)
    ax.set(ylabel="measurements rejected (%)\ndotted: LinCov's limit", ylim=(0.0, None))


def _draw_consistency(ax: Panel, rows: pd.DataFrame, column: str) -> None:
    """Draw a normalised square of errors or innovations with its bounds and its expectation."""
    if rows[column].notna().any():
        ax.fill_between(
            rows.t_s,
            rows.low_ratio,
            rows.high_ratio,
            color=SHADE,
            alpha=0.35,
            label="95 % of a matched filter",
        )
        ax.plot(rows.t_s, rows[column], color=PALETTE[0], lw=1.0, label="Monte Carlo")
    ax.plot(rows.t_s, rows.expected_ratio, color=PALETTE[1], ls="--", lw=1.1, label="LinCov expectation")
    scale_up(ax, "y", pd.concat([rows[column], rows.expected_ratio]), from_zero=False)


@drawing
def logic(tables: Tables, case: str) -> Figure:
    """Draw the fraction of runs in each mode over time as stacked areas, with events as lines and faults shaded."""
    rows = pick(METRICS["modes"](tables), case=tables.labels[case])
    ratios = rows.pivot(index="t_s", columns="filter_mode", values="run_ratio")
    percentages = 100.0 * ratios.reindex(columns=list(MODES)).astype(float)
    upper = percentages.cumsum(axis=1)
    lower = upper.shift(axis=1, fill_value=0.0)
    figure, ax = panel(2.2)
    for mode in MODES:
        if (upper[mode] > lower[mode]).any():
            ax.fill_between(
                ratios.index,
                lower[mode],
                upper[mode],
                step=True,
                label=mode,
                ec="white",
                **_LOOKS[mode],
            )
    if ratios.empty:
        ax.text(0.5, 0.5, "the filter has no mode logic", x_part=True, y_part=True, ha="center", color=GREY)
    history = pick(tables.history, case=case)
    ax.set(xlim=(history.t_s.min(), history.t_s.max()), ylim=(0.0, 100.0), ylabel="runs (%)")
    over_time([ax], tables, case, margin=0.0)
    return figure
