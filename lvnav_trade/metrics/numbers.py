"""Our number for a published one: the error of a case, what its signals show, or what is derived from them."""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade import units
from lvnav_trade.layout import AVAILABILITY, MISSION, MODE_METRICS, PROTECTED, RATES, split_metric
from lvnav_trade.metrics.basics.per_run import of_each, per_run, signed, within
from lvnav_trade.metrics.basics.select import (
    errors_at,
    errors_by_axis,
    flight_events,
    history_of,
    phase,
    pick,
    rows_between,
    time_mean,
)
from lvnav_trade.metrics.convergence import convergence
from lvnav_trade.metrics.errors.covariances import (
    LINEAR_ATTITUDE,
    NUMERICAL,
    beyond_at_start,
    beyond_linear,
    formal_covariance,
    gaussian,
    observed,
)
from lvnav_trade.metrics.errors.coverage import below, covered
from lvnav_trade.metrics.integrity import rate
from lvnav_trade.metrics.modes import ENTRY_SHARE, has_logic, mode_named, of_modes, spread_of
from lvnav_trade.metrics.protection import is_of_protection, value_of
from lvnav_trade.metrics.signals import REACQUIRED, is_of_signals, reacquisition_times, values_of
from lvnav_trade.metrics.vehicle import inside_envelope, nozzle
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables
from lvnav_trade.store.schema import error_column

# Ends of metrics without a unit; what else ends in "_rate" may be the error of a clock.
_RATIOS = ("_nees", "_coverage")
# Columns of the history behind a statistic, with runs and without.
_SIGMAS = {"formal": ("filter_sigma_si", "lincov_formal_si"), "lincov": ("lincov_true_si", "lincov_true_si")}
_WHOLE = dict.fromkeys(("observable_states", "informed_states"), "least of all stretches")  # of a whole flight
_OF_CONTROL = re.compile(r"(nozzle_movement|turning_inside|jerk_inside)_(pitch|yaw)(?:_(\w+))?$")
_WORDS = {"nozzle_movement": "less with the filtered rate, ", "turning_inside": "part of ticks, "}


class Ours(NamedTuple):
    """Our number in a unit; what should be said of it; the same of each run by itself, sorted, where that is known."""

    value: float
    remark: str = ""
    runs: Floats = np.empty(0)


_MISSING, _NOT_FLOWN = Ours(np.nan, "not among our results"), Ours(np.nan, "not in our flight")


def cases_of(tables: Tables, wanted: Mapping[str, str]) -> list[str]:
    """Return the digests of the cases whose axes have the levels wanted."""
    return [
        case
        for case, levels in tables.levels.items()
        if all(levels.get(axis) == str(level) for axis, level in wanted.items())
    ]


def name_of(stated: Mapping[str, Any]) -> str:
    """Return the metric, the statistic where it is not the root mean square, and where it holds."""
    metric = str(stated["metric"])
    if metric in _WHOLE:
        return f"{metric}, {_WHOLE[metric]}"
    if found := _OF_CONTROL.match(metric):
        part = (found[3] or "flight").replace("_", " ")
        return f"{found[1]}_{found[2]}, {_WORDS.get(found[1], 'part of ticks, ')}{part}"
    if metric in MODE_METRICS:
        return mode_named(stated)
    words = {"rms": "", "worst": "worst ", "least": "least ", "formal": "filter's own sigma of ", "mean": "mean "}
    first, during = words.get(stated.get("statistic", "rms"), "linear covariance of "), stated.get("during")
    place = f", {during}" if during else f" at {stated.get('at') or 'injection'}"
    limit = f" below {stated['below']}" if metric.endswith("_coverage") and stated.get("below") else ""
    return f"{first}{stated['metric']}{limit}{place}"


def is_ratio(metric: str) -> bool:
    """Whether a metric is a number without a unit that is a mean over the runs and no root of one."""
    return metric.endswith(_RATIOS) or metric in RATES


def is_mean(stated: Mapping[str, Any]) -> bool:
    """Whether a number is a mean over the runs, and no root of one: of ratios, and of errors with their sign."""
    return is_ratio(str(stated["metric"])) or stated.get("statistic") == "mean"


def ours(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return our number for what is stated of a case, in `unit`; NaN with the reason where these results lack it."""
    metric = str(stated["metric"])
    if is_mean(stated) or metric in MODE_METRICS:
        ratio = columns(tables, case, stated, unit)
        value = ratio.monte_carlo if ratio.monte_carlo == ratio.monte_carlo else ratio.true
        return Ours(value, ratio.remark, np.sort(ratio.runs))
    if metric in MISSION:
        return _of_mission(tables, case, stated, unit)
    if steered := _OF_CONTROL.match(metric):
        what, axis, part = steered.groups()
        if what == "nozzle_movement":
            return _of_nozzle(tables, case, axis, (part or "flight").replace("_", " "))
        return Ours(*inside_envelope(tables, case, what, axis, part))
    if metric in _WHOLE:
        return _of_rank(tables, case, metric)
    if is_of_signals(metric):
        return _of_signals(tables, case, stated, unit)
    if is_of_protection(metric):
        scale = 1.0 if metric in AVAILABILITY else _scale(unit, PROTECTED[metric.partition("_")[0]])
        value = value_of(tables, case, stated)
        return Ours(value / scale if scale else np.nan, "" if np.isfinite(value) else "no protection levels there")
    quantity, axis = split_metric(metric)
    rows = history_of(tables, case, quantity, axis)
    if rows.empty:
        return _MISSING
    scale, statistic = _scale(unit, str(rows.unit.iloc[0])), str(stated.get("statistic", "rms"))
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if statistic == "worst":
        found = per_run(tables, case, stated, error_column(quantity, axis, rows.unit.iloc[0]))
        if not len(found):
            return Ours(np.nan, "no runs, or the phase does not begin and end at events")
        return Ours(float(np.median(found)) / scale, "", np.sort(found) / scale)
    chosen = within(tables, case, rows, stated)
    if chosen.empty:
        return _NOT_FLOWN
    with_runs = bool(chosen.run_count.iloc[0])
    beyond = _beyond_linear(tables, case, stated, quantity, unit) if statistic == "lincov" else ""
    if beyond:
        return Ours(np.nan, f"not applicable: {beyond}")
    if statistic in _SIGMAS:
        square = chosen[_SIGMAS[statistic][0 if with_runs else 1]] ** 2
    else:
        square = chosen.rms_si**2 if with_runs else chosen.lincov_true_si**2 + chosen.lincov_mean_si**2
    value = float(np.sqrt(time_mean(chosen.t_s.to_numpy(), square.to_numpy()))) / scale
    each = np.sort(of_each(tables, case, stated, rows)) / scale if statistic == "rms" else np.empty(0)
    return Ours(value, "" if with_runs else "linear covariance", each)


THREE = ("formal", "true", "monte_carlo")  # the numbers of a row


class Columns(NamedTuple):
    """Our number three times: formal sigma, true error of linear covariance (sigma and mean), runs; NaN where there is
    none. runs (n_run,): what it is the mean of, in the order of the runs, squares if is_root, one or zero if is_share;
    empty where not stored. levels (n_case,): the same mean of each of several cases that are taken together.
    """

    formal: float
    true: float
    monte_carlo: float
    remark: str = ""
    runs: Floats = np.empty(0)
    is_root: bool = True
    is_share: bool = False
    levels: Floats = np.empty(0)


_NO_COLUMNS = Columns(np.nan, np.nan, np.nan)


def columns(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Columns:
    """Return the three numbers of what is stated of a case, in `unit` ("-": SI).

    What is the same in every run (signals) is a true number; statistics other than the root mean square are of runs.
    """
    metric, statistic = str(stated["metric"]), str(stated.get("statistic", "rms"))
    if metric.endswith("_nees"):
        return _nees(tables, case, stated)
    if metric.endswith("_convergence_time"):
        return _convergence(tables, case, stated, unit)
    if metric in MODE_METRICS:
        return _modes(tables, case, stated, unit)
    if metric in RATES:
        return _rate(tables, case, stated)
    if metric.endswith("_coverage"):
        return _coverage(tables, case, stated)
    quantity, axis = split_metric(metric)
    rows = history_of(tables, case, quantity, axis)
    if rows.empty or statistic in ("worst", "least"):
        return _other_columns(tables, case, stated, unit)
    scale, chosen = 1.0 if unit == "-" else _scale(unit, str(rows.unit.iloc[0])), within(tables, case, rows, stated)
    if scale is None or chosen.empty:
        return _NO_COLUMNS._replace(remark=_NOT_FLOWN.remark if scale else f"unit {unit} does not fit")
    if statistic == "mean":
        return _mean(tables, case, stated, chosen, scale)
    t, drawn = chosen.t_s.to_numpy(), chosen.rms_si if chosen.run_count.iloc[0] else np.nan * chosen.rms_si
    formal, true, runs = (
        float(np.sqrt(time_mean(t, square.to_numpy(dtype=float)))) / scale
        for square in (chosen.lincov_formal_si**2, chosen.lincov_true_si**2 + chosen.lincov_mean_si**2, drawn**2)
    )
    return Columns(formal, true, runs, runs=(of_each(tables, case, stated, rows) / scale) ** 2)


def _mean(tables: Tables, case: str, stated: Mapping[str, Any], chosen: pd.DataFrame, scale: float) -> Columns:
    """Return the mean error over the runs, and over the time of a phase, with its sign."""
    t = chosen.t_s.to_numpy()
    true, drawn = (time_mean(t, chosen[name].to_numpy(dtype=float)) / scale for name in ("lincov_mean_si", "mean_si"))
    each = signed(tables, case, stated, str(chosen.unit.iloc[0])) / scale
    return Columns(np.nan, true, drawn, runs=each, is_root=False)


def difference(tables: Tables, case: str, other: str, stated: Mapping[str, Any], unit: str) -> Columns:
    """Return the root mean square of the difference of two cases' errors at an event, run by run and axis by axis."""
    quantity, axis = split_metric(str(stated["metric"]))
    both = [errors_by_axis(tables, one, str(stated.get("at") or "injection"), quantity) for one in (case, other)]
    failed = (both[0].failure != "") | (both[1].failure != "")
    first, second = (one.drop(columns="failure") for one in both)
    chosen = [name for name in first.columns if axis == "3d" or f"_{axis}_" in name]
    scale = 1.0 if unit == "-" else _scale(unit, str(pick(tables.outputs, case=case, quantity=quantity).unit.iloc[0]))
    if scale is None or not chosen or first.empty:
        return _NO_COLUMNS._replace(remark="no runs" if scale else f"unit {unit} does not fit")
    squares = ((first[chosen] - second[chosen]) ** 2).sum(axis=1).mask(failed, np.inf).to_numpy() / scale**2
    sound = squares[np.isfinite(squares)]
    return _NO_COLUMNS._replace(monte_carlo=float(np.sqrt(sound.mean())) if len(sound) else np.nan, runs=squares)


def _other_columns(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Columns:
    """Return the columns of what is no error in the history: of the runs where it differs between them."""
    metric = str(stated["metric"])
    of_signals = {"satellites_tracked": "-", REACQUIRED: "s"}.get(metric, "m") if is_of_signals(metric) else "-"
    if is_of_protection(metric) and metric not in AVAILABILITY:
        of_signals = PROTECTED[metric.partition("_")[0]]
    si = MISSION[metric].unit if metric in MISSION else of_signals
    found = ours(tables, case, stated, si if unit == "-" else unit)
    if not len(found.runs):
        return _NO_COLUMNS._replace(true=found.value, remark=found.remark)
    sizes = errors_at(tables, case, str(stated.get("at") or "injection"), metric) if metric in MISSION else None
    scale = 1.0 if unit == "-" else _scale(unit, si) or np.nan
    squares = np.empty(0) if sizes is None else (sizes.size / scale) ** 2
    return _NO_COLUMNS._replace(monte_carlo=found.value, remark=found.remark, runs=squares)


def _nees(tables: Tables, case: str, stated: Mapping[str, Any]) -> Columns:
    """Return e' P^-1 e per degree of freedom, mean over the events of a phase: P formal, of the nominal flight."""
    quantity = str(stated["metric"]).removesuffix("_nees")
    first, last = phase(tables, case, str(stated["during"]))
    expected, runs = [], []
    for event in rows_between(flight_events(tables, case), first, last).event:
        formal = formal_covariance(tables, case, event, quantity)
        true = gaussian(tables, case, event, quantity, "3d")
        if formal is None or true is None or not np.all(np.linalg.eigvalsh(formal) > 0.0):
            continue
        weight = np.linalg.inv(formal) / len(formal)
        expected.append(float(np.trace(weight @ (true.covariance + np.outer(true.mean, true.mean)))))
        rows = errors_by_axis(tables, case, event, quantity)
        errors = rows.drop(columns="failure").to_numpy(dtype=float)
        runs.append(np.where(rows.failure == "", np.einsum("ri,ij,rj->r", errors, weight, errors), np.inf))
    if not expected:
        return _NO_COLUMNS._replace(remark="no event with a covariance in this phase")
    each = np.mean(runs, axis=0)
    at = f"at {len(expected)} events"
    return Columns(1.0, float(np.mean(expected)), float(np.mean(each)) if len(each) else np.nan, at, each, False)


def _convergence(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Columns:
    """Return the median over the runs of the time after the start of a phase from which on the error (3-D) stays below
    a limit at the phase's events; its length where it never does, or where the run fails. A limit by another case has
    the time of linear covariance's root mean square too.
    """
    other = [""]
    if stated.get("sigma_of") is not None:
        other = cases_of(tables, {**tables.levels[case], **stated["sigma_of"]})
    found = convergence(tables, case, stated, other[0]) if other else None
    if found is None:
        return _NO_COLUMNS._replace(remark="no runs, or no events in this phase")
    scale, median = 1.0 if unit == "-" else units.parse(f"1 {unit}", "s"), float(np.median(found.times))
    always = ", half the runs are below the limit throughout" if median == 0.0 else ""
    true = found.expected / scale if other[0] else np.nan
    return Columns(np.nan, true, median / scale, f"median, at {found.n_event} events{always}")


def _modes(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Columns:
    """Return the median over the runs of what a filter's logic does in a phase; the share of runs that enter a mode."""
    if not has_logic(tables, case):
        return _NO_COLUMNS._replace(remark="no runs, or a filter without a logic")
    metric, each = str(stated["metric"]), of_modes(tables, case, stated)
    if metric == ENTRY_SHARE:
        return Columns(np.nan, np.nan, float(each.mean()), runs=each, is_root=False, is_share=True)
    scale = 1.0 if unit == "-" else _scale(unit, MODE_METRICS[metric])
    if scale is None or not np.all(np.isfinite(each)):
        return _NO_COLUMNS._replace(remark=_NOT_FLOWN.remark if scale else f"unit {unit} does not fit")
    return Columns(np.nan, np.nan, float(np.median(each)) / scale, spread_of(each / scale))


def _rate(tables: Tables, case: str, stated: Mapping[str, Any]) -> Columns:
    """Return the share of runs with an outcome of the tests for faults; linear covariance decides once, on the mean."""
    if pick(tables.runs, case=case).empty:
        return _NO_COLUMNS._replace(remark="no runs")
    each, nominal = rate(tables, case, str(stated["metric"]), phase(tables, case, str(stated["during"])))
    return Columns(np.nan, nominal, float(each.mean()), runs=each, is_root=False, is_share=True)


def _coverage(tables: Tables, case: str, stated: Mapping[str, Any]) -> Columns:
    """Return the share of runs with all axes within three sigmas at an event, or with the error below a limit."""
    about = (tables, case, str(stated.get("at") or "injection"), str(stated["metric"]).removesuffix("_coverage"))
    formal, true, runs = covered(*about) if stated.get("below") is None else below(*about, str(stated["below"]))
    remark = "" if len(runs) else "no runs at that event"
    return Columns(formal, true, float(runs.mean()) if len(runs) else np.nan, remark, runs, False, True)


def _beyond_linear(tables: Tables, case: str, stated: Mapping[str, Any], quantity: str, unit: str) -> str:
    """Say why linear covariance has no number beside what is stated of an attitude: one of the two is not small."""
    published = float(stated.get("value", 0.0)) * (_scale(unit, "rad") or 0.0) if quantity == "attitude" else 0.0
    return beyond_linear(published) if published > LINEAR_ATTITUDE else beyond_at_start(tables, case)


def _scale(unit: str, si: str) -> float | None:
    """Return how many SI units one unit of the publication is; None where it is one of another kind."""
    try:
        return units.parse(f"1 {unit}", si)
    except ValueError:
        return None


def _of_nozzle(tables: Tables, case: str, axis: str, burn: str) -> Ours:
    """Return by how many percent less a nozzle moves with the filtered than the raw rate, in a burn or a flight."""
    for row in pick(nozzle(tables), case=tables.labels[case], axis=axis, burn=burn).itertuples():
        interval = f"{row.low_percent:.1f} to {row.high_percent:.1f} %"
        rows = pick(tables.nozzle, case=case, axis=axis, burn=burn)
        moved = rows.pivot(index="run_number", columns="feed", values="moved_rad")
        each = 100.0 * (1.0 - moved.filtered / moved.raw).to_numpy()
        return Ours(float(row.less_percent), f"{row.runs} paired runs, 95 %: {interval}", np.sort(each))
    return Ours(np.nan, "no vehicle under control, no such burn, or fewer than two runs")


def _of_rank(tables: Tables, case: str, metric: str) -> Ours:
    for row in pick(observed(tables), case=tables.labels[case]).itertuples():
        if metric == "observable_states":
            above = f"{row.stretches} stretches, singular values above {NUMERICAL:g} of the largest"
            return Ours(float(row.least_rank), above)
        tolerance = float(pick(tables.observability, case=case).tolerance_ratio.iloc[0])
        above = f"{row.stretches} stretches, singular values above {tolerance:g}; least informed: {row.weakest}"
        return Ours(float(row.least_rank_with_information), above)
    return _MISSING


def _of_mission(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return the root mean square over runs of a number of the orbit or the point of impact."""
    metric = str(stated["metric"])
    scale = _scale(unit, MISSION[metric].unit)
    found = errors_at(tables, case, str(stated.get("at") or "injection"), metric)
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if found is None or not len(found.size):
        return _MISSING
    return Ours(float(np.sqrt(np.mean(found.size**2))) / scale, "", np.sort(found.size) / scale)


def _of_signals(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return how many satellites are tracked, or what their delays are: the same in every run."""
    metric, statistic = str(stated["metric"]), str(stated.get("statistic", "rms"))
    scale = 1.0 if metric == "satellites_tracked" else _scale(unit, "s" if metric == REACQUIRED else "m")
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if metric == REACQUIRED:
        times = reacquisition_times(tables, case, str(stated.get("at") or "injection"))
        return Ours(float(np.median(times)) / scale) if len(times) else _NOT_FLOWN
    rows = values_of(tables, case, metric, stated.get("elevation"), stated.get("altitude"))
    rows = within(tables, case, rows, stated) if len(rows) else rows
    value = rows.value.dropna().to_numpy(dtype=float) if len(rows) else np.empty(0)
    if not len(value):
        return _NOT_FLOWN if len(pick(tables.satellites, case=case)) else _MISSING
    if metric.endswith("_height"):
        found = float(rows.height[rows.value.idxmax()])
    else:
        found = float({"worst": value.max(), "least": value.min()}.get(statistic, np.sqrt(np.mean(value**2))))
    return Ours(found / scale)
