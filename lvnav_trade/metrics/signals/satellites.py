"""How many satellites are tracked, and what happens to the errors while they are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import NAVIGATION, at_time, faults, lincov_rms, series
from lvnav_trade.store import Tables, load

AFTER = 10.0
"""Seconds after the end of a fault at which the recovery is read."""


def in_view(results: Path | str | Tables) -> pd.DataFrame:
    """Return the satellites tracked and above the horizon over time: case, t_s, tracked_count, above_count."""
    tables = load(results)
    rows = tables.satellites.assign(above=tables.satellites.elevation_rad > 0)
    found = rows.groupby(["case", "t_s"], sort=False, as_index=False)[["tracked", "above"]].sum()
    found = found.rename(columns={"tracked": "tracked_count", "above": "above_count"})
    return found.assign(case=found.case.map(tables.labels))


def outages(results: Path | str | Tables) -> pd.DataFrame:
    """Return the 3-D navigation errors around every fault, in the units of people.

    Columns: case, fault, t_start_s, t_end_s, metric, unit, before, at_end, after (10 s after the end, or at the end of
    the flight), worst (from the start to 10 s after the end), growth_ratio (at_end / before), lincov_at_end.
    Monte-Carlo RMS, or LinCov's without runs. Before is at the start, of a fault without duration at the time before.
    """
    tables = load(results)
    rows = []
    for case, quantity, axis, history in series(tables):
        if quantity not in NAVIGATION or axis != "3d":
            continue
        unit, factor = tables.people[quantity, axis]
        expected = lincov_rms(history)
        error = history.assign(expected=expected, error=history.rms_si if history.run_count.iloc[0] else expected)
        for fault in faults(tables, case).itertuples():
            end, after = (at_time(error, t) for t in (fault.t_end_s, fault.t_end_s + AFTER))
            ahead = error[error.t_s < fault.t_s - 1e-6]
            momentary = fault.t_end_s <= fault.t_s and len(ahead)
            before = ahead.iloc[-1] if momentary else at_time(error, fault.t_s)
            footprint = error[error.t_s.between(fault.t_s, fault.t_end_s + AFTER)]
            rows.append(
                {
                    "case": tables.labels[case],
                    "fault": fault.event,
                    "t_start_s": fault.t_s,
                    "t_end_s": fault.t_end_s,
                    "metric": f"{quantity}_error",
                    "unit": unit,
                    "before": before.error * factor,
                    "at_end": end.error * factor,
                    "after": after.error * factor,
                    "worst": footprint.error.max() * factor,
                    "growth_ratio": end.error / before.error if before.error > 0 else np.nan,
                    "lincov_at_end": end.expected * factor,
                }
            )
    names = ["case", "fault", "t_start_s", "t_end_s", "metric", "unit"]
    return pd.DataFrame(rows, columns=[*names, "before", "at_end", "after", "worst", "growth_ratio", "lincov_at_end"])
