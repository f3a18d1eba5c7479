"""Errors of the runs themselves: how many lie within the filter's own sigmas, and how far two levels differ."""

import json
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.intervals import success_bounds
from lvnav_trade.metrics.basics.select import NAVIGATION, at_time, errors_by_axis, flight_events, history_of, pick
from lvnav_trade.store import Tables

SIGMAS = 3.0
GAUSSIAN = 0.9973
"""Part of a Gaussian that lies within three sigmas."""
_TAIL = 0.025
"""Of each side of the interval."""


def coverage(tables: Tables, during: tuple[str, str] | None = None) -> pd.DataFrame:
    """Return the part of runs within three sigmas, axis by axis, of attitude, velocity and position at the events.

    Columns: case, event, t_s, quantity, run_count, inside_ratio (of runs, axes), all_inside_ratio (runs with all axes
    within), low_ratio, high_ratio (its 95 % interval, Clopper and Pearson), honest (whether the interval reaches what
    three independent Gaussian axes have, 0.9919). during: first and last event. Sigma is the filter's own, root mean
    square over the runs.
    """
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        names = list(flight_events(tables, case).event)
        if during is not None and all(name in names for name in during):
            names = names[names.index(during[0]) : names.index(during[1]) + 1]
        for event in names:
            start = {"case": label, "event": event}
            rows += [start | _inside(tables, case, event, quantity) for quantity in NAVIGATION]
    return pd.DataFrame([row for row in rows if "quantity" in row])


def _inside(tables: Tables, case: str, event: str, quantity: str) -> dict[str, Any]:
    runs = errors_by_axis(tables, case, event, quantity)
    axes = [row.axis for row in pick(tables.outputs, case=case, quantity=quantity).itertuples() if row.axis != "3d"]
    if runs.empty or not axes:
        return {}
    t = float(pick(tables.runs, case=case, event=event).t_s.iloc[0])
    sigma = [at_time(history_of(tables, case, quantity, axis), t).filter_sigma_si for axis in axes]
    small = runs.drop(columns="failure").abs() <= SIGMAS * np.array(sigma)
    within = small.to_numpy() & (runs.failure == "").to_numpy()[:, None]
    whole, n = within.all(axis=1), len(within)
    low, high = success_bounds(n, int(n - whole.sum()), 1.0 - _TAIL)
    found = {"t_s": t, "quantity": quantity, "run_count": n, "inside_ratio": float(within.mean())}
    found |= {"all_inside_ratio": float(whole.mean()), "low_ratio": low, "high_ratio": high}
    return found | {"honest": bool(high >= GAUSSIAN**3)}


def paired_levels(tables: Tables, axis: str) -> pd.DataFrame:
    """Return the paired differences of cases that differ in one axis alone: its first level and each other one.

    Columns: case (the other levels), levels, event, quantity, unit, first_rms, second_rms, difference_rms (root mean
    square over the runs of the norm of the difference of their errors), difference_ratio (of the smaller of the two).
    """
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
            start = {"case": rest, "levels": f"{first} and {level}"}
            for event in flight_events(tables, case).event:
                found = (_paired(tables, (case, other), str(event), quantity) for quantity in NAVIGATION)
                rows += [start | {"event": event} | sizes for sizes in found if sizes]
    return pd.DataFrame(rows)


def _paired(tables: Tables, pair: tuple[str, str], event: str, quantity: str) -> dict[str, Any]:
    """Return the root mean squares of two cases and of their difference at an event; empty where one is not stored."""
    both = [errors_by_axis(tables, case, event, quantity).sort_index().drop(columns="failure") for case in pair]
    if any(errors.empty for errors in both):
        return {}
    n = min(map(len, both))
    first, second = (errors.to_numpy(dtype=float)[:n] for errors in both)
    unit, factor = tables.people[quantity, "3d"]
    sizes = [factor * float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for e in (first, second, second - first)]
    names = ("first_rms", "second_rms", "difference_rms")
    ratio = {"difference_ratio": sizes[2] / min(sizes[:2])}
    return {"quantity": quantity, "unit": unit, **dict(zip(names, sizes, strict=True)), **ratio}
