"""What filters with a logic did: every kind of change, how long in which mode, how often they stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.records import MODES
from lvnav_trade.store import Tables, load

STEPS = 400
"""Times at which the modes of all runs are reported."""


def logic(results: Path | str | Tables) -> pd.DataFrame:
    """Return how often each change happened and why: case, from_mode, to_mode, reason, change_count, run_count (runs
    with one at least), run_ratio, first_s, median_s, last_s. Empty where no filter has a logic.
    """
    tables = load(results)
    groups = tables.logic.groupby(["case", "from_mode", "to_mode", "reason"], sort=False)
    found = groups.agg(
        change_count=("t_s", "size"),
        run_count=("run_number", "nunique"),
        first_s=("t_s", "min"),
        median_s=("t_s", "median"),
        last_s=("t_s", "max"),
    ).reset_index()
    runs = found.case.map(tables.cases.set_index("case").run_count).astype(float)
    found.insert(6, "run_ratio", found.run_count.astype(float) / runs)
    return found.assign(case=found.case.map(tables.labels))


def modes(results: Path | str | Tables) -> pd.DataFrame:
    """Return the part of runs in each mode over time: case, t_s, mode, run_ratio; of cases with a logic only."""
    tables = load(results)
    found = []
    for case in tables.cases[tables.cases.logic.fillna(False).astype(bool)].case:
        rows, history = tables.logic[tables.logic.case == case], tables.history
        ends = history[history.case == case].t_s
        t = np.linspace(float(ends.min()), float(ends.max()), STEPS)
        runs = int(tables.cases.set_index("case").run_count[case])
        for mode in MODES:
            entered = np.searchsorted(np.sort(rows.t_s[rows.to_mode == mode]), t, side="right")
            left = np.searchsorted(np.sort(rows.t_s[rows.from_mode == mode]), t, side="right")
            inside = entered - left + (runs if mode == MODES[0] else 0)
            found.append(
                pd.DataFrame({"case": tables.labels[case], "t_s": t, "mode": mode, "run_ratio": inside / max(1, runs)})
            )
    return pd.concat(found) if found else pd.DataFrame(columns=["case", "t_s", "mode", "run_ratio"])


def stops(results: Path | str | Tables) -> pd.DataFrame:
    """Return for each case with a logic: run_count, started_ratio (runs that ever start), corrected_ratio (runs that
    ever correct), stop_count, restart_count, ended_ratio (runs that correct at the end of the flight).
    """
    tables = load(results)
    rows = []
    for case in tables.cases[tables.cases.logic.fillna(False).astype(bool)].itertuples():
        mine = tables.logic[tables.logic.case == case.case]
        runs = max(1, int(case.run_count))
        last = mine.sort_values("t_s", kind="stable").groupby("run_number").to_mode.last()
        starts = mine[mine.to_mode == "converging"]
        rows.append(
            {
                "case": case.label,
                "run_count": int(case.run_count),
                "started_ratio": starts.run_number.nunique() / runs,
                "corrected_ratio": mine[mine.to_mode == "aiding"].run_number.nunique() / runs,
                "stop_count": int((mine.to_mode == "stopped").sum()),
                "restart_count": int((starts.from_mode == "stopped").sum()),
                "ended_ratio": float(last.isin(["aiding", "predicting"]).sum()) / runs,
            }
        )
    columns = ["case", "run_count", "started_ratio", "corrected_ratio", "stop_count", "restart_count", "ended_ratio"]
    return pd.DataFrame(rows, columns=columns)
