"""How many of the runs lie within three of the filter's own sigmas, and what that says of the part of all flights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import success_bounds
from lvnav_trade.metrics.basics.select import NAVIGATION, flight_events
from lvnav_trade.store import Tables, load
from lvnav_trade.store.schema import error_column

SIGMAS = 3.0
GAUSSIAN = 0.9973
"""Part of a Gaussian that lies within three sigmas."""
_TAIL = 0.025
"""Of each side of the interval."""


def coverage(results: Path | str | Tables, during: tuple[str, str] | None = None) -> pd.DataFrame:
    """Return the part of runs within three sigmas, axis by axis, of attitude, velocity and position at the events.

    Columns: case, event, t_s, quantity, run_count, inside_ratio (of runs, axes), all_inside_ratio (runs with all axes
    within), low_ratio, high_ratio (its 95 % interval, Clopper and Pearson), honest (whether the interval reaches what
    three independent Gaussian axes have, 0.9919). during: first and last event. Sigma is the filter's own, root mean
    square over the runs.
    """
    tables = load(results)
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        names = list(flight_events(tables, case).event)
        if during is not None and all(name in names for name in during):
            names = names[names.index(during[0]) : names.index(during[1]) + 1]
        for event in names:
            rows += [_row(tables, case, event, quantity, label) for quantity in NAVIGATION]
    return pd.DataFrame([row for row in rows if row])


def _row(tables: Tables, case: str, event: str, quantity: str, label: str) -> dict[str, Any]:
    history, runs = tables.history, tables.runs
    chosen = runs[(runs.case == case) & (runs.event == event)]
    mine = history[(history.case == case) & (history.quantity == quantity) & (history.axis != "3d")]
    if chosen.empty or mine.empty:
        return {}
    inside = []
    for axis, series in mine.groupby("axis", sort=False):
        nearest = int(np.argmin(np.abs(series.t_s.to_numpy() - float(chosen.t_s.iloc[0]))))
        sigma = float(series.filter_sigma_si.iloc[nearest])
        error = chosen[error_column(quantity, str(axis), str(series.unit.iloc[0]))].to_numpy(dtype=float)
        inside.append((chosen.failure.to_numpy() == "") & (np.abs(error) <= SIGMAS * sigma))
    within = np.array(inside)
    whole, n = within.all(axis=0), within.shape[1]
    out = int(n - whole.sum())
    low, high = success_bounds(n, out, 1.0 - _TAIL)
    return {
        "case": label,
        "event": event,
        "t_s": float(chosen.t_s.iloc[0]),
        "quantity": quantity,
        "run_count": n,
        "inside_ratio": float(within.mean()),
        "all_inside_ratio": float(whole.mean()),
        "low_ratio": low,
        "high_ratio": high,
        "honest": bool(high >= GAUSSIAN**3),
    }
