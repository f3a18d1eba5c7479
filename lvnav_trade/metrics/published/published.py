"""Our number for a published one: which error, where in the flight, which statistic of it, in which unit."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade import units
from lvnav_trade.layout import MISSION
from lvnav_trade.metrics.basics.select import (
    SAME_TIME,
    errors_at,
    history_of,
    instant,
    phase,
    pick,
    rows_between,
    split_metric,
    time_mean,
)
from lvnav_trade.metrics.errors.diagnostics import NUMERICAL, observed
from lvnav_trade.metrics.vehicle import nozzle
from lvnav_trade.records import Floats
from lvnav_trade.store import Tables
from lvnav_trade.store.schema import error_column, rms_column

_SIGMAS = {"formal": ("filter_sigma_si", "lincov_formal_si"), "lincov": ("lincov_true_si", "lincov_true_si")}
"""Columns of the history behind a statistic, with runs and without."""

_WHOLE = {
    "observable_states": "least of all stretches",
    "nozzle_movement_pitch": "less with the filtered rate, flight",
    "nozzle_movement_yaw": "less with the filtered rate, flight",
}
"""Metrics of a whole flight, and what they are."""


class Ours(NamedTuple):
    """Our number in a unit; what should be said of it; the same of each run by itself, sorted, where that is known."""

    value: float
    remark: str = ""
    runs: Floats = np.empty(0)


_MISSING, _NOT_FLOWN = Ours(np.nan, "not among our results"), Ours(np.nan, "not in our flight")


def cases_of(tables: Tables, wanted: Mapping[str, str]) -> list[str]:
    """Return the digests of the cases whose axes have the levels wanted."""
    return [
        row.case
        for row in tables.cases.itertuples()
        if all(json.loads(row.axes).get(axis) == str(level) for axis, level in wanted.items())
    ]


def place_of(stated: Mapping[str, Any]) -> str:
    """Return where in the flight a statement holds, in words: ``at injection``, ``liftoff to injection``."""
    during = stated.get("during")
    return str(during) if during else f"at {stated.get('at') or 'injection'}"


def name_of(stated: Mapping[str, Any]) -> str:
    """Return the metric, the statistic where it is not the root mean square, and where it holds."""
    if str(stated["metric"]) in _WHOLE:
        return f"{stated['metric']}, {_WHOLE[str(stated['metric'])]}"
    statistic = stated.get("statistic", "rms")
    words = {"rms": "", "worst": "worst ", "least": "least ", "formal": "filter's own sigma of "}
    first = words.get(statistic, "linear covariance of ")
    return f"{first}{stated['metric']}{',' if stated.get('during') else ''} {place_of(stated)}"


def ours(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Ours:
    """Return our number for what is stated of a case, in `unit`; NaN with the reason where these results lack it."""
    metric = str(stated["metric"])
    if metric in MISSION:
        return _of_mission(tables, case, stated, unit)
    if metric.startswith("nozzle_movement_"):
        return _of_nozzle(tables, case, metric.rpartition("_")[2])
    if metric == "observable_states":
        return _of_rank(tables, case)
    if metric == "satellites_tracked" or metric.endswith("_left"):
        return _of_signals(tables, case, stated, unit)
    quantity, axis = split_metric(metric)
    rows = history_of(tables, case, quantity, axis)
    if rows.empty:
        return _MISSING
    scale, statistic = _scale(unit, str(rows.unit.iloc[0])), str(stated.get("statistic", "rms"))
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    if statistic == "worst":
        found = _per_run(tables, case, stated, error_column(quantity, axis, rows.unit.iloc[0]))
        if not len(found):
            return Ours(np.nan, "no runs, or the phase does not begin and end at events")
        return Ours(float(np.median(found)) / scale, "", found / scale)
    chosen = _within(tables, case, rows, stated)
    if chosen.empty:
        return _NOT_FLOWN
    with_runs = bool(chosen.run_count.iloc[0])
    if statistic in _SIGMAS:
        square = chosen[_SIGMAS[statistic][0 if with_runs else 1]] ** 2
    else:
        square = chosen.rms_si**2 if with_runs else chosen.lincov_true_si**2 + chosen.lincov_mean_si**2
    value = float(np.sqrt(time_mean(chosen.t_s.to_numpy(), square.to_numpy()))) / scale
    return Ours(value, "" if with_runs else "linear covariance", _each(tables, case, stated, rows) / scale)


def _scale(unit: str, si: str) -> float | None:
    """Return how many SI units one unit of the publication is; None where it is one of another kind."""
    try:
        return units.parse(f"1 {unit}", si)
    except ValueError:
        return None


def _within(tables: Tables, case: str, rows: pd.DataFrame, stated: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of a history at the event, or during the phase, that a statement names; none where not flown."""
    if stated.get("during"):
        return rows_between(rows, *phase(tables, case, str(stated["during"])))
    at = instant(tables, case, str(stated.get("at") or "injection"))
    if not np.isfinite(at):
        return rows.iloc[:0]
    nearest = int(np.argmin(np.abs(rows.t_s.to_numpy() - at)))
    return rows.iloc[nearest : nearest + 1]


def _each(tables: Tables, case: str, stated: Mapping[str, Any], rows: pd.DataFrame) -> Floats:
    """Return the number of every run by itself, SI and sorted; empty where it is not stored."""
    if stated.get("statistic", "rms") != "rms":
        return np.empty(0)
    if stated.get("during"):
        return _per_run(tables, case, stated, rms_column(*split_metric(str(stated["metric"])), rows.unit.iloc[0]))
    errors = errors_at(tables, case, str(stated.get("at") or "injection"), str(stated["metric"]))
    return np.empty(0) if errors is None else np.sort(errors.size)


def _per_run(tables: Tables, case: str, stated: Mapping[str, Any], column: str) -> Floats:
    """Return each run's largest, or root mean square, error of a phase between events, SI and sorted; none where the
    results lack it. A failed run's is infinite.
    """
    first, last = phase(tables, case, str(stated["during"]))
    within = rows_between(pick(tables.worst, case=case), first, last, end="t_end_s")
    lacks = within.empty or column not in within.columns or within[column].isna().all()
    if lacks or abs(within.t_s.min() - first) > SAME_TIME or abs(within.t_end_s.max() - last) > SAME_TIME:
        return np.empty(0)
    size = within[column].astype(float).mask(within.failure != "", np.inf)
    if "_rms_" not in column:
        return np.sort(size.groupby(within.run_number).max().to_numpy())
    length = within.t_end_s - within.t_s
    total, duration = (part.groupby(within.run_number).sum() for part in (size**2 * length, length))
    return np.sort(np.sqrt((total / duration).to_numpy()))


def _of_nozzle(tables: Tables, case: str, axis: str) -> Ours:
    """Return by how many percent less a nozzle moves with the filtered than with the raw rate, over the flight."""
    rows = pick(nozzle(tables), case=tables.labels[case], axis=axis, burn="flight")
    if rows.empty:
        return Ours(np.nan, "no vehicle under control, or fewer than two runs")
    row = rows.iloc[0]
    return Ours(row.less_percent, f"{row.runs} paired runs, 95 %: {row.low_percent:.1f} to {row.high_percent:.1f} %")


def _of_rank(tables: Tables, case: str) -> Ours:
    """Return the least number of states that any stretch observes."""
    rows = pick(observed(tables), case=tables.labels[case])
    if rows.empty:
        return _MISSING
    row = rows.iloc[0]
    return Ours(float(row.least_rank), f"{row.stretches} stretches, singular values above {NUMERICAL:g} of the largest")


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
    """Return how many satellites are tracked, or what corrections leave of their delays: the same in every run."""
    rows = pick(tables.satellites, case=case)
    if rows.empty:
        return _MISSING
    metric, statistic = str(stated["metric"]), str(stated.get("statistic", "rms"))
    if metric == "satellites_tracked":
        counts = rows.groupby("t_s").tracked.sum().rename("value").reset_index()
    else:
        counts = rows[rows.tracked].assign(value=rows[f"{metric}_m"].abs())
    chosen = _within(tables, case, counts, stated) if len(counts) else counts
    value = chosen.value.dropna().to_numpy(dtype=float)
    if not len(value):
        return _NOT_FLOWN
    scale = 1.0 if metric == "satellites_tracked" else _scale(unit, "m")
    if scale is None:
        return Ours(np.nan, f"unit {unit} does not fit")
    found = {"worst": value.max(), "least": value.min()}.get(statistic, np.sqrt(np.mean(value**2)))
    return Ours(float(found) / scale)
