"""Convergence time: time after which the error of a run stays below a limit, fixed or relative to another case."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.select import (
    at_time,
    errors_by_axis,
    flight_events,
    history_of,
    phase,
    pick,
    rows_between,
)
from lvnav_trade.results.tables.read import Tables


class ConvergenceTimes(NamedTuple):
    """Convergence times in a phase."""

    times: Floats  # (n_run,) s after the start of the phase; its length for a run that does not converge
    has_converged: NDArray[np.bool_]  # (n_run,) whether the run converges: it is below the limit at the last event
    lincov_time: float  # convergence time of the RMS error by linear covariance, s
    has_lincov_converged: bool  # whether this error converges
    n_event: int  # number of events at which the errors are compared with the limit
    length: float  # length of the phase, s


def parse_multiple(text: str) -> tuple[float, str] | None:
    """Return number and word of a limit such as ``3 sigma`` or ``3 rms``; None if it is a quantity."""
    number, _, word = text.strip().partition(" ")
    if word.strip() in ("sigma", "rms"):
        return (float(number), word.strip())
    return None


def convergence_times(
    tables: Tables,
    case: str,
    quantity: str,
    phase_times: tuple[float, float],
    limit_text: str,
    reference_case: str = "",
) -> ConvergenceTimes | None:
    """Return the times after which the 3-D error of a quantity stays below a limit, at the events of a phase.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity : str
        attitude, velocity or position.
    phase_times : (float, float)
        First and last time of the phase (s).
    limit_text : str
        Limit: a quantity with its unit, or a multiple of the error of `reference_case` by linear covariance at each
        event, ``rms`` (with the mean error) or ``sigma`` (without).
    reference_case : str
        Digest of the case whose sigma or RMS gives the limit; empty for a limit with a unit.

    Returns
    -------
    ConvergenceTimes or None
        Times; None without runs, or with fewer than two events in the phase. A failed run is above the limit.
    """
    first, last = phase_times
    events = rows_between(flight_events(tables, case), first, last)
    if len(events) < 2 or pick(tables.runs, case=case).empty:
        return None
    limits = _limits(tables, case, quantity, events, limit_text, reference_case)
    history = history_of(tables, case, quantity, "3d")
    runs_below, expected_below = [], []  # by event
    for event, t, limit in zip(events.event, events.t_s, limits, strict=True):
        rows = errors_by_axis(tables, case, event, quantity)
        size = np.linalg.norm(rows.drop(columns="failure").to_numpy(dtype=float), axis=1)
        runs_below.append((size < limit) & (rows.failure == "").to_numpy())
        expected_below.append([_rms(at_time(history, t)) < limit])
    times = np.append(events.t_s.to_numpy(), last)
    run_times, has_converged = _first_times_below(np.array(runs_below), times)
    lincov_time, has_lincov_converged = _first_times_below(np.array(expected_below), times)
    return ConvergenceTimes(
        times=run_times - first,
        has_converged=has_converged,
        lincov_time=float(lincov_time[0] - first),
        has_lincov_converged=bool(has_lincov_converged[0]),
        n_event=len(events),
        length=last - first,
    )


def _first_times_below(is_below: NDArray[np.bool_], times: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the times from which errors stay below their limit, and whether they do.

    Parameters
    ----------
    is_below : (n_event, n_run) array of bool
        Whether each error is below its limit at each event.
    times : (n_event + 1,) array
        Times of the events, and the time for an error that does not stay below.

    Returns
    -------
    (n_run,) array, (n_run,) array of bool
        Times, in the unit of `times`; whether the error stays below.
    """
    # number of last events without interruption at which the error is below the limit
    n_last = np.cumprod(is_below[::-1], axis=0).sum(axis=0)
    first = times[len(is_below) - n_last]
    return np.asarray(first), np.asarray(n_last > 0)


def _limits(
    tables: Tables, case: str, quantity: str, events: pd.DataFrame, limit_text: str, reference_case: str
) -> list[float]:
    """Return the limit of the error at each event, SI.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity : str
        Navigation error, such as position.
    events : pandas.DataFrame
        Events, with the column t_s.
    limit_text : str
        Limit with its unit, or a multiple of the sigma or RMS of `reference_case`.
    reference_case : str
        Digest of the case whose sigma or RMS gives the limit; empty for a limit with a unit.
    """
    multiple = parse_multiple(limit_text)
    if multiple is None:
        unit = str(pick(tables.outputs, case=case, quantity=quantity).unit.iloc[0])
        return [units.parse(limit_text, unit)] * len(events)
    number, word = multiple
    history = history_of(tables, reference_case, quantity, "3d")
    limits = []
    for t in events.t_s:
        row = at_time(history, t)
        limits.append(number * (row.lincov_true_si if word == "sigma" else _rms(row)))
    return limits


def _rms(row: Any) -> float:
    return math.hypot(row.lincov_true_si, row.lincov_mean_si)


def convergence(
    tables: Tables, case: str, statement: Mapping[str, Any], reference_case: str = ""
) -> ConvergenceTimes | None:
    """Return the convergence times of a statement.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    statement : mapping
        Statement: metric (such as position_convergence_time), `during`, `below`.
    reference_case : str
        Digest of the case whose sigma or RMS gives the limit; empty for a limit with a unit.
    """
    quantity = str(statement["metric"]).removesuffix("_convergence_time")
    phase_times = phase(tables, case, str(statement["during"]))
    return convergence_times(tables, case, quantity, phase_times, str(statement["below"]), reference_case)
