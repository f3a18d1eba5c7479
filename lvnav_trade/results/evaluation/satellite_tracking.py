"""Satellites: how many are tracked, errors while they are not, why they are lost, how soon they are back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.case_results import number_in
from lvnav_trade.results.statistics.select import (
    NAVIGATION,
    SAME_TIME,
    at_time,
    faults,
    history_of,
    instant,
    lincov_rms,
    names_of_series,
    once,
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


def values_of(
    tables: Tables,
    case: str,
    metric: str,
    elevation: Sequence[Any] | None = None,
    altitude: Sequence[Any] | None = None,
) -> pd.DataFrame:
    """Return the values of a metric of signals: t_s, value (SI), height (altitude of the vehicle, m); a row for each
    tracked satellite and epoch, or for each epoch.

    elevation (rad, or with units), altitude (m, or with units): from and to. A change is that of one satellite from an
    epoch to the next, in size; of the crossing of air it is climb rate times exp(-altitude / 7.5 km).
    """
    truth = pick(tables.reference, case=case).sort_values("t_s", kind="stable")
    rows = pick(tables.satellites, case=case)
    if metric == "air_crossing_height":
        t, height = truth.t_s.to_numpy(), truth.altitude_m.to_numpy()
        rows = pd.DataFrame({"t_s": t, "value": np.gradient(height, t) * np.exp(-height / _AIR), "height": height})
    elif metric == "satellites_tracked":
        rows = rows.groupby("t_s").tracked.sum().rename("value").reset_index()
        return rows.assign(height=np.nan)
    else:
        rows = rows[rows.tracked].sort_values(["satellite", "t_s"], kind="stable")
        column = metric.removesuffix("_height").removesuffix("_change") + "_m"
        value = rows[column]
        if "_change" in metric:
            step = rows.groupby("satellite").t_s.diff()
            value = rows.groupby("satellite")[column].diff().where(step < 1.5 * step.min())
        height = np.interp(rows.t_s, truth.t_s, truth.altitude_m)
        rows = rows.assign(value=value.abs(), height=height)
        if elevation is not None:
            low, high = (number_in(end, "rad") for end in elevation)
            rows = rows[rows.elevation_rad.between(low, high)]
    if altitude is not None:
        low, high = (number_in(end, "m") for end in altitude)
        rows = rows[rows.height.between(low, high)]
    return rows[["t_s", "value", "height"]].reset_index(drop=True)


def reacquisition_times(tables: Tables, case: str, at: str) -> Floats:
    """Return how long (s) after an instant each satellite is tracked again that was tracked before and is lost then;
    infinite where it never is.
    """
    t0 = instant(tables, case, at)
    tracked = tracked_over_time(tables, case)
    before, after = tracked[tracked.index <= t0 + SAME_TIME], tracked[tracked.index > t0 + SAME_TIME]
    if before.empty or after.empty:
        return np.empty(0)
    lost = [name for name in tracked.columns if before[name].any() and not before[name].iloc[-1]]
    return np.array([float(after.index[after[name]].min()) - t0 if after[name].any() else np.inf for name in lost])


def in_view(tables: Tables) -> pd.DataFrame:
    """Return the satellites tracked and above the horizon over time: case, t_s, tracked_count, above_count."""
    found = counted(tables.satellites)
    return found.assign(case=found.case.map(tables.labels))


def counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Return how many satellites of rows are tracked and above the horizon, by case and time."""
    rows = rows[["case", "t_s", "tracked"]].assign(above=rows.elevation_rad > 0)
    groups = rows.groupby(["case", "t_s"], sort=False, as_index=False)
    return groups.agg(tracked_count=("tracked", "sum"), above_count=("above", "sum"))


def outages(tables: Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors around every fault, in display units.

    Columns: case, fault, t_start_s, t_end_s, metric, unit, before, at_end, after (10 s after the end, or at the end of
    the flight), worst and t_worst_s (see `_until_recovered`), t_recovered_s (NaN where the error does not recover),
    growth_ratio (at_end / before), lincov_at_end.
    Monte-Carlo RMS, or LinCov's without runs. Before is at the start, of a fault without duration at the time before.
    """
    rows = []
    of_case = {case: faults(tables, case) for case in tables.labels}
    for case, quantity, axis in names_of_series(tables):
        if quantity not in NAVIGATION or axis != "3d" or of_case[case].empty:
            continue
        unit, factor = tables.people[quantity, axis]
        history = history_of(tables, case, quantity, axis)
        expected = lincov_rms(history)
        error = history.assign(expected=expected, error=history.rms_si if history.run_count.iloc[0] else expected)
        for fault in of_case[case].itertuples():
            end, after = (at_time(error, t) for t in (fault.t_end_s, fault.t_end_s + AFTER))
            ahead = error[error.t_s < fault.t_s - SAME_TIME]
            before = ahead.iloc[-1] if fault.t_end_s <= fault.t_s and len(ahead) else at_time(error, fault.t_s)
            worst, t_worst, t_recovered = _until_recovered(tables, case, error, fault, float(before.error))
            growth = end.error / before.error if before.error > 0 else np.nan
            sizes = (before.error * factor, end.error * factor, after.error * factor, worst * factor)
            head = (tables.labels[case], fault.event, fault.t_s, fault.t_end_s, f"{quantity}_error", unit)
            rows.append((*head, *sizes, t_worst, t_recovered, growth, end.expected * factor))
    names = ["case", "fault", "t_start_s", "t_end_s", "metric", "unit", "before", "at_end", "after", "worst"]
    return pd.DataFrame(rows, columns=[*names, "t_worst_s", "t_recovered_s", "growth_ratio", "lincov_at_end"])


def _until_recovered(
    tables: Tables, case: str, error: pd.DataFrame, fault: Any, before: float
) -> tuple[float, float, float]:
    """Return the worst error from the start of a fault until it has recovered, its time, and the time of recovery.

    An error has recovered when it is below 1.5 times its value before, every satellite that returns after the fault is
    tracked again, and 10 s have passed since its end: an error may grow long after a fault, until its satellites are
    back. The search ends with the next fault or with the history, where it has not recovered.

    error : t_s, and error in SI, of one norm
    fault : event of that kind, with t_s and t_end_s
    before : error in SI before the fault
    """
    of_receiver = _recovered(tracked_over_time(tables, case), float(fault.t_s), float(fault.t_end_s))
    back = fault.t_end_s + max(AFTER, np.nan_to_num(of_receiver["to_all_s"], nan=np.inf))
    later = faults(tables, case).t_s
    following = later[later > fault.t_end_s + SAME_TIME].min()
    within = error[(error.t_s >= fault.t_s - SAME_TIME) & ~(error.t_s >= following - SAME_TIME)]
    small = within.error < RECOVERED * before
    ends = within.t_s[small & (within.t_s >= back - SAME_TIME)]
    searched = within[within.t_s <= (ends.iloc[0] if len(ends) else np.inf)]
    if searched.error.isna().all():
        return np.nan, np.nan, np.nan
    peak = searched.loc[searched.error.idxmax()]
    large = searched.t_s[~small[searched.index]].max()
    since = searched.t_s[(searched.t_s >= fault.t_end_s - SAME_TIME) & ~(searched.t_s <= large)]
    return float(peak.error), float(peak.t_s), float(since.iloc[0]) if len(ends) else np.nan


def transitions(tables: Tables) -> pd.DataFrame:
    """Return every change of state of a channel: case, t_s, satellite, from_state, to_state, reason."""
    return tables.transitions.assign(case=tables.transitions.case.map(tables.labels))


def losses(tables: Tables) -> pd.DataFrame:
    """Return the number of losses of tracking by reason, including satellites that set ("out of view").

    Columns: case, reason, loss_count, satellite_count, first_s, last_s. Empty where no receiver has channels.
    """
    changes = transitions(tables)
    return (
        changes[changes.from_state == "track"]
        .groupby(["case", "reason"], sort=False)
        .agg(
            loss_count=("satellite", "size"),
            satellite_count=("satellite", "nunique"),
            first_s=("t_s", "min"),
            last_s=("t_s", "max"),
        )
        .reset_index()
    )


@once
def tracked_over_time(tables: Tables, case: str) -> pd.DataFrame:
    """Return whether each satellite is tracked: times (s) as index, one column each."""
    t, satellites, tracked = pick_columns(tables.satellites, ("t_s", "satellite", "tracked"), case=case)
    times, row = np.unique(t, return_inverse=True)
    column, names = pd.factorize(satellites, sort=True)
    wide = np.zeros((len(times), len(names)), dtype=bool)
    wide[row, column] = tracked
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
        t, count = wide.index.to_numpy(dtype=float), wide.to_numpy().sum(axis=1)
        fixed = np.flatnonzero(count >= FIX)
        first = int(fixed[0]) if fixed.size else len(t)
        counts = count[first:] if fixed.size else np.array([np.nan])
        gaps = _gaps(t[first:], count[first:] >= FIX)
        since = (t[first], t[first] - t[0]) if fixed.size else (np.nan, np.nan)
        lost = int((wide.to_numpy()[:-1] & ~wide.to_numpy()[1:]).sum())
        rows.append((label, *since, counts.min(), counts.mean(), len(gaps), max(gaps, default=0.0), lost))
    names = ["case", "first_fix_s", "to_fix_s", "least_count", "mean_count", "gap_count", "longest_gap_s"]
    return pd.DataFrame(rows, columns=[*names, "loss_count"])


def _gaps(t: np.ndarray, good: np.ndarray) -> list[float]:
    """Return how long each stretch without a fix lasts, to the first time with one, or to the end."""
    change = np.diff(np.concatenate([[1], good.astype(int), [1]]))
    starts, ends = np.flatnonzero(change < 0), np.flatnonzero(change > 0)
    return list(map(float, t[np.minimum(ends, len(t) - 1)] - t[starts]))


def recovery(tables: Tables) -> pd.DataFrame:
    """Return the satellites lost by every fault, and the time until they are tracked again, to the second.

    Columns: case, fault, t_start_s, t_end_s, before_count (tracked just before the fault), least_count (in it),
    lost_count (satellites tracked before and not tracked at some time in it), to_fix_s (from its end until four are
    tracked), to_all_s (until every lost one that ever comes back is), gone_count (that never do: they set meanwhile, or
    the flight ends). NaN where it does not happen.
    """
    rows = [
        {"case": label, "fault": fault.event, "t_start_s": fault.t_s, "t_end_s": fault.t_end_s}
        | _recovered(wide, float(fault.t_s), float(fault.t_end_s))
        for case, label in tables.labels.items()
        if len(found := faults(tables, case))
        for wide in (tracked_over_time(tables, case),)
        for fault in found.itertuples()
    ]
    names = ["case", "fault", "t_start_s", "t_end_s", "before_count", "least_count", "lost_count", "to_fix_s"]
    return pd.DataFrame(rows, columns=[*names, "to_all_s", "gone_count"])


def _recovered(wide: pd.DataFrame, start: float, end: float) -> dict[str, float]:
    t, tracked = wide.index.to_numpy(dtype=float), wide.to_numpy()
    earlier, after = tracked[t < start - SAME_TIME], t >= end - SAME_TIME
    within = tracked[(t >= start - SAME_TIME) & ~after]
    had = earlier[-1] if len(earlier) else np.zeros(tracked.shape[1], dtype=bool)
    lost = had & ~within.all(axis=0)
    later, times = tracked[after], t[after] - end
    back = later[:, lost].any(axis=0) if len(later) else np.zeros(int(lost.sum()), dtype=bool)
    fixed = np.flatnonzero(later.sum(axis=1) >= FIX)
    returns = times[later[:, lost][:, back].argmax(axis=0)] if back.any() else np.empty(0)
    return {
        "before_count": int(had.sum()),
        "least_count": int(within.sum(axis=1).min()) if len(within) else int(had.sum()),
        "lost_count": int(lost.sum()),
        "to_fix_s": max(0.0, float(times[fixed[0]])) if fixed.size else np.nan,
        "to_all_s": max(0.0, float(returns.max())) if returns.size else (np.nan if lost.any() else 0.0),
        "gone_count": int((~back).sum()),
    }
