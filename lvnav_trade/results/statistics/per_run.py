"""Number of a case at an event or during a phase: its rows of the history, and the values of the single runs."""

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


def within(tables: Tables, case: str, rows: pd.DataFrame, stated: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rows of a history at the event or during the phase of a statement; empty for an unknown event."""
    if stated.get("during"):
        return rows_between(rows, *phase(tables, case, str(stated["during"])))
    at = instant(tables, case, str(stated.get("at") or "injection"))
    if not np.isfinite(at):
        return rows.iloc[:0]
    nearest = int(np.argmin(np.abs(rows.t_s.to_numpy() - at)))
    return rows.iloc[nearest : nearest + 1]


def of_each(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Floats:
    """Return the number of a statement for every single run (n_run,), SI, in order; empty if it is not stored."""
    quantity, axis = split_metric(str(stated["metric"]))
    if stated.get("during"):
        return per_run(tables, case, stated, rms_column(quantity, axis, unit))
    return CaseTables(tables, case).sizes(str(stated.get("at") or "injection"), quantity, axis)


def per_run(tables: Tables, case: str, stated: Mapping[str, Any], column: str) -> Floats:
    """Return the largest or RMS error of every run in a phase between events.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    stated : mapping
        Statement with the phase `during`.
    column : str
        Column of the table `worst`: largest error, or RMS.

    Returns
    -------
    (n_run,) array
        Errors in the order of the runs, SI, infinite for a failed run; empty if the results do not have them.
    """
    first, last = phase(tables, case, str(stated["during"]))
    within = rows_between(pick(tables.interval_errors, case=case), first, last, end="t_end_s")
    lacks = within.empty or column not in within.columns or within[column].isna().all()
    if lacks or abs(within.t_s.min() - first) > SAME_TIME or abs(within.t_end_s.max() - last) > SAME_TIME:
        return np.empty(0)
    size = within[column].astype(float).mask(within.failure != "", np.inf)
    if "_rms_" not in column:
        return size.groupby(within.run_number).max().to_numpy()
    length = within.t_end_s - within.t_s
    total, duration = (part.groupby(within.run_number).sum() for part in (size**2 * length, length))
    return np.sqrt((total / duration).to_numpy())


def signed(tables: Tables, case: str, stated: Mapping[str, Any], unit: str) -> Floats:
    """Return the signed error of every run (n_run,), SI, in the order of the runs; infinite for a failed run.

    It is empty for a phase, since signed errors are stored at events only.
    """
    quantity, axis = split_metric(str(stated["metric"]))
    if stated.get("during"):
        return np.empty(0)
    rows = errors_by_axis(tables, case, str(stated.get("at") or "injection"), quantity)
    return rows[error_column(quantity, axis, unit)].astype(float).mask(rows.failure != "", np.inf).to_numpy()
