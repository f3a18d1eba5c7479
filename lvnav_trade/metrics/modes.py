"""What the logic of a filter did in each run of a phase: when it entered a mode, whether, how often, how long."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.layout import MODE_METRICS
from lvnav_trade.metrics.basics.select import SAME_TIME, phase, pick
from lvnav_trade.records import MODES, Floats
from lvnav_trade.store.read import Tables

ENTRY_TIME, ENTRY_SHARE, DURATION, CHANGES = MODE_METRICS


def has_logic(tables: Tables, case: str) -> bool:
    """Whether the filter of a case has a logic, and runs."""
    return bool(pick(tables.cases, case=case).logic.eq(True).any()) and not pick(tables.runs, case=case).empty


def of_modes(tables: Tables, case: str, stated: Mapping[str, Any]) -> Floats:
    """Return the number of every run (n_run,) for a metric of modes: time (s after the start of the phase) of the n-th
    change into the mode, the phase's length where there is none; one where there is one, else zero; seconds in the
    mode; how many changes. Of changes with the reason alone, where one is stated.
    """
    first, last = phase(tables, case, str(stated["during"]))
    changes = pick(tables.logic, case=case).sort_values(["run_number", "t_s"], kind="stable")
    runs = np.sort(pick(tables.runs, case=case).run_number.unique())
    mode, metric = str(stated["mode"]), str(stated["metric"])
    if metric == DURATION:
        return np.array([_seconds(pick(changes, run_number=run), mode, first, last) for run in runs])
    into = pick(changes, to_mode=mode)
    if stated.get("reason"):
        into = pick(into, reason=str(stated["reason"]))
    into = into[into.t_s.between(first - SAME_TIME, last + SAME_TIME)]
    counts = into.groupby("run_number").size().reindex(runs, fill_value=0)
    if metric == CHANGES:
        return counts.to_numpy(dtype=float)
    nth = int(stated.get("number") or 1)
    if metric == ENTRY_SHARE:
        return (counts >= nth).to_numpy(dtype=float)
    at = into[into.groupby("run_number").cumcount() == nth - 1].set_index("run_number").t_s
    return (at.reindex(runs, fill_value=last) - first).to_numpy(dtype=float)


def _seconds(changes: pd.DataFrame, mode: str, first: float, last: float) -> float:
    """Return for how long a run is in a mode between two times; before its first change it is in the first mode."""
    edges = np.clip([-np.inf, *changes.t_s, np.inf], first, last)
    inside = np.array([MODES[0], *changes.to_mode]) == mode
    return float(np.diff(edges)[inside].sum())


def spread_of(each: Floats) -> str:
    """Say from where to where the numbers of the runs reach."""
    if np.ptp(each) == 0.0:
        return f"the same in all {len(each)} runs"
    return f"median of {len(each)} runs, {min(each):.4g} to {max(each):.4g}"


def mode_named(stated: Mapping[str, Any]) -> str:
    """Return what a metric of modes is of: ``2. aiding entry_time (data again), liftoff to injection``."""
    nth = f"{stated['number']}. " if int(stated.get("number") or 1) > 1 else ""
    why = f" ({stated['reason']})" if stated.get("reason") else ""
    return f"{str(stated['metric']).replace('mode', nth + str(stated['mode']), 1)}{why}, {stated['during']}"
