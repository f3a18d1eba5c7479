"""Picking what a metric needs out of the tables: series, events, phases, names of metrics."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.store import Tables

NAVIGATION = ("attitude", "velocity", "position")


class Phase(NamedTuple):
    """An interval of the flight, s since lift-off; an event where start equals end."""

    name: str
    start: float
    end: float


def metric_name(quantity: str) -> str:
    """Return the name under which the error of a quantity is known, such as ``velocity_error``."""
    return f"{quantity}_error"


def split_metric(name: str) -> tuple[str, str]:
    """Take ``velocity_error_3d`` apart into quantity and axis; an axis left out is the norm."""
    quantity, _, axis = name.partition("_error")
    return quantity, axis.lstrip("_") or "3d"


def flight_events(tables: Tables, case: str) -> pd.DataFrame:
    """Return the events of a case in time order (no faults)."""
    events = tables.events
    chosen = events[(events.case == case) & (events.kind == "event")]
    return chosen.sort_values(["t_s", "event"], kind="stable").reset_index(drop=True)


def faults(tables: Tables, case: str) -> pd.DataFrame:
    """Return the faults of a case in time order."""
    events = tables.events
    return events[(events.case == case) & (events.kind == "fault")].sort_values("t_s", kind="stable")


def phases(tables: Tables, case: str) -> list[Phase]:
    """Return the flight, the intervals between consecutive events, and the events."""
    history = tables.consistency
    t = history.t_s[history.case == case]
    start, end = float(t.min()), float(t.max())
    events = [(row.event, row.t_s) for row in flight_events(tables, case).itertuples() if start <= row.t_s <= end]
    bounds = [("start", start), *events, ("end", end)]
    between = [
        Phase(f"{first} to {second}", t_first, t_second)
        for (first, t_first), (second, t_second) in pairwise(bounds)
        if t_second - t_first > 1e-6
    ]
    return [Phase("flight", max(start, 0.0), end), *between, *(Phase(name, at, at) for name, at in events)]


def series(tables: Tables) -> Iterator[tuple[str, str, str, pd.DataFrame]]:
    """Yield (case, quantity, axis, rows in time order) of the history, in the order of the plan."""
    for (case, quantity, axis), rows in tables.history.groupby(["case", "quantity", "axis"], sort=False):
        yield str(case), str(quantity), str(axis), rows


def final_event(tables: Tables, case: str) -> str:
    """Return "injection" where the flight has it, or else the last event."""
    names = list(flight_events(tables, case).event)
    return "injection" if "injection" in names else (names[-1] if names else "")


def lincov_rms(rows: pd.DataFrame) -> pd.Series:
    """Return the root mean square error that LinCov expects: sigma and mean together."""
    return np.hypot(rows.lincov_true_si, rows.lincov_mean_si)


def at_time(rows: pd.DataFrame, t: float) -> pd.Series:
    """Return the row of a series nearest to a time."""
    return rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - t)))]
