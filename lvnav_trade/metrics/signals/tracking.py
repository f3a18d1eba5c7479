"""How long a receiver is without a fix, why it loses satellites, and how long it takes to have them back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import faults
from lvnav_trade.store import Tables, load

FIX = 4
"""Satellites of a position and a time."""
_ROUNDING = 1e-6  # s


def transitions(results: Path | str | Tables) -> pd.DataFrame:
    """Return every change of state of a channel: case, t_s, satellite, from_state, to_state, reason."""
    tables = load(results)
    return tables.transitions.assign(case=tables.transitions.case.map(tables.labels))


def losses(results: Path | str | Tables) -> pd.DataFrame:
    """Return how often a channel stopped tracking, by reason: a satellite that sets ("out of view") stands among them.

    Columns: case, reason, loss_count, satellite_count, first_s, last_s. Empty where no receiver has channels.
    """
    changes = transitions(results)
    groups = changes[changes.from_state == "track"].groupby(["case", "reason"], sort=False)
    return groups.agg(
        loss_count=("satellite", "size"),
        satellite_count=("satellite", "nunique"),
        first_s=("t_s", "min"),
        last_s=("t_s", "max"),
    ).reset_index()


def tracked_over_time(tables: Tables, case: str) -> pd.DataFrame:
    """Return whether each satellite is tracked: times (s) as index, one column each."""
    rows = tables.satellites[tables.satellites.case == case]
    wide = rows.pivot(index="t_s", columns="satellite", values="tracked")
    return wide.astype("boolean").fillna(False).astype(bool)


def tracking(results: Path | str | Tables) -> pd.DataFrame:
    """Return how well each case has a fix, to the second.

    Columns: case, first_fix_s (first time with four satellites), to_fix_s (since the first time at all), least_count
    and mean_count of satellites tracked from then on, gap_count (times that fewer than four are tracked after it),
    longest_gap_s, loss_count (satellites that stop being tracked, whatever the reason). NaN without a fix.
    """
    tables = load(results)
    rows = []
    for case, label in tables.labels.items():
        wide = tracked_over_time(tables, case)
        t, count = wide.index.to_numpy(dtype=float), wide.to_numpy().sum(axis=1)
        fixed = np.flatnonzero(count >= FIX)
        first = int(fixed[0]) if fixed.size else len(t)
        gaps = _gaps(t[first:], count[first:] >= FIX)
        rows.append(
            {
                "case": label,
                "first_fix_s": t[first] if fixed.size else np.nan,
                "to_fix_s": t[first] - t[0] if fixed.size else np.nan,
                "least_count": count[first:].min() if fixed.size else np.nan,
                "mean_count": count[first:].mean() if fixed.size else np.nan,
                "gap_count": len(gaps),
                "longest_gap_s": max(gaps, default=0.0),
                "loss_count": int((wide.to_numpy()[:-1] & ~wide.to_numpy()[1:]).sum()),
            }
        )
    return pd.DataFrame(rows)


def _gaps(t: np.ndarray, good: np.ndarray) -> list[float]:
    """Return how long each stretch without a fix lasts, to the first time with one, or to the end."""
    found, since = [], np.nan
    for time, ok in zip(t, good, strict=True):
        if not ok and np.isnan(since):
            since = time
        elif ok and not np.isnan(since):
            found.append(float(time - since))
            since = np.nan
    return found if np.isnan(since) else [*found, float(t[-1] - since)]


def recovery(results: Path | str | Tables) -> pd.DataFrame:
    """Return what every fault takes from the receiver, and how long after its end that is back, to the second.

    Columns: case, fault, t_start_s, t_end_s, before_count (tracked just before the fault), least_count (in it),
    lost_count (satellites tracked before and not tracked at some time in it), to_fix_s (from its end until four are
    tracked), to_all_s (until every lost one that ever comes back is), gone_count (that never do: they set meanwhile, or
    the flight ends). NaN where it does not happen.
    """
    tables = load(results)
    rows = []
    for case, label in tables.labels.items():
        wide = tracked_over_time(tables, case)
        rows += [
            {
                "case": label,
                "fault": fault.event,
                "t_start_s": fault.t_s,
                "t_end_s": fault.t_end_s,
                **_recovered(wide, float(fault.t_s), float(fault.t_end_s)),
            }
            for fault in faults(tables, case).itertuples()
        ]
    names = ["case", "fault", "t_start_s", "t_end_s", "before_count", "least_count", "lost_count", "to_fix_s"]
    return pd.DataFrame(rows, columns=[*names, "to_all_s", "gone_count"])


def _recovered(wide: pd.DataFrame, start: float, end: float) -> dict[str, float]:
    t, tracked = wide.index.to_numpy(dtype=float), wide.to_numpy()
    earlier, after = tracked[t < start - _ROUNDING], t >= end - _ROUNDING
    within = tracked[(t >= start - _ROUNDING) & ~after]
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
