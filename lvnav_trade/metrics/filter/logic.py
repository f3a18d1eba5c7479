"""What filters with a logic did: every kind of change, how long in which mode, how often they stopped."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import pick
from lvnav_trade.records import MODES
from lvnav_trade.store import Tables

STEPS = 400
"""Times at which the modes of all runs are reported."""


def logic(tables: Tables) -> pd.DataFrame:
    """Return how often each change happened and why: case, from_mode, to_mode, reason, change_count, run_count (runs
    with one at least), run_ratio, first_s, median_s, last_s. Empty where no filter has a logic.
    """
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


def _with_logic(tables: Tables) -> pd.DataFrame:
    """Return the cases with a logic."""
    return tables.cases[tables.cases.logic.fillna(False).astype(bool)]


def modes(tables: Tables) -> pd.DataFrame:
    """Return the part of runs in each mode over time: case, t_s, mode, run_ratio; of cases with a logic only."""
    found = [pd.DataFrame(columns=["case", "t_s", "mode", "run_ratio"])]
    for case in _with_logic(tables).itertuples():
        rows, ends = pick(tables.logic, case=case.case), pick(tables.history, case=case.case).t_s
        t = np.linspace(float(ends.min()), float(ends.max()), STEPS)
        for mode in MODES:
            entered = np.searchsorted(np.sort(rows.t_s[rows.to_mode == mode]), t, side="right")
            left = np.searchsorted(np.sort(rows.t_s[rows.from_mode == mode]), t, side="right")
            part = (entered - left + (case.run_count if mode == MODES[0] else 0)) / max(1, case.run_count)
            found.append(pd.DataFrame({"case": tables.labels[case.case], "t_s": t, "mode": mode, "run_ratio": part}))
    return pd.concat(found[1:] or found)


def stops(tables: Tables) -> pd.DataFrame:
    """Return for each case with a logic: run_count, started_ratio (runs that ever start), corrected_ratio (runs that
    ever correct), stop_count, restart_count, ended_ratio (runs that correct at the end of the flight).
    """
    rows = []
    for case in _with_logic(tables).itertuples():
        mine, runs = pick(tables.logic, case=case.case), max(1, int(case.run_count))
        last = mine.sort_values("t_s", kind="stable").groupby("run_number").to_mode.last()
        starts = pick(mine, to_mode="converging")
        started, corrected = (part.run_number.nunique() / runs for part in (starts, pick(mine, to_mode="aiding")))
        stopped, again = len(pick(mine, to_mode="stopped")), len(pick(starts, from_mode="stopped"))
        ended = float(last.isin(["aiding", "predicting"]).sum()) / runs
        rows.append((case.label, int(case.run_count), started, corrected, stopped, again, ended))
    columns = ["case", "run_count", "started_ratio", "corrected_ratio", "stop_count", "restart_count", "ended_ratio"]
    return pd.DataFrame(rows, columns=columns)
