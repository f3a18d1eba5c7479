"""Diagnostics of a covariance analysis: error budget, adjoint sensitivity, requirement margins, observability."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.confirming_runs import gaps, spot_check
from lvnav_trade.covariance.diagnostics.error_bound import ErrorBound, error_bound
from lvnav_trade.covariance.diagnostics.imu_stream import Curve, allan_curves
from lvnav_trade.covariance.diagnostics.nonlinearity import Nonlinearity, nonlinearity, open_loop_nonlinearity
from lvnav_trade.covariance.diagnostics.observability import TOLERANCE, in_words, observability
from lvnav_trade.covariance.diagnostics.protection import Protection, protection
from lvnav_trade.covariance.history import adjoint, covariance, forward_tape, source_covariances, turns
from lvnav_trade.covariance.sources import source_labels
from lvnav_trade.covariance.workspace import UpdateTape
from lvnav_trade.quantities.error_sources import Field, fields_of
from lvnav_trade.quantities.records import AdjointBudget, CovarianceRequest, CovHistory, Floats
from lvnav_trade.scenario.filter_models import sensors_used
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare
from lvnav_trade.simulation.statistics import BlockSummary

QUANTITIES = ("attitude", "velocity", "position")
_SHORTEST = 1.0  # s; a shorter phase is joined to the next
FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)


class SourceCovariance(NamedTuple):
    """True covariance at an event by error source.

    event : Name of the event.
    time : s since lift-off.
    sources : (n_source,). Names of the sources.
    covariance : (n_source, 3, 3, 3) SI squared. Of attitude, velocity and position, reporting axes; with a backup
        strapdown (n_source, 6, 3, 3), its errors last.
    """

    event: str
    time: float
    sources: tuple[str, ...]
    covariance: Floats


class PhaseView(NamedTuple):
    """Observability of the filter's states over a phase of flight.

    name : Name of the phase, or of the window.
    start : s since lift-off.
    end : s since lift-off.
    rank : Number of singular values above the tolerance.
    tolerance : Smallest singular value that counts.
    singular : (n_singular,). Singular values, descending.
    rows : Number of scalar measurements.
    weakest : Direction of the smallest singular value in words.
    directions : Directions of all singular values in words.
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


class SigmaSensitivity(NamedTuple):
    """Effect of the sigma of each error source on the true error of a quantity at one time.

    time : s since lift-off.
    quantity : Three-axis quantity, whose norm is assessed.
    sources : (n_source,). Names of the sources.
    factors : (n_factor,). Factors on the sigma.
    frozen : (n_source, n_factor) SI. True root-mean-square of the norm with the gains of the campaign's filter.
    retuned : (n_source, n_factor) SI. The same with a filter whose model has the new sigma.
    """

    time: float
    quantity: str
    sources: tuple[str, ...]
    factors: tuple[float, ...]
    frozen: Floats
    retuned: Floats


class CaseDiagnostics(NamedTuple):
    """Diagnostics of a case; a diagnostic that is not requested is empty.

    event : Event of the diagnostics.
    adjoint : Contributions of each source to the errors at the event, by time.
    by_source : Covariance by source at the events.
    sensitivity : Effect of each source's sigma on the errors at the event.
    phases : Observability by phase.
    nonlinear : Nonlinearity at every event and over every gap, with its name.
    bound : Bound on the error by the modelled noise.
    unbounded : Weakest direction of this bound in words.
    spot : Simulation runs that check linear covariance.
    allan : Allan deviation of the IMUs.
    protected : Protection levels.
    """

    event: str = ""
    adjoint: AdjointBudget | None = None
    by_source: tuple[SourceCovariance, ...] = ()
    sensitivity: tuple[SigmaSensitivity, ...] = ()
    phases: tuple[PhaseView, ...] = ()
    nonlinear: tuple[tuple[str, Nonlinearity], ...] = ()
    bound: ErrorBound | None = None
    unbounded: str = ""
    spot: BlockSummary | None = None
    allan: tuple[Curve, ...] = ()
    protected: Protection | None = None


def diagnose(
    scenario: Scenario, prepared: Prepared, history: CovHistory, request: CovarianceRequest
) -> CaseDiagnostics:
    """Return the requested diagnostics of a case; they share one forward pass.

    Parameters
    ----------
    scenario, prepared
        Validated model of the case, and the prepared case.
    history
        Linear covariance of the case.
    request
        Requested diagnostics.
    """
    events = flown_events(prepared)
    at = _event(events, request.at)
    tape = None
    if (events and (request.adjoint or request.observability)) or request.error_bound:
        tape = forward_tape(prepared)
    bound = error_bound(prepared, tape) if request.error_bound and tape is not None else None
    return CaseDiagnostics(
        at,
        adjoint(prepared, events[at], tape=tape) if at and request.adjoint else None,
        _by_source(prepared, events, (at, *request.events), tape) if at and request.adjoint else (),
        _sensitivities(scenario, prepared, history, events[at]) if at and request.sensitivity else (),
        _phases(prepared, events, tape, request.window) if request.observability else (),
        _nonlinearities(prepared, history, events) if request.nonlinearity else (),
        bound,
        _in_words(prepared, float(prepared.reference.t[0]), bound.weakest) if bound is not None else "",
        spot_check(prepared, history, events, request.seed, request.spot_check) if request.spot_check else None,
        allan_curves(prepared, request.allan, request.seed) if request.allan else (),
        protection(prepared, history, request.protection) if request.protection else None,
    )


def _nonlinearities(
    prepared: Prepared, history: CovHistory, events: Mapping[str, float]
) -> tuple[tuple[str, Nonlinearity], ...]:
    """Return the nonlinearity at every event and over every gap by name; of an open loop at the events only."""
    if prepared.scenario.filter.feedback == "open" and prepared.model.aided:
        times = dict.fromkeys(events.values())
        by_time = {t: open_loop_nonlinearity(prepared, history, t) for t in times}
        return tuple((name, by_time[t]) for name, t in events.items())
    return (
        *((name, nonlinearity(prepared, history, t)) for name, t in events.items()),
        *((gap.name, nonlinearity(prepared, history, gap.begin, end=gap.end)) for gap in gaps(history)),
    )


def flown_events(prepared: Prepared) -> dict[str, float]:
    """Return the events within the flight, s since lift-off by name."""
    first, last = prepared.t_hist[0], prepared.t_hist[-1]
    return {name: t for name, t in prepared.trajectory.events.items() if first <= t <= last}


def _event(events: dict[str, float], wanted: str) -> str:
    if wanted in events:
        return wanted
    return "injection" if "injection" in events else max(events, key=lambda name: events[name], default="")


def _by_source(
    prepared: Prepared, events: dict[str, float], wanted: tuple[str, ...], tape: UpdateTape | None
) -> tuple[SourceCovariance, ...]:
    sources = source_labels(prepared)
    return tuple(
        SourceCovariance(name, events[name], sources, source_covariances(prepared, events[name], tape))
        for name in dict.fromkeys(wanted)
        if name in events
    )


def _sensitivities(
    scenario: Scenario, prepared: Prepared, history: CovHistory, time: float
) -> tuple[SigmaSensitivity, ...]:
    known: dict[tuple[str, float], CovHistory] = {}
    quantities = np.array([output.quantity for output in prepared.outputs])
    return tuple(
        sensitivity(scenario, history, time, quantity, np.flatnonzero(quantities == quantity).tolist(), known=known)
        for quantity in QUANTITIES
    )


def _phases(
    prepared: Prepared, events: dict[str, float], tape: UpdateTape | None, window: float
) -> tuple[PhaseView, ...]:
    """Return the observability of the phases between events, or of windows of that many seconds (0: by events)."""
    marks = _windows(prepared, window) if window > 0.0 else _marks(prepared, events)
    edges = np.array([t for _, t in marks])
    stretches = observability(prepared, edges, tape)
    return tuple(
        PhaseView(
            f"{first} to {second}",
            s.start,
            s.end,
            s.rank,
            TOLERANCE,
            s.singular,
            s.rows,
            _in_words(prepared, s.start, s.weakest) if s.rows else "every direction",
            tuple(_in_words(prepared, s.start, direction) for direction in s.directions) if s.rows else (),
        )
        for ((first, _), (second, _)), s in zip(pairwise(marks), stretches, strict=True)
    )


def _in_words(prepared: Prepared, start: float, direction: Floats) -> str:
    """Return a direction of the state space in words, in reporting axes.

    direction : (n,) in units of the initial sigmas of the states; a state without initial sigma in its own unit. The
    words are in units of the initial sigmas in reporting axes.
    """
    turn = turns(prepared)[int(np.argmin(np.abs(prepared.t_hist - start)))]
    states = np.array(prepared.layout.reported)
    P = prepared.start.P[np.ix_(states, states)]
    spread, sigma = np.sqrt(np.diag(P)), np.sqrt(np.diag(turn @ P @ turn.T))
    turned = turn @ (np.where(spread > 0.0, spread, 1.0) * direction) / np.where(sigma > 0.0, sigma, 1.0)
    names = tuple(f"{o.quantity.replace('_', ' ')} {o.axis}" for o in prepared.outputs)
    return in_words(turned / turned[np.argmax(np.abs(turned))], names)


def _windows(prepared: Prepared, window: float) -> list[tuple[str, float]]:
    """Return names and times of the edges of windows from the start on; the last window includes the remainder."""
    t = prepared.reference.t
    edges = t[0] + window * np.arange(int((t[-1] - t[0]) / window + 1e-9))
    return [(f"{edge:g} s", float(edge)) for edge in (*edges, t[-1])]


def _marks(prepared: Prepared, events: dict[str, float]) -> list[tuple[str, float]]:
    """Return names and times of the bounds of the phases."""
    t = prepared.reference.t
    marks = [("start", float(t[0]))]
    for name, time in sorted(events.items(), key=lambda item: item[1]):
        if time - marks[-1][1] >= _SHORTEST:
            marks.append((name, time))
    if t[-1] - marks[-1][1] >= _SHORTEST:
        marks.append(("end", float(t[-1])))
    return marks


def _multiplied(model: Any, path: tuple[str, ...], factor: float) -> Any:
    """Return a card (or a mapping or tuple of cards) with the number at a path multiplied; in every part if several."""
    if not path:
        return tuple(factor * value for value in model) if isinstance(model, tuple) else model * factor
    head, rest = path[0], path[1:]
    if isinstance(model, dict):
        return model | {head: _multiplied(model[head], rest, factor)}
    if isinstance(model, tuple):
        return tuple(_multiplied(item, rest, factor) if k == int(head) else item for k, item in enumerate(model))
    if head not in type(model).model_fields and "parts" in type(model).model_fields:
        return model.model_copy(update={"parts": tuple(_multiplied(part, path, factor) for part in model.parts)})
    value = getattr(model, head, None)
    if value is None:
        return model
    return model.model_copy(update={head: _multiplied(value, rest, factor)})


def _fields(scenario: Scenario, source: str) -> tuple[Field, ...]:
    """Return the fields of the scenario with the sigma of an error source."""
    used = sensors_used(scenario)
    alone = {name: [c.measurement for c in used.values()].count(card.measurement) == 1 for name, card in used.items()}
    for name, card in used.items():
        if source == (card.noise if alone[name] else f"{card.noise} {name}"):
            return tuple((("sensors", name, field), 1) for field in card.noise_fields)
        fields = [
            error.field
            for error in card.lasting()
            if source == (error.source if alone[name] else f"{error.source} {name}")
        ]
        if fields:
            return tuple((("sensors", name, field), 1) for field in fields)
    return fields_of(source)


def scaled(scenario: Scenario, source: str, factor: float) -> Scenario:
    """Return the scenario with the sigma of an error source multiplied; a `matched` filter model follows."""
    for path, power in _fields(scenario, source):
        scenario = _multiplied(scenario, path, factor**power)
    return scenario


def sensitivity(
    scenario: Scenario,
    history: CovHistory,
    time: float,
    quantity: str,
    columns: list[int],
    share: float = 0.01,
    known: dict[tuple[str, float], CovHistory] | None = None,
) -> SigmaSensitivity:
    """Return the sensitivity of a quantity to the sigmas of its main error sources.

    With frozen gains the variance of a source scales with the square of its factor, so no further computation is
    needed. With a retuned filter each factor needs a linear covariance.

    Parameters
    ----------
    scenario
        Validated model of the case.
    history
        Linear covariance of the scenario.
    time
        s since lift-off, a history time.
    quantity, columns
        Name of a three-axis quantity, and its columns.
    share
        Smallest fraction of the variance for which a source is included. Sources whose sigma is not a field of the
        scenario are omitted.
    known
        Cache of linear covariances by (source, factor), which is extended; all quantities need the same.
    """
    known = {} if known is None else known
    hist = int(np.argmin(np.abs(history.t - time)))
    by_source = history.budget[hist][:, columns].sum(axis=1)
    total = by_source.sum() + np.sum(history.mean[hist, columns] ** 2)
    chosen = [
        k
        for k in np.argsort(-by_source)
        if by_source[k] >= share * by_source.sum() and _fields(scenario, history.sources[k])
    ]
    factors = np.array(FACTORS)
    frozen = np.sqrt(total + (factors**2 - 1.0) * by_source[chosen][:, None])
    retuned = np.empty_like(frozen)
    for row, k in enumerate(chosen):
        for column, factor in enumerate(FACTORS):
            key = history.sources[k], factor
            if factor != 1.0 and key not in known:
                known[key] = covariance(prepare(scaled(scenario, *key)))
            tuned = history if factor == 1.0 else known[key]
            at = int(np.argmin(np.abs(tuned.t - time)))
            retuned[row, column] = np.sqrt(np.sum(tuned.true_sigma[at, columns] ** 2 + tuned.mean[at, columns] ** 2))
    return SigmaSensitivity(
        float(history.t[hist]), quantity, tuple(history.sources[k] for k in chosen), FACTORS, frozen, retuned
    )
