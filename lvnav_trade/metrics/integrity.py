"""What filters that test for faults have found: alarms before a fault, detection, isolation, time to detect."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.probability import success_bounds
from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.store.read import Tables

CONFIDENCE = 0.975  # of either bound: both hold with 95 %

_CHANNEL = ("range_bias", "degraded_noise", "wild_samples", "cycle_slip", "frozen_output", "invalid_output")
_CLOCK = ("clock_jump", "clock_drift")
_UNIT = ("gyro_", "accel_", "dead_axis", "dropped_samples", "satellite_outage", "antenna_failure", "jamming")


def expected(fault: str) -> str:
    """Return what a filter should isolate of a fault, by the name of its row among the events; empty where no test of
    ranges can tell.
    """
    kind = fault.split()[0]
    if kind in _CLOCK:
        return "clock"
    return "channel" if kind in _CHANNEL else "inertial" if kind.startswith(_UNIT) else ""


def _share(count: int, runs: int) -> tuple[float, float, float]:
    """Return a share of runs and its 95 % interval (Clopper and Pearson)."""
    low, high = success_bounds(runs, runs - count, CONFIDENCE)
    return count / runs, low, high


def integrity(tables: Tables) -> pd.DataFrame:
    """Return, for each case whose filter tests for faults, shares of its runs with exact 95 % intervals.

    Columns: case, fault (the first one, empty where there is none), outcome, run_count, count, share_ratio, low_ratio,
    high_ratio, median_s (after the fault began). Outcomes: false alarm (a decision before the fault, or in a flight
    without one), detected, isolated (the first decision names what failed), wrong isolation, missed.
    """
    found: list[tuple[Any, ...]] = []
    chosen = tables.cases[tables.cases.integrity.fillna(False).astype(bool) & (tables.cases.run_count > 0)]
    for case in chosen.itertuples():
        rows, runs = pick(tables.integrity, case=case.case), int(case.run_count)
        faults = pick(tables.events, case=case.case, kind="fault").sort_values("t_s", kind="stable")
        fault, start = (faults.event.iloc[0], float(faults.t_s.iloc[0])) if len(faults) else ("", np.inf)
        after = rows[rows.t_s >= start - 1e-9].sort_values("t_s", kind="stable").groupby("run_number").first()
        outcomes = [("false alarm", rows[rows.t_s < start - 1e-9].run_number.nunique(), np.nan)]
        if len(faults):
            right = after[after.isolated == expected(str(fault))]
            delay = float((after.t_s - start).median()) if len(after) else np.nan
            outcomes += [
                ("detected", len(after), delay),
                ("isolated", len(right), float((right.t_s - start).median()) if len(right) else np.nan),
                ("wrong isolation", len(after) - len(right), np.nan),
                ("missed", runs - len(after), np.nan),
            ]
        found += [(case.label, fault, name, runs, n, *_share(n, runs), delay) for name, n, delay in outcomes]
    columns = ["case", "fault", "outcome", "run_count", "count", "share_ratio", "low_ratio", "high_ratio", "median_s"]
    return pd.DataFrame(found, columns=columns)
