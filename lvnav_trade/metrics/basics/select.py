"""Picking what a metric needs out of the tables: series, events, phases, names of metrics."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade.layout import MISSION
from lvnav_trade.metrics.mechanics.mission import people, sizes_at
from lvnav_trade.store import Tables
from lvnav_trade.store.schema import error_column

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


class Errors(NamedTuple):
    """|error| of every run (n_run,), in the SI `unit`, infinite for a failed run; unit for people and its factor."""

    size: NDArray[np.float64]
    unit: str
    label_unit: str
    label_factor: float


def errors_at(tables: Tables, case: str, event: str, metric: str) -> Errors | None:
    """Return the size of a metric's error at an event in every run, in the order of the runs; None where unknown.

    An error that is not finite, in a run that did not fail, counts as infinite too.
    """
    if metric in MISSION:
        size = sizes_at(tables, case, event, metric)
        return None if size is None else Errors(size, *people(metric))
    quantity, axis = split_metric(metric)
    outputs = tables.outputs
    known = outputs[(outputs.case == case) & (outputs.quantity == quantity) & (outputs.axis == axis)]
    if known.empty:
        return None
    row: Any = known.iloc[0]
    runs, column = tables.runs, error_column(quantity, axis, row.unit)
    chosen = runs[(runs.case == case) & (runs.event == event)]
    values = chosen[column].to_numpy(dtype=float) if column in runs.columns else np.empty(0)
    failed = chosen.failure.to_numpy()[: len(values)] != ""
    return Errors(_sizes(values, failed), row.unit, row.label_unit, float(row.label_factor_ratio))


def _sizes(values: NDArray[np.float64], failed: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(failed | ~np.isfinite(values), np.inf, np.abs(values))


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


def mean_at(tables: Tables, case: str, event: str, quantity: str) -> float:
    """Return the norm of the mean error that LinCov expects at an event, the same in every flight, for people."""
    events, history = tables.events, tables.history
    t = float(events[(events.case == case) & (events.event == event)].t_s.iloc[0])
    rows = history[(history.case == case) & (history.quantity == quantity) & (history.axis == "3d")]
    return float(at_time(rows, t).lincov_mean_si) * float(tables.people[quantity, "3d"][1])


def at_time(rows: pd.DataFrame, t: float) -> pd.Series:
    """Return the row of a series nearest to a time."""
    return rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - t)))]
