"""Errors of a case at an event or during a phase: rows of the history, and the value of every run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.select import SAME_TIME, errors_by_axis, instant, phase, pick, rows_between
from lvnav_trade.results.tables.dictionary import error_column, rms_column
from lvnav_trade.results.tables.read import Tables

if TYPE_CHECKING:
    import pandas as pd


def select_times(tables: Tables, case: str, rows: pd.DataFrame, statement: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of a history at the event or during the phase of a statement; empty for an unknown event.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    rows : pandas.DataFrame
        Rows of a history, with the column t_s.
    statement : mapping
        Statement or requirement, with `during` for a phase or `at` for an event.

    Returns
    -------
    pandas.DataFrame
        The rows of the phase, both ends included, or the single row closest to the event.
    """
    if statement.get("during"):
        first, last = phase(tables, case, str(statement["during"]))
        return rows_between(rows, first, last)
    t = instant(tables, case, _event_named(statement))
    if not np.isfinite(t):
        return rows.iloc[:0]
    distance = np.abs(rows.t_s.to_numpy() - t)
    nearest = int(np.argmin(distance))
    return rows.iloc[nearest : nearest + 1]


def run_values(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> Floats:
    """Return the number of a statement for every single run (n_run,), SI, in order; empty if it is not stored.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement: metric, and event or phase.
    unit : str
        SI unit of the metric, which the names of the columns contain.

    Returns
    -------
    (n_run,) array
        Magnitude of the error at the event, infinite for a failed run; for a phase, the RMS over the phase.
    """
    quantity, axis = split_metric(str(statement["metric"]))
    if statement.get("during"):
        return per_run(tables, case, statement, rms_column(quantity, axis, unit))
    return CaseTables(tables, case).sizes(_event_named(statement), quantity, axis)


def _event_named(statement: Mapping[str, Any]) -> str:
    """Return the event of a statement, which is injection by default."""
    return str(statement.get("at") or "injection")


def per_run(tables: Tables, case: str, statement: Mapping[str, Any], column: str) -> Floats:
    """Return the largest or RMS error of every run in a phase between events.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement with the phase `during`.
    column : str
        Column of the table `interval_errors`: largest error, or RMS.

    Returns
    -------
    (n_run,) array
        Errors in the order of the runs, SI, infinite for a failed run; empty if the results do not have them.
    """
    first, last = phase(tables, case, str(statement["during"]))
    case_intervals = pick(tables.interval_errors, case=case)
    intervals = rows_between(case_intervals, first, last, end="t_end_s")
    if intervals.empty or column not in intervals.columns or intervals[column].isna().all():
        return np.empty(0)
    # Errors are stored by interval between events, which cover a phase only if it starts and ends at events.
    starts_later = abs(intervals.t_s.min() - first) > SAME_TIME
    ends_earlier = abs(intervals.t_end_s.max() - last) > SAME_TIME
    if starts_later or ends_earlier:
        return np.empty(0)
    size = intervals[column].astype(float).mask(intervals.failure != "", np.inf)
    if "_rms_" not in column:
        return size.groupby(intervals.run_number).max().to_numpy()
    duration = intervals.t_end_s - intervals.t_s
    square_integral = (size**2 * duration).groupby(intervals.run_number).sum()
    total_duration = duration.groupby(intervals.run_number).sum()
    mean_square = square_integral / total_duration
    return np.sqrt(mean_square.to_numpy())


def signed_run_errors(tables: Tables, case: str, statement: Mapping[str, Any], unit: str) -> Floats:
    """Return the signed error of every run at an event, in the order of the runs.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement: metric of a single axis, and event.
    unit : str
        SI unit of the metric, which the names of the columns contain.

    Returns
    -------
    (n_run,) array
        Errors, SI; infinite for a failed run. It is empty for a phase, since signed errors are stored at events only.
    """
    quantity, axis = split_metric(str(statement["metric"]))
    if statement.get("during"):
        return np.empty(0)
    event = _event_named(statement)
    rows = errors_by_axis(tables, case, event, quantity)
    column = error_column(quantity, axis, unit)
    error = rows[column].astype(float)
    return error.mask(rows.failure != "", np.inf).to_numpy()
