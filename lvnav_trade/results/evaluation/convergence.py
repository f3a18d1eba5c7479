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
    done: NDArray[np.bool_]  # (n_run,) whether the run converges: it is below the limit at the last event
    expected: float  # convergence time of the RMS error by linear covariance, s
    expected_done: bool  # whether this error converges
    n_event: int  # number of events at which the errors are compared with the limit
    length: float  # length of the phase, s


def multiple_in(text: str) -> tuple[float, str] | None:
    """Return number and word of a limit such as ``3 sigma`` or ``3 rms``; None if it is a quantity."""
    number, _, word = text.strip().partition(" ")
    return (float(number), word.strip()) if word.strip() in ("sigma", "rms") else None


def converged(
    tables: Tables, case: str, quantity: str, during: tuple[float, float], below: str, other: str = ""
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
    during : (float, float)
        First and last time of the phase (s).
    below : str
        Limit: a quantity with its unit, or a multiple of the error of the case `other` by linear covariance at each
        event, ``rms`` (with the mean error) or ``sigma`` (without).
    other : str
        Digest of the other case.

    Returns
    -------
    ConvergenceTimes or None
        Times; None without runs, or with fewer than two events in the phase. A failed run is above the limit.
    """
    first, last = during
    events = rows_between(flight_events(tables, case), first, last)
    if len(events) < 2 or pick(tables.runs, case=case).empty:
        return None
    limits, mine = _limits(tables, case, quantity, events, below, other), history_of(tables, case, quantity, "3d")
    small, expected = [], []
    for event, t, limit in zip(events.event, events.t_s, limits, strict=True):
        rows = errors_by_axis(tables, case, event, quantity)
        size = np.linalg.norm(rows.drop(columns="failure").to_numpy(dtype=float), axis=1)
        small.append((size < limit) & (rows.failure == "").to_numpy())
        expected.append([_rms(at_time(mine, t)) < limit])
    t = np.append(events.t_s.to_numpy(), last)

    def after(below_limit: list[Any]) -> tuple[Floats, NDArray[np.bool_]]:
        # number of last events without interruption at which the error is below the limit
        at_end = np.cumprod(np.array(below_limit)[::-1], axis=0).sum(axis=0)
        return np.asarray(t[len(events) - at_end] - first), np.asarray(at_end > 0)

    (times, done), (expected_time, expected_done) = after(small), after(expected)
    return ConvergenceTimes(times, done, float(expected_time[0]), bool(expected_done[0]), len(events), last - first)


def _limits(tables: Tables, case: str, quantity: str, events: pd.DataFrame, below: str, other: str) -> list[float]:
    multiple = multiple_in(below)
    if multiple is None:
        unit = str(pick(tables.outputs, case=case, quantity=quantity).unit.iloc[0])
        return [units.parse(below, unit)] * len(events)
    base = history_of(tables, other, quantity, "3d")
    number, word = multiple
    rows = [at_time(base, t) for t in events.t_s]
    return [number * (row.lincov_true_si if word == "sigma" else _rms(row)) for row in rows]


def _rms(row: Any) -> float:
    return math.hypot(row.lincov_true_si, row.lincov_mean_si)


def convergence(tables: Tables, case: str, stated: Mapping[str, Any], other: str = "") -> ConvergenceTimes | None:
    """Return the convergence times of a statement: metric (such as position_convergence_time), `during`, `below`."""
    quantity = str(stated["metric"]).removesuffix("_convergence_time")
    return converged(tables, case, quantity, phase(tables, case, str(stated["during"])), str(stated["below"]), other)
