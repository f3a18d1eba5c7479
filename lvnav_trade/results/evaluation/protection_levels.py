"""Protection levels: their magnitude, and how often errors of runs exceed them."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.statistics.select import SAME_TIME, errors_by_axis, final_event, flight_events, instant, pick
from lvnav_trade.results.tables.read import Tables

CONFIDENCE = 0.975  # of each one-sided bound; both together 95 %
COLUMNS = [
    "case",
    "quantity",
    "unit",
    "largest",
    "final",
    "fault_free",
    "sigma",
    "satellite",
    "error_count",
    "beyond_count",
    "low_ratio",
    "high_ratio",
]


def series_of(tables: Tables, case: str, quantity: str) -> pd.DataFrame:
    """Return the protection level of a quantity over time: the norm of the levels of its three axes."""
    return pick(tables.protection, case=case, quantity=quantity, axis="3d").sort_values("t_s", kind="stable")


def level_exceedances(tables: Tables, case: str, quantity: str) -> tuple[int, int]:
    """Count the errors of runs at events that exceed their protection level.

    An error counts if it exceeds the level on any axis and no alarm of solution separation was raised before. Errors of
    failed runs count as exceeding.

    Returns
    -------
    int, int
        Number of errors beyond their level, number of all errors.
    """
    rows, count, total = pick(tables.protection, case=case, quantity=quantity), 0, 0
    alarm = pick(tables.integrity, case=case, isolated_element="separation").groupby("run_number").t_s.min()
    for event in flight_events(tables, case).itertuples():
        errors = errors_by_axis(tables, case, str(event.event), quantity)
        if errors.empty or not len(rows):
            continue
        at = rows[np.abs(rows.t_s - event.t_s) == np.abs(rows.t_s - event.t_s).min()]
        level = at[at.axis != "3d"].level_si.to_numpy()
        sizes = np.abs(errors.drop(columns="failure").to_numpy(dtype=float))
        silent = ~(alarm.reindex(errors.index).to_numpy() <= event.t_s + SAME_TIME)
        out = silent & ((sizes > level).any(axis=1) | (errors.failure != "").to_numpy())
        count, total = count + int(out.sum()), total + len(out)
    return count, total


def protection(tables: Tables) -> pd.DataFrame:
    """Return the protection levels of every case and quantity, in display units.

    largest: largest level of the flight. final, fault_free, sigma: level, level without faults and formal sigma at
    injection (or the last event). satellite: satellite whose exclusion gives the level there. error_count,
    beyond_count: number of errors of runs at events, and of those beyond their level. low_ratio, high_ratio: exact 95 %
    interval of their fraction.
    """
    found: list[tuple[Any, ...]] = []
    for case, label in tables.labels.items():
        for quantity in PROTECTED:
            rows = series_of(tables, case, quantity)
            if rows.empty:
                continue
            unit, factor = tables.people[quantity, "3d"]
            at = instant(tables, case, final_event(tables, case) or "end")
            last = rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - at)))]
            sizes = [
                float(value) * float(factor)
                for value in (rows.level_si.max(), last.level_si, last.fault_free_si, last.sigma_si)
            ]
            count, total = level_exceedances(tables, case, quantity)
            low, high = success_bounds(total, total - count, CONFIDENCE) if total else (np.nan, np.nan)
            found.append((label, quantity, unit, *sizes, last.satellite, total, count, low, high))
    return pd.DataFrame(found, columns=COLUMNS)
