"""Time after which the error of a run stays below a limit: a size, or three times that of another case."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from lvnav_trade import units
from lvnav_trade.metrics.basics.select import (
    at_time,
    errors_by_axis,
    flight_events,
    history_of,
    phase,
    pick,
    rows_between,
)
from lvnav_trade.records import Floats
from lvnav_trade.store.read import Tables


class Converged(NamedTuple):
    """Times (n_run,) s after the start of a phase, the same of linear covariance's root mean square, and at how many
    events they are read. A run that is not below the limit at the last event has the length of the phase as its time
    and is not `done` (n_run,).
    """

    times: Floats
    done: NDArray[np.bool_]
    expected: float
    expected_done: bool
    n_event: int
    length: float


def multiple_in(text: str) -> tuple[float, str] | None:
    """Return number and word of a limit such as ``3 sigma`` or ``3 rms``; None where it is a quantity."""
    number, _, word = text.strip().partition(" ")
    return (float(number), word.strip()) if word.strip() in ("sigma", "rms") else None


def converged(
    tables: Tables, case: str, quantity: str, during: tuple[float, float], below: str, other: str = ""
) -> Converged | None:
    """Return after what time the 3-D error of a quantity stays below a limit at the events of a phase (first, last s);
    None without runs or events there. A failed run is above.

    below: a size, or a multiple of the error of the case `other` by linear covariance at each event: ``rms`` with its
    mean, ``sigma`` without.
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
        at_end = np.cumprod(np.array(below_limit)[::-1], axis=0).sum(axis=0)  # events at the end at which all is below
        return np.asarray(t[len(events) - at_end] - first), np.asarray(at_end > 0)

    (times, done), (own, own_done) = after(small), after(expected)
    return Converged(times, done, float(own[0]), bool(own_done[0]), len(events), last - first)


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


def convergence(tables: Tables, case: str, stated: Mapping[str, Any], other: str = "") -> Converged | None:
    """Return the same of what is stated of a case: a metric such as position_convergence_time, during, below."""
    quantity = str(stated["metric"]).removesuffix("_convergence_time")
    return converged(tables, case, quantity, phase(tables, case, str(stated["during"])), str(stated["below"]), other)
