"""Satellites: number tracked, errors during outages, reasons of losses, times of reacquisition."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.case_results import parse_number
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    SAME_TIME,
    at_time,
    cache_result,
    faults,
    history_of,
    instant,
    lincov_rms,
    names_of_series,
    pick,
    pick_columns,
)
from lvnav_trade.results.tables.read import Tables

# Seconds after the end of a fault at which the error is read; the worst error is searched at least that far.
AFTER = 10.0
# An error has recovered from a fault below this multiple of its value before.
RECOVERED = 1.5
# Satellites of a position and a time.
FIX = 4
_AIR = 7500.0  # m, scale height of the delay of the air
_OUTAGES = [
    "case",
    "fault",
    "t_start_s",
    "t_end_s",
    "metric",
    "unit",
    "before",
    "at_end",
    "after",
    "worst",
    "t_worst_s",
    "t_recovered_s",
    "growth_ratio",
    "lincov_at_end",
]
_TRACKING = [
    "case",
    "first_fix_s",
    "to_fix_s",
    "least_count",
    "mean_count",
    "gap_count",
    "longest_gap_s",
    "loss_count",
]
_RECOVERY = [
    "case",
    "fault",
    "t_start_s",
    "t_end_s",
    "before_count",
    "least_count",
    "lost_count",
    "to_fix_s",
    "to_all_s",
    "gone_count",
]


def signal_values(
    tables: Tables,
    case: str,
    metric: str,
    elevation: Sequence[Any] | None = None,
    altitude: Sequence[Any] | None = None,
) -> pd.DataFrame:
    """Return the values of a metric of signals over time.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    metric : str
        satellites_tracked; air_crossing_height: climb rate times exp(-altitude / 7.5 km); or a column of the table
        `satellites` without its unit. A name with ``_change`` is the magnitude of the change of a satellite from an
        epoch to the next.
    elevation, altitude : (from, to), optional
        Ranges of the elevation (rad, or with units) and of the altitude of the vehicle (m, or with units).

    Returns
    -------
    pandas.DataFrame
        Columns t_s, value (SI) and height (altitude of the vehicle, m): a row for each tracked satellite and epoch, or
        for each epoch.
    """
    rows = pick(tables.satellites, case=case)
    if metric == "satellites_tracked":
        counts = rows.groupby("t_s").tracked.sum().rename("value").reset_index()
        return counts.assign(height=np.nan)
    truth = pick(tables.reference, case=case).sort_values("t_s", kind="stable")
    if metric == "air_crossing_height":
        t, height = truth.t_s.to_numpy(), truth.altitude_m.to_numpy()
        climb_rate = np.gradient(height, t)
        values = pd.DataFrame({"t_s": t, "value": climb_rate * np.exp(-height / _AIR), "height": height})
    else:
        values = _values_while_tracked(rows[rows.tracked], metric)
        values = values.assign(height=np.interp(values.t_s, truth.t_s, truth.altitude_m))
        if elevation is not None:
            low, high = (parse_number(end, "rad") for end in elevation)
            values = values[values.elevation_rad.between(low, high)]
    if altitude is not None:
        low, high = (parse_number(end, "m") for end in altitude)
        values = values[values.height.between(low, high)]
    return values[["t_s", "value", "height"]].reset_index(drop=True)


def _values_while_tracked(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Return rows of tracked satellites, by satellite and in order of time, with the values of a metric (SI)."""
    rows = rows.sort_values(["satellite", "t_s"], kind="stable")
    column = metric.removesuffix("_height").removesuffix("_change") + "_m"
    value = rows[column]
    if "_change" in metric:
        by_satellite = rows.groupby("satellite")
        step = by_satellite.t_s.diff()
        value = by_satellite[column].diff().where(step < 1.5 * step.min())  # not across a gap in tracking
    return rows.assign(value=value.abs())


def reacquisition_times(tables: Tables, case: str, at: str) -> Floats:
    """Return the times (n_lost,) s from an instant until each satellite lost at this instant is tracked again.

    A satellite is lost if it was tracked before and is not tracked at the instant. Infinite if it never is again.
    """
    t0 = instant(tables, case, at)
    is_tracked = tracked_over_time(tables, case)
    tracked_before = is_tracked[is_tracked.index <= t0 + SAME_TIME]
    tracked_after = is_tracked[is_tracked.index > t0 + SAME_TIME]
    if tracked_before.empty or tracked_after.empty:
        return np.empty(0)
    durations = []
    for name in is_tracked.columns:
        is_lost = tracked_before[name].any() and not tracked_before[name].iloc[-1]
        if is_lost and tracked_after[name].any():
            durations.append(float(tracked_after.index[tracked_after[name]].min()) - t0)
        elif is_lost:
            durations.append(np.inf)
    return np.array(durations)


def in_view(tables: Tables) -> pd.DataFrame:
    """Return the satellites tracked and above the horizon over time: case, t_s, tracked_count, above_count."""
    counts = satellite_counts(tables.satellites)
    return counts.assign(case=counts.case.map(tables.labels))


def satellite_counts(rows: pd.DataFrame) -> pd.DataFrame:
    """Return how many satellites of rows are tracked and above the horizon, by case and time."""
    rows = rows[["case", "t_s", "tracked"]].assign(above=rows.elevation_rad > 0)
    groups = rows.groupby(["case", "t_s"], sort=False, as_index=False)
    return groups.agg(tracked_count=("tracked", "sum"), above_count=("above", "sum"))


def outages(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors around every fault, in display units.

    Columns: case, fault, t_start_s, t_end_s, metric, unit, before, at_end, after (10 s after the end, or at the end of
    the flight), worst and t_worst_s (see `_worst_until_recovery`), t_recovered_s (NaN if the error does not recover),
    growth_ratio (at_end / before), lincov_at_end.
    Monte-Carlo RMS, or LinCov's without runs. Before is at the start, of a fault without duration at the time before.
    """
    rows = []
    faults_by_case = {case: faults(tables, case) for case in tables.labels}
    for case, quantity, axis in names_of_series(tables):
        if quantity not in NAVIGATION or axis != "3d":
            continue
        for fault in faults_by_case[case].itertuples():
            errors = _outage_errors(tables, case, quantity, fault)
            rows.append({"case": tables.labels[case], "fault": fault.event, **errors})
    return pd.DataFrame(rows, columns=_OUTAGES)


def _outage_errors(tables: Tables, case: str, quantity: str, fault: Any) -> dict[str, Any]:
    """Return the values of `_OUTAGES` from `t_start_s` on, for the norm of a navigation error around a fault."""
    unit, factor = tables.display_units[quantity, "3d"]
    history = history_of(tables, case, quantity, "3d")
    expected_rms = lincov_rms(history)
    error = history.assign(expected=expected_rms, error=history.rms_si if history.run_count.iloc[0] else expected_rms)
    earlier_rows = error[error.t_s < fault.t_s - SAME_TIME]
    has_duration = fault.t_end_s > fault.t_s
    if has_duration or earlier_rows.empty:
        error_before = at_time(error, fault.t_s)
    else:
        error_before = earlier_rows.iloc[-1]
    end = at_time(error, fault.t_end_s)
    error_after = at_time(error, fault.t_end_s + AFTER)
    worst, t_worst, t_recovered = _worst_until_recovery(tables, case, error, fault, float(error_before.error))
    return {
        "t_start_s": fault.t_s,
        "t_end_s": fault.t_end_s,
        "metric": f"{quantity}_error",
        "unit": unit,
        "before": error_before.error * factor,
        "at_end": end.error * factor,
        "after": error_after.error * factor,
        "worst": worst * factor,
        "t_worst_s": t_worst,
        "t_recovered_s": t_recovered,
        "growth_ratio": end.error / error_before.error if error_before.error > 0 else np.nan,
        "lincov_at_end": end.expected * factor,
    }


def _worst_until_recovery(
    tables: Tables, case: str, errors: pd.DataFrame, fault: Any, previous_error: float
) -> tuple[float, float, float]:
    """Return the worst error from the start of a fault until it has recovered, its time, and the time of recovery.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    errors : pandas.DataFrame
        Columns t_s, and error in SI, of the norm of a quantity.
    fault : named tuple
        Event of the fault, with t_s and t_end_s.
    previous_error : float
        Error before the fault, SI.

    Returns
    -------
    float, float, float
        Worst error (SI), its time (s), time of recovery (s); NaN if not known.

    Notes
    -----
    An error has recovered when it is below 1.5 times its value before, every satellite that returns after the fault is
    tracked again, and 10 s have passed since its end: an error may grow long after a fault, until its satellites are
    tracked. Without a recovery the search ends with the next fault or with the history.
    """
    is_tracked = tracked_over_time(tables, case)
    satellites = _recovery_values(is_tracked, float(fault.t_s), float(fault.t_end_s))
    until_all_tracked = np.nan_to_num(satellites["to_all_s"], nan=np.inf)
    t_all_tracked = fault.t_end_s + max(AFTER, until_all_tracked)
    fault_times = faults(tables, case).t_s
    t_next_fault = fault_times[fault_times > fault.t_end_s + SAME_TIME].min()  # NaN if there is none
    is_before_next = ~(errors.t_s >= t_next_fault - SAME_TIME)
    errors = errors[(errors.t_s >= fault.t_s - SAME_TIME) & is_before_next]
    is_small = errors.error < RECOVERED * previous_error
    recovery_times = errors.t_s[is_small & (errors.t_s >= t_all_tracked - SAME_TIME)]
    if len(recovery_times):
        errors = errors[errors.t_s <= recovery_times.iloc[0]]
    if errors.error.isna().all():
        return np.nan, np.nan, np.nan
    peak = errors.loc[errors.error.idxmax()]
    t_recovered = np.nan
    if len(recovery_times):
        # The error counts as recovered from its first small value after the fault that no large value follows.
        t_last_large = errors.t_s[~is_small[errors.index]].max()
        after_fault = errors.t_s >= fault.t_end_s - SAME_TIME
        t_recovered = float(errors.t_s[after_fault & ~(errors.t_s <= t_last_large)].iloc[0])
    return float(peak.error), float(peak.t_s), t_recovered


def transitions(tables: Tables) -> pd.DataFrame:
    """Return every change of state of a channel: case, t_s, satellite, from_state, to_state, reason."""
    return tables.transitions.assign(case=tables.transitions.case.map(tables.labels))


def losses(tables: Tables) -> pd.DataFrame:
    """Return the number of losses of tracking by reason, including satellites that set ("out of view").

    Columns: case, reason, loss_count, satellite_count, first_s, last_s. Empty where no receiver has channels.
    """
    changes = transitions(tables)
    loss_rows = changes[changes.from_state == "track"]
    by_reason = loss_rows.groupby(["case", "reason"], sort=False).agg(
        loss_count=("satellite", "size"),
        satellite_count=("satellite", "nunique"),
        first_s=("t_s", "min"),
        last_s=("t_s", "max"),
    )
    return by_reason.reset_index()


@cache_result
def tracked_over_time(tables: Tables, case: str) -> pd.DataFrame:
    """Return whether each satellite is tracked: times (s) as index, one column each."""
    t, satellites, is_tracked = pick_columns(tables.satellites, ("t_s", "satellite", "tracked"), case=case)
    times, row = np.unique(t, return_inverse=True)
    column, names = pd.factorize(satellites, sort=True)
    wide = np.zeros((len(times), len(names)), dtype=bool)
    wide[row, column] = is_tracked
    return pd.DataFrame(wide, pd.Index(times, name="t_s"), pd.Index(names, name="satellite"))


def tracking(tables: Tables) -> pd.DataFrame:
    """Return the availability of a fix in each case, to the second.

    Columns: case, first_fix_s (first time with four satellites), to_fix_s (since the first time at all), least_count
    and mean_count of satellites tracked from then on, gap_count (times that fewer than four are tracked after it),
    longest_gap_s, loss_count (satellites that stop being tracked, whatever the reason). NaN without a fix.
    """
    rows = []
    for case, label in tables.labels.items():
        wide = tracked_over_time(tables, case)
        t = wide.index.to_numpy(dtype=float)
        is_tracked = wide.to_numpy()
        count = is_tracked.sum(axis=1)
        fix_indices = np.flatnonzero(count >= FIX)
        first = int(fix_indices[0]) if fix_indices.size else len(t)
        if fix_indices.size:
            counts_since = count[first:]
        else:
            counts_since = np.array([np.nan])
        gaps = _gaps(t[first:], count[first:] >= FIX)
        row = {
            "case": label,
            "first_fix_s": t[first] if fix_indices.size else np.nan,
            "to_fix_s": t[first] - t[0] if fix_indices.size else np.nan,
            "least_count": counts_since.min(),
            "mean_count": counts_since.mean(),
            "gap_count": len(gaps),
            "longest_gap_s": max(gaps, default=0.0),
            "loss_count": int((is_tracked[:-1] & ~is_tracked[1:]).sum()),
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=_TRACKING)


def _gaps(t: np.ndarray, has_fix: np.ndarray) -> list[float]:
    """Return how long each stretch without a fix lasts, to the first time with one, or to the end."""
    change = np.diff(np.concatenate([[1], has_fix.astype(int), [1]]))
    starts = np.flatnonzero(change < 0)
    ends = np.minimum(np.flatnonzero(change > 0), len(t) - 1)
    return list(map(float, t[ends] - t[starts]))


def recovery(tables: Tables) -> pd.DataFrame:
    """Return the satellites lost by every fault, and the time until they are tracked again, to the second.

    Columns: case, fault, t_start_s, t_end_s, before_count (tracked just before the fault), least_count (in it),
    lost_count (satellites tracked before and not tracked at some time in it), to_fix_s (from its end until four are
    tracked), to_all_s (until all lost satellites are tracked that are ever tracked again), gone_count (number of those
    that never are: they set, or the flight ends). NaN for an event that does not happen.
    """
    rows = []
    for case, label in tables.labels.items():
        for fault in faults(tables, case).itertuples():
            is_tracked = tracked_over_time(tables, case)
            values = _recovery_values(is_tracked, float(fault.t_s), float(fault.t_end_s))
            row = {"case": label, "fault": fault.event, "t_start_s": fault.t_s, "t_end_s": fault.t_end_s}
            rows.append(row | values)
    return pd.DataFrame(rows, columns=_RECOVERY)


def _recovery_values(wide: pd.DataFrame, start: float, end: float) -> dict[str, float]:
    """Return the counts and times of `recovery` for a fault.

    Parameters
    ----------
    wide : pandas.DataFrame
        Tracking of each satellite over time, as `tracked_over_time`.
    start, end : float
        Start and end of the fault (s).
    """
    t = wide.index.to_numpy(dtype=float)
    is_tracked = wide.to_numpy()
    is_before = t < start - SAME_TIME
    is_after = t >= end - SAME_TIME
    tracked_during = is_tracked[~is_before & ~is_after]
    tracked_after = is_tracked[is_after]
    time_after = t[is_after] - end
    if is_before.any():
        tracked_before = is_tracked[is_before][-1]
    else:
        tracked_before = np.zeros(is_tracked.shape[1], dtype=bool)
    is_lost = tracked_before & ~tracked_during.all(axis=0)
    lost_tracked_after = tracked_after[:, is_lost]
    has_returned = lost_tracked_after.any(axis=0)
    fix_indices = np.flatnonzero(tracked_after.sum(axis=1) >= FIX)
    if has_returned.any():
        first_tracked = lost_tracked_after[:, has_returned].argmax(axis=0)
        recovery_time = max(0.0, float(time_after[first_tracked].max()))
    else:
        recovery_time = np.nan if is_lost.any() else 0.0
    return {
        "before_count": int(tracked_before.sum()),
        "least_count": int(tracked_during.sum(axis=1).min()) if len(tracked_during) else int(tracked_before.sum()),
        "lost_count": int(is_lost.sum()),
        "to_fix_s": max(0.0, float(time_after[fix_indices[0]])) if fix_indices.size else np.nan,
        "to_all_s": recovery_time,
        "gone_count": int((~has_returned).sum()),
    }
