"""Two levels of an axis on the same draws: how far their errors part, run by run, event by event."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.select import NAVIGATION, flight_events
from lvnav_trade.store import Tables, load
from lvnav_trade.store.schema import error_column


def paired_levels(results: Path | str | Tables, axis: str) -> pd.DataFrame:
    """Return the paired differences of cases that differ in one axis alone: its first level and each other one.

    Columns: case (the other levels), levels, event, quantity, unit, first_rms, second_rms, difference_rms (root mean
    square over the runs of the norm of the difference of their errors), difference_ratio (of the smaller of the two).
    """
    tables = load(results)
    groups: dict[str, list[tuple[str, str]]] = {}
    for row in tables.cases.itertuples():
        levels = json.loads(str(row.axes))
        own = levels.pop(axis, None)
        if own is not None:
            rest = ", ".join(f"{name}={level}" for name, level in levels.items()) or "base"
            groups.setdefault(rest, []).append((str(own), str(row.case)))
    rows: list[dict[str, Any]] = []
    for rest, ((first, case), *others) in groups.items():
        for level, other in others:
            for event in flight_events(tables, case).event:
                rows += _rows(tables, (case, other), str(event), {"case": rest, "levels": f"{first} and {level}"})
    return pd.DataFrame(rows)


def _rows(tables: Tables, pair: tuple[str, str], event: str, start: dict[str, Any]) -> list[dict[str, Any]]:
    found = []
    for quantity in NAVIGATION:
        sets = [_errors(tables, case, event, quantity) for case in pair]
        if any(one is None for one in sets):
            continue
        first, second = (one for one in sets if one is not None)
        n = min(len(first), len(second))
        unit, factor = tables.people[quantity, "3d"]
        sizes = [
            factor * float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
            for error in (first[:n], second[:n], second[:n] - first[:n])
        ]
        found.append(
            start
            | {"event": event, "quantity": quantity, "unit": unit, "first_rms": sizes[0], "second_rms": sizes[1]}
            | {"difference_rms": sizes[2], "difference_ratio": sizes[2] / min(sizes[:2])}
        )
    return found


def _errors(tables: Tables, case: str, event: str, quantity: str) -> np.ndarray[Any, Any] | None:
    """Return the errors (n_run, 3) of a quantity at an event, SI; None where they are not stored."""
    runs, outputs = tables.runs, tables.outputs
    chosen = runs[(runs.case == case) & (runs.event == event)].sort_values("run_number")
    mine = outputs[(outputs.case == case) & (outputs.quantity == quantity) & (outputs.axis != "3d")]
    if chosen.empty or mine.empty:
        return None
    columns = [error_column(quantity, str(row.axis), str(row.unit)) for row in mine.itertuples()]
    return np.asarray(chosen[columns].to_numpy(dtype=float))
