"""Instants and phases of a flight by name: ``stage1_cutoff + 30 s``, ``liftoff to injection``."""

from __future__ import annotations

import re

import numpy as np

from lvnav_trade.metrics.basics.select import flight_events
from lvnav_trade.store import Tables
from lvnav_trade.units import parse

FLIGHT = "flight"
_INSTANT = re.compile(r"\s*(?P<event>[A-Za-z_]\w*)\s*(?:(?P<sign>[+-])\s*(?P<offset>\S.*))?$")


def instant(tables: Tables, case: str, text: str) -> float:
    """Return the time (s) of an event, with a duration added or taken away; NaN for one that the flight does not have.

    ``start`` and ``end`` are the ends of the history.
    """
    t = tables.consistency.t_s[tables.consistency.case == case]
    known = {"start": float(t.min()), "end": float(t.max())}
    known |= flight_events(tables, case).set_index("event").t_s.to_dict()
    match = _INSTANT.match(text)
    if match is None or match["event"] not in known:
        return float("nan")
    offset = parse(match["offset"].strip(), "s") if match["offset"] else 0.0
    return float(known[match["event"]]) + (-offset if match["sign"] == "-" else offset)


def phase(tables: Tables, case: str, text: str) -> tuple[float, float]:
    """Return first and last time (s) of ``INSTANT to INSTANT``, or of ``flight``: from lift-off to the end.

    NaN where an event is not in the flight.
    """
    if text == FLIGHT:
        return max(instant(tables, case, "start"), 0.0), instant(tables, case, "end")
    first, _, last = text.partition(" to ")
    return instant(tables, case, first), instant(tables, case, last)


def time_mean(t: np.ndarray, value: np.ndarray) -> float:
    """Return the mean over time by the trapezoidal rule: event times between the grid add no weight."""
    return float(np.trapezoid(value, t) / (t[-1] - t[0])) if t[-1] > t[0] else float(value[0])
