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
    event = _choose_event(events, request.at)
    results: dict[str, Any] = {"event": event}
    tape = None
    if (events and (request.adjoint or request.observability)) or request.error_bound:
        tape = forward_tape(prepared)
    if event and request.adjoint:
        results["adjoint"] = adjoint(prepared, events[event], tape=tape)
        results["by_source"] = _source_covariances(prepared, events, (event, *request.events), tape)
    if event and request.sensitivity:
        results["sensitivity"] = _sensitivities(scenario, prepared, history, events[event])
    if request.observability:
        results["phases"] = _phases(prepared, events, tape, request.window)
    if request.nonlinearity:
        results["nonlinear"] = _nonlinearities(prepared, history, events)
    if request.error_bound and tape is not None:
        bound = error_bound(prepared, tape)
        results["bound"] = bound
        results["unbounded"] = _in_words(prepared, float(prepared.reference.t[0]), bound.weakest)
    if request.spot_check:
        results["spot"] = spot_check(prepared, history, events, request.seed, request.spot_check)
    if request.allan:
        results["allan"] = allan_curves(prepared, request.allan, request.seed)
    if request.protection:
        results["protected"] = protection(prepared, history, request.protection)
    return CaseDiagnostics(**results)


def _nonlinearities(
    prepared: Prepared, history: CovHistory, events: Mapping[str, float]
) -> tuple[tuple[str, Nonlinearity], ...]:
    """Return the nonlinearity at every event and over every gap by name; of an open loop at the events only."""
    if prepared.scenario.filter.feedback == "open" and prepared.model.aided:
        times = dict.fromkeys(events.values())
        by_time = {t: open_loop_nonlinearity(prepared, history, t) for t in times}
        return tuple((name, by_time[t]) for name, t in events.items())
    results = [(name, nonlinearity(prepared, history, t)) for name, t in events.items()]
    for gap in gaps(history):
        results.append((gap.name, nonlinearity(prepared, history, gap.begin, end=gap.end)))
    return tuple(results)


def flown_events(prepared: Prepared) -> dict[str, float]:
    """Return the events within the flight, s since lift-off by name."""
    first, last = prepared.t_hist[0], prepared.t_hist[-1]
    return {name: t for name, t in prepared.trajectory.events.items() if first <= t <= last}


def _choose_event(events: dict[str, float], requested: str) -> str:
    """Return the requested event if the flight has it, else the injection, else the last event."""
    if requested in events:
        return requested
    if "injection" in events:
        return "injection"
    return max(events, key=lambda name: events[name], default="")


def _source_covariances(
    prepared: Prepared, events: dict[str, float], requested: tuple[str, ...], tape: UpdateTape | None
) -> tuple[SourceCovariance, ...]:
    sources = source_labels(prepared)
    results = []
    for name in dict.fromkeys(requested):
        if name in events:
            time = events[name]
            covariance_by_source = source_covariances(prepared, time, tape)
            results.append(SourceCovariance(name, time, sources, covariance_by_source))
    return tuple(results)


def _sensitivities(
    scenario: Scenario, prepared: Prepared, history: CovHistory, time: float
) -> tuple[SigmaSensitivity, ...]:
    cache: dict[tuple[str, float], CovHistory] = {}
    quantities = np.array([output.quantity for output in prepared.outputs])
    results = []
    for quantity in QUANTITIES:
        columns = np.flatnonzero(quantities == quantity).tolist()
        results.append(sensitivity(scenario, history, time, quantity, columns, known=cache))
    return tuple(results)


def _phases(
    prepared: Prepared, events: dict[str, float], tape: UpdateTape | None, window: float
) -> tuple[PhaseView, ...]:
    """Return the observability of the phases between events, or of windows of that many seconds (0: by events)."""
    marks = _windows(prepared, window) if window > 0.0 else _marks(prepared, events)
    names = [name for name, _ in marks]
    edges = np.array([t for _, t in marks])
    phases = []
    for (first, second), interval in zip(pairwise(names), observability(prepared, edges, tape), strict=True):
        weakest = "every direction"
        directions: tuple[str, ...] = ()
        if interval.rows:
            weakest = _in_words(prepared, interval.start, interval.weakest)
            directions = tuple(_in_words(prepared, interval.start, direction) for direction in interval.directions)
        phase = PhaseView(
            name=f"{first} to {second}",
            start=interval.start,
            end=interval.end,
            rank=interval.rank,
            tolerance=TOLERANCE,
            singular=interval.singular,
            rows=interval.rows,
            weakest=weakest,
            directions=directions,
        )
        phases.append(phase)
    return tuple(phases)


def _in_words(prepared: Prepared, start: float, direction: Floats) -> str:
    """Return a direction of the state space in words, in reporting axes.

    direction : (n,) in units of the initial sigmas of the states; a state without initial sigma in its own unit. The
    words are in units of the initial sigmas in reporting axes.
    """
    turn = turns(prepared)[int(np.argmin(np.abs(prepared.t_hist - start)))]
    states = np.array(prepared.layout.reported)
    P = prepared.start.P[np.ix_(states, states)]
    sigma = np.sqrt(np.diag(P))
    turned_sigma = np.sqrt(np.diag(turn @ P @ turn.T))
    error = np.where(sigma > 0.0, sigma, 1.0) * direction
    turned = turn @ error / np.where(turned_sigma > 0.0, turned_sigma, 1.0)
    names = tuple(f"{output.quantity.replace('_', ' ')} {output.axis}" for output in prepared.outputs)
    return in_words(turned / turned[np.argmax(np.abs(turned))], names)


def _windows(prepared: Prepared, window: float) -> list[tuple[str, float]]:
    """Return names and times of the edges of windows from the start on; the last window includes the remainder."""
    t = prepared.reference.t
    n_window = int((t[-1] - t[0]) / window + 1e-9)
    edges = t[0] + window * np.arange(n_window)
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


def _multiply(model: Any, path: tuple[str, ...], factor: float) -> Any:
    """Return a card (or a mapping or tuple of cards) with the number at a path multiplied; in every part if several."""
    if not path:
        return tuple(factor * value for value in model) if isinstance(model, tuple) else model * factor
    step, below = path[0], path[1:]
    if isinstance(model, dict):
        return model | {step: _multiply(model[step], below, factor)}
    if isinstance(model, tuple):
        items = list(model)
        index = int(step)
        if index < len(items):
            items[index] = _multiply(items[index], below, factor)
        return tuple(items)
    fields = type(model).model_fields
    if step not in fields and "parts" in fields:
        return model.model_copy(update={"parts": tuple(_multiply(item, path, factor) for item in model.parts)})
    value = getattr(model, step, None)
    if value is None:
        return model
    return model.model_copy(update={step: _multiply(value, below, factor)})


def _fields(scenario: Scenario, source: str) -> tuple[Field, ...]:
    """Return the fields of the scenario with the sigma of an error source."""
    sensors = sensors_used(scenario)
    measurements = [card.measurement for card in sensors.values()]
    for name, card in sensors.items():
        # sources of several sensors of one measurement have the name of their sensor
        suffix = "" if measurements.count(card.measurement) == 1 else f" {name}"
        fields = [error.field for error in card.lasting() if source == error.source + suffix]
        if source == card.noise + suffix:
            fields = list(card.noise_fields)
        elif not fields:
            continue
        return tuple((("sensors", name, field), 1) for field in fields)
    return fields_of(source)


def scaled(scenario: Scenario, source: str, factor: float) -> Scenario:
    """Return the scenario with the sigma of an error source multiplied; a `matched` filter model follows.

    Parameters
    ----------
    scenario
        Validated model of the case.
    source
        Name of the error source.
    factor
        Factor on its sigma.
    """
    for path, power in _fields(scenario, source):
        scenario = _multiply(scenario, path, factor**power)
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
    cache = {} if known is None else known
    hist = int(np.argmin(np.abs(history.t - time)))
    by_source = history.budget[hist][:, columns].sum(axis=1)
    total = by_source.sum() + np.sum(history.mean[hist, columns] ** 2)
    main = []
    for k in np.argsort(-by_source):
        if by_source[k] >= share * by_source.sum() and _fields(scenario, history.sources[k]):
            main.append(k)
    sources = tuple(history.sources[k] for k in main)
    factors = np.array(FACTORS)
    frozen = np.sqrt(total + (factors**2 - 1.0) * by_source[main][:, None])
    retuned = np.empty_like(frozen)
    for row, source in enumerate(sources):
        for column, factor in enumerate(FACTORS):
            if factor != 1.0 and (source, factor) not in cache:
                cache[source, factor] = covariance(prepare(scaled(scenario, source, factor)))
            tuned = history if factor == 1.0 else cache[source, factor]
            retuned[row, column] = _rms_norm(tuned, time, columns)
    return SigmaSensitivity(
        time=float(history.t[hist]),
        quantity=quantity,
        sources=sources,
        factors=FACTORS,
        frozen=frozen,
        retuned=retuned,
    )


def _rms_norm(history: CovHistory, time: float, columns: list[int]) -> float:
    """Return the true root-mean-square of the norm of an error at the history time closest to a time (s)."""
    hist = int(np.argmin(np.abs(history.t - time)))
    squares = history.true_sigma[hist, columns] ** 2 + history.mean[hist, columns] ** 2
    return float(np.sqrt(np.sum(squares)))
