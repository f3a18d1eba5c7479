"""Behind a case's linear covariance: which source, when, what a better one is worth, what the rows can tell."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.analysis.error_bound import ErrorBound, error_bound
from lvnav_trade.engines.analysis.nonlinearity import Nonlinearity, nonlinearity
from lvnav_trade.engines.analysis.observability import TOLERANCE, in_words, observability
from lvnav_trade.engines.analysis.retune import Sensitivity, sensitivity
from lvnav_trade.engines.lincov.history import adjoint, forward_tape, source_covariances, turns
from lvnav_trade.engines.lincov.sources import source_labels
from lvnav_trade.engines.lincov.workspace import Tape
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.records import AdjointBudget, Asked, CovHistory, Floats
from lvnav_trade.scenario import Scenario

QUANTITIES = ("attitude", "velocity", "position")
_SHORTEST = 1.0
"""Seconds: a shorter phase is joined to the one after it."""


class SourceCovariance(NamedTuple):
    """True covariance (n_source, 3, 3, 3) of attitude, velocity and position at an event by source, SI."""

    event: str
    time: float
    sources: tuple[str, ...]
    covariance: Floats


class PhaseView(NamedTuple):
    """What the rows of a phase of flight tell: name, start, end s, rank, tolerance, singular (n_state,) values, rows,
    the weakest direction in words, and those of all singular values.
    """

    name: str
    start: float
    end: float
    rank: int
    tolerance: float
    singular: Floats
    rows: int
    weakest: str
    directions: tuple[str, ...] = ()


class Explanation(NamedTuple):
    """All that was asked of a case; empty where not asked. nonlinear: event name and nonlinearity at every event; bound
    of the assumed noise, and unbounded, its weakest direction in words.
    """

    event: str = ""
    adjoint: AdjointBudget | None = None
    by_source: tuple[SourceCovariance, ...] = ()
    sensitivity: tuple[Sensitivity, ...] = ()
    phases: tuple[PhaseView, ...] = ()
    nonlinear: tuple[tuple[str, Nonlinearity], ...] = ()
    bound: ErrorBound | None = None
    unbounded: str = ""


def explain(scenario: Scenario, prepared: Prepared, history: CovHistory, asked: Asked) -> Explanation:
    """Return what was asked of a case; one forward pass serves all of it."""
    events = flown_events(prepared)
    at = _event(events, asked.at)
    tape = None
    if (events and (asked.adjoint or asked.observability)) or asked.error_bound:
        tape = forward_tape(prepared)
    bound = error_bound(prepared, tape) if asked.error_bound and tape is not None else None
    return Explanation(
        at,
        adjoint(prepared, events[at], tape=tape) if at and asked.adjoint else None,
        _by_source(prepared, events, (at, *asked.events), tape) if at and asked.adjoint else (),
        _sensitivities(scenario, prepared, history, events[at]) if at and asked.sensitivity else (),
        _phases(prepared, events, tape, asked.window) if asked.observability else (),
        tuple((name, nonlinearity(prepared, history, t)) for name, t in events.items()),
        bound,
        _in_words(prepared, float(prepared.reference.t[0]), bound.weakest) if bound is not None else "",
    )


def flown_events(prepared: Prepared) -> dict[str, float]:
    """Return the events within the flight: those that the history holds."""
    first, last = prepared.reference.t[0], prepared.reference.t[-1]
    return {name: t for name, t in prepared.trajectory.events.items() if first <= t <= last}


def _event(events: dict[str, float], wanted: str) -> str:
    if wanted in events:
        return wanted
    return "injection" if "injection" in events else max(events, key=lambda name: events[name], default="")


def _by_source(
    prepared: Prepared, events: dict[str, float], wanted: tuple[str, ...], tape: Tape | None
) -> tuple[SourceCovariance, ...]:
    sources = source_labels(prepared)
    return tuple(
        SourceCovariance(name, events[name], sources, source_covariances(prepared, events[name], tape))
        for name in dict.fromkeys(wanted)
        if name in events
    )


def _sensitivities(scenario: Scenario, prepared: Prepared, history: CovHistory, time: float) -> tuple[Sensitivity, ...]:
    known: dict[tuple[str, float], CovHistory] = {}
    columns = {
        quantity: [i for i, output in enumerate(prepared.outputs) if output.quantity == quantity]
        for quantity in QUANTITIES
    }
    return tuple(
        sensitivity(scenario, history, time, quantity, found, known=known) for quantity, found in columns.items()
    )


def _phases(prepared: Prepared, events: dict[str, float], tape: Tape | None, window: float) -> tuple[PhaseView, ...]:
    """Return the observability of the stretches between events, or of windows of that many seconds (0: none)."""
    marks = _windows(prepared, window) if window > 0.0 else _marks(prepared, events)
    edges = np.array([t for _, t in marks])
    stretches = observability(prepared, edges, tape)
    return tuple(
        PhaseView(
            f"{first} to {second}", s.start, s.end, s.rank, TOLERANCE, s.singular, s.rows,
            _in_words(prepared, s.start, s.weakest) if s.rows else "every direction",
            tuple(_in_words(prepared, s.start, one) for one in s.directions) if s.rows else (),
        )
        for ((first, _), (second, _)), s in zip(pairwise(marks), stretches, strict=True)
    )  # fmt: skip


def _in_words(prepared: Prepared, start: float, direction: Floats) -> str:
    """Say a direction in initial sigmas of the states in words, in initial sigmas of the reporting axes; of a state
    that has none, in its unit.
    """
    turn = turns(prepared)[int(np.argmin(np.abs(prepared.t_hist - start)))]
    P = prepared.start.P
    spread, sigma = np.sqrt(np.diag(P)), np.sqrt(np.diag(turn @ P @ turn.T))
    found = turn @ (np.where(spread > 0.0, spread, 1.0) * direction) / np.where(sigma > 0.0, sigma, 1.0)
    names = tuple(f"{o.quantity.replace('_', ' ')} {o.axis}" for o in prepared.outputs)
    return in_words(found / found[np.argmax(np.abs(found))], names)


def _windows(prepared: Prepared, window: float) -> list[tuple[str, float]]:
    """Return the edges of whole windows from the start on; what is left at the end belongs to the last one."""
    t = prepared.reference.t
    edges = t[0] + window * np.arange(int((t[-1] - t[0]) / window + 1e-9))
    return [(f"{edge:g} s", float(edge)) for edge in (*edges, t[-1])]


def _marks(prepared: Prepared, events: dict[str, float]) -> list[tuple[str, float]]:
    """Return the names and times between which the phases lie."""
    t = prepared.reference.t
    marks = [("start", float(t[0]))]
    for name, time in sorted(events.items(), key=lambda item: item[1]):
        if time - marks[-1][1] >= _SHORTEST:
            marks.append((name, time))
    if t[-1] - marks[-1][1] >= _SHORTEST:
        marks.append(("end", float(t[-1])))
    return marks
