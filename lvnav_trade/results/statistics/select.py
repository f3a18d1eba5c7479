"""Selection of data from the tables for metrics: time series, events, instants and phases, errors of runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.statistics.case_results import SAME_TIME as SAME_TIME
from lvnav_trade.results.statistics.case_results import instant_time, phase_interval
from lvnav_trade.results.tables.dictionary import error_column
from lvnav_trade.results.tables.read import Tables
from lvnav_trade.results.tables.read import cache_result as cache_result
from lvnav_trade.results.tables.read import pick as pick
from lvnav_trade.results.tables.read import pick_columns as pick_columns

if TYPE_CHECKING:
    import pandas as pd

NAVIGATION = ("attitude", "velocity", "position")


def history_of(tables: Tables, case: str, quantity: str, axis: str) -> pd.DataFrame:
    """Return the time history of one error of a case: rows of the table `history`."""
    return pick(tables.history, case=case, quantity=quantity, axis=axis)


def with_display_units(tables: Tables, units: Mapping[str, str]) -> Tables:
    """Return the results with other display units (unit by quantity).

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    units : mapping of str to str
        Display unit by quantity.
    """
    if not units:
        return tables
    outputs = tables.outputs.copy()
    for row in outputs[outputs.quantity.isin(units)].itertuples():
        unit = units[row.quantity]
        factor = 1.0 / parse(f"1 {unit}", row.unit)
        outputs.loc[row.Index, ["label_unit", "label_factor_ratio"]] = unit, factor
    return tables.with_frames(outputs=outputs)


def cases_of(tables: Tables, level_by_axis: Mapping[str, str]) -> list[str]:
    """Return the digests of the cases whose axes have the wanted levels.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    level_by_axis : mapping of str to str
        Label of the level by axis.
    """
    cases = []
    for case, levels in tables.levels.items():
        if all(levels.get(axis) == str(level) for axis, level in level_by_axis.items()):
            cases.append(case)
    return cases


def errors_by_axis(tables: Tables, case: str, event: str, quantity: str) -> pd.DataFrame:
    """Return the errors of every run at an event, SI: a column per axis, and the column `failure`.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        Quantity, such as velocity.

    Returns
    -------
    pandas.DataFrame
        One row per run, indexed by its number. `failure` is empty for a run that did not fail. The errors are in the
        reporting axes.
    """
    outputs = pick(tables.outputs, case=case, quantity=quantity)
    components = outputs[outputs.axis != "3d"]
    columns = [error_column(quantity, row.axis, row.unit) for row in components.itertuples()]
    runs = pick(tables.runs, case=case, event=event).set_index("run_number")
    return runs[["failure", *columns]]


@cache_result
def flight_events(tables: Tables, case: str) -> pd.DataFrame:
    """Return the events of a case in order of time, without faults."""
    event_rows = pick(tables.events, case=case, kind="event")
    return event_rows.sort_values(["t_s", "event"], kind="stable").reset_index(drop=True)


def faults(tables: Tables, case: str) -> pd.DataFrame:
    """Return the faults of a case in order of time."""
    return pick(tables.events, case=case, kind="fault").sort_values("t_s", kind="stable")


def ends_of(tables: Tables, case: str) -> tuple[float, float]:
    """Return the first and last time (s) of the history of a case."""
    t = pick(tables.consistency, case=case).t_s
    return float(t.min()), float(t.max())


def phases(tables: Tables, case: str) -> list[tuple[str, float, float]]:
    """Return name, start and end (s since lift-off) of the flight, of each interval between events, of each event."""
    start, end = ends_of(tables, case)
    rows = flight_events(tables, case)
    rows = rows[(rows.t_s >= start) & (rows.t_s <= end)]
    events = list(zip(rows.event, rows.t_s, strict=True))
    instants = [("start", start), *events, ("end", end)]
    spans = [("flight", max(start, 0.0), end)]
    for (first, t_first), (second, t_second) in pairwise(instants):
        duration = t_second - t_first
        if duration > SAME_TIME:
            name = f"{first} to {second}"
            spans.append((name, t_first, t_second))
    spans += [(event, t, t) for event, t in events]
    return spans


def series(tables: Tables) -> Iterator[tuple[str, str, str, pd.DataFrame]]:
    """Yield case, quantity, axis and rows (in order of time) of every error of the history, in the plan's order."""
    for case, quantity, axis in names_of_series(tables):
        yield case, quantity, axis, history_of(tables, case, quantity, axis)


@cache_result
def names_of_series(tables: Tables) -> list[tuple[str, str, str]]:
    """Return case, quantity and axis of every error in the history, in the order of the plan."""
    columns = ["case", "quantity", "axis"]
    return list(tables.history.drop_duplicates(columns)[columns].itertuples(index=False, name=None))


def history_columns(tables: Tables, case: str, quantity: str, axis: str, *names: str) -> list[Floats]:
    """Return columns of the history of one error of a case, each (n_time,).

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity, axis : str
        The error; the axis 3d is the norm.
    *names : str
        Names of the columns of the table `history`.

    Returns
    -------
    list of (n_time,) array
        Columns in the order of their names, in the units of the table.
    """
    columns = pick_columns(tables.history, names, case=case, quantity=quantity, axis=axis)
    return [values.astype(float, copy=False) for values in columns]


def final_event(tables: Tables, case: str) -> str:
    """Return "injection" if the flight has this event, otherwise its last event."""
    names = list(flight_events(tables, case).event)
    if "injection" in names:
        return "injection"
    return names[-1] if names else ""


def lincov_rms(rows: pd.DataFrame) -> pd.Series:
    """Return the RMS error by linear covariance, sqrt(sigma^2 + mean^2)."""
    return np.hypot(rows.lincov_true_si, rows.lincov_mean_si)


def mean_at(tables: Tables, case: str, event: str, quantity: str) -> float:
    """Return the norm of the mean error at an event by linear covariance, in the display unit.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of an event that occurs.
    quantity : str
        Quantity, such as position.
    """
    t = float(pick(tables.events, case=case, event=event).t_s.iloc[0])
    mean_si = float(at_time(history_of(tables, case, quantity, "3d"), t).lincov_mean_si)
    _, factor = tables.display_units[quantity, "3d"]
    return mean_si * float(factor)


def at_time(rows: pd.DataFrame, t: float) -> pd.Series:
    """Return the row of a time series closest to a time (s)."""
    nearest = int(np.argmin(np.abs(rows.t_s.to_numpy() - t)))
    return rows.iloc[nearest]


def instant(tables: Tables, case: str, text: str, ends: tuple[float, float] | None = None) -> float:
    """Return the time (s) of an instant such as ``stage1_cutoff`` or ``stage1_cutoff + 30 s``; NaN if it has no event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    text : str
        The instant.
    ends : (float, float), optional
        Times (s) of ``start`` and ``end``; by default the ends of the history.
    """
    return instant_time(text, _event_times(tables, case), ends or ends_of(tables, case))


def phase(tables: Tables, case: str, text: str, ends: tuple[float, float] | None = None) -> tuple[float, float]:
    """Return the first and last time (s) of ``INSTANT to INSTANT``, or of ``flight``, from lift-off to the end.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    text : str
        The phase.
    ends : (float, float), optional
        Times (s) of ``start`` and ``end``; by default the ends of the history.

    Returns
    -------
    float, float
        First and last time (s), NaN if an event does not occur.
    """
    return phase_interval(text, _event_times(tables, case), ends or ends_of(tables, case))


def _event_times(tables: Tables, case: str) -> dict[str, float]:
    times: dict[str, float] = flight_events(tables, case).set_index("event").t_s.to_dict()
    return times


def rows_between(rows: pd.DataFrame, first: float, last: float, end: str = "t_s") -> pd.DataFrame:
    """Return the rows between two times, both included.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows with the column t_s.
    first, last : float
        The times (s).
    end : str
        Column with the end (s) of the interval of a row; by default each row is an instant.
    """
    starts_inside = rows.t_s >= first - SAME_TIME
    ends_inside = rows[end] <= last + SAME_TIME
    return rows[starts_inside & ends_inside]


def time_mean(t: np.ndarray, value: np.ndarray) -> float:
    """Return the mean over time by the trapezoidal rule, so that additional times of events add no weight.

    Parameters
    ----------
    t : (n,) array
        Times (s), ascending.
    value : (n,) array
        Values at these times.
    """
    duration = t[-1] - t[0]
    if duration > 0.0:
        return float(np.trapezoid(value, t) / duration)
    return float(value[0])
