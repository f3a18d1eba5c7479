"""Protection levels: their magnitude, and how often errors of runs exceed them."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.statistics.select import (
    SAME_TIME,
    at_time,
    errors_by_axis,
    final_event,
    flight_events,
    instant,
    pick,
)
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


def protection_series(tables: Tables, case: str, quantity: str) -> pd.DataFrame:
    """Return the protection level of a quantity over time: the norm of the levels of its three axes.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity : str
        position or velocity.
    """
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
    levels = pick(tables.protection, case=case, quantity=quantity)
    if levels.empty:
        return 0, 0
    alarms = pick(tables.integrity, case=case, isolated_element="separation")
    t_alarm = alarms.groupby("run_number").t_s.min()
    n_exceeding = n_error = 0
    for event in flight_events(tables, case).itertuples():
        errors = errors_by_axis(tables, case, str(event.event), quantity)
        if errors.empty:
            continue
        distance = np.abs(levels.t_s - event.t_s)
        nearest = levels[distance == distance.min()]
        level = nearest[nearest.axis != "3d"].level_si.to_numpy()
        components = errors.drop(columns="failure").to_numpy(dtype=float)
        size = np.abs(components)
        is_silent = ~(t_alarm.reindex(errors.index).to_numpy() <= event.t_s + SAME_TIME)  # NaN: no alarm
        has_failed = (errors.failure != "").to_numpy()
        is_beyond = (size > level).any(axis=1) | has_failed
        n_exceeding += int((is_silent & is_beyond).sum())
        n_error += len(errors)
    return n_exceeding, n_error


def protection(tables: Tables) -> pd.DataFrame:
    """Return the protection levels of every case and quantity, in display units.

    largest: largest level of the flight. final, fault_free, sigma: level, level without faults and formal sigma at
    injection (or the last event). satellite: satellite whose exclusion gives the level there. error_count,
    beyond_count: number of errors of runs at events, and of those beyond their level. low_ratio, high_ratio: exact 95 %
    interval of their fraction.
    """
    rows: list[dict[str, Any]] = []
    for case, label in tables.labels.items():
        for quantity in PROTECTED:
            levels = protection_series(tables, case, quantity)
            if levels.empty:
                continue
            unit, factor = tables.display_units[quantity, "3d"]
            last = at_time(levels, instant(tables, case, final_event(tables, case) or "end"))
            n_exceeding, n_error = level_exceedances(tables, case, quantity)
            low = high = np.nan
            if n_error:
                low, high = success_bounds(n_error, n_error - n_exceeding, CONFIDENCE)
            row = {
                "case": label,
                "quantity": quantity,
                "unit": unit,
                "largest": float(levels.level_si.max()) * float(factor),
                "final": float(last.level_si) * float(factor),
                "fault_free": float(last.fault_free_si) * float(factor),
                "sigma": float(last.sigma_si) * float(factor),
                "satellite": last.satellite,
                "error_count": n_error,
                "beyond_count": n_exceeding,
                "low_ratio": low,
                "high_ratio": high,
            }
            rows.append(row)
    return pd.DataFrame(rows, columns=COLUMNS)
