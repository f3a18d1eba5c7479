"""Diagnostics of a covariance analysis: error budget, adjoint sensitivity, requirement margins, observability."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.confirming_runs import gaps, spot_check
from lvnav_trade.covariance.diagnostics.error_bound import ErrorBound, error_bound
from lvnav_trade.covariance.diagnostics.imu_stream import Curve, allan_curves
from lvnav_trade.covariance.diagnostics.nonlinearity import Nonlinearity, nonlinearity, open_loop_nonlinearities
from lvnav_trade.covariance.diagnostics.observability import TOLERANCE, direction_text, observability
from lvnav_trade.covariance.diagnostics.protection import Protection, protection
from lvnav_trade.covariance.history import adjoint, covariance, forward_tape, reporting_rotations, source_covariances
from lvnav_trade.covariance.sources import source_labels
from lvnav_trade.covariance.workspace import UpdateTape
from lvnav_trade.quantities.error_sources import Field, fields_of
from lvnav_trade.quantities.records import AdjointBudget, CovarianceRequest, CovHistory, Floats
from lvnav_trade.scenario.filter_models import used_sensors
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
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
    singular_values : (n_singular,). Singular values, descending.
    measurement_count : Number of scalar measurements.
    weakest_direction : Direction of the smallest singular value in words.
    directions : Directions of all singular values in words.
    """

    name: str
    start: float
    end: float
    rank: int
    tolerance: float
    singular_values: Floats
    measurement_count: int
    weakest_direction: str
    directions: tuple[str, ...] = ()


class SigmaSensitivity(NamedTuple):
    """Effect of the sigma of each error source on the true error of a quantity at one time.

    time : s since lift-off.
    quantity : Three-axis quantity, whose norm is assessed.
    sources : (n_source,). Names of the sources.
    factors : (n_factor,). Factors on the sigma.
    frozen_rms : (n_source, n_factor) SI. True root-mean-square of the norm with the gains of the campaign's filter.
    retuned_rms : (n_source, n_factor) SI. The same with a filter whose model has the new sigma.
    """

    time: float
    quantity: str
    sources: tuple[str, ...]
    factors: tuple[float, ...]
    frozen_rms: Floats
    retuned_rms: Floats


class CaseDiagnostics(NamedTuple):
    """Diagnostics of a case; a diagnostic that is not requested is empty.

    event : Event of the diagnostics.
    adjoint : Contributions of each source to the errors at the event, by time.
    source_covariances : Covariance by source at the events.
    sensitivity : Effect of each source's sigma on the errors at the event.
    phases : Observability by phase.
    nonlinearities : Nonlinearity at every event and over every gap, with its name.
    bound : Bound on the error by the modelled noise.
    weakest_direction : Weakest direction of this bound in words.
    spot_check : Simulation runs that check linear covariance.
    allan : Allan deviation of the IMUs.
    protection : Protection levels.
    """

    event: str = ""
    adjoint: AdjointBudget | None = None
    source_covariances: tuple[SourceCovariance, ...] = ()
    sensitivity: tuple[SigmaSensitivity, ...] = ()
    phases: tuple[PhaseView, ...] = ()
    nonlinearities: tuple[tuple[str, Nonlinearity], ...] = ()
    bound: ErrorBound | None = None
    weakest_direction: str = ""
    spot_check: BlockSummary | None = None
    allan: tuple[Curve, ...] = ()
    protection: Protection | None = None


def diagnose(
    scenario: Scenario, prepared_case: PreparedCase, history: CovHistory, request: CovarianceRequest
) -> CaseDiagnostics:
    """Return the requested diagnostics of a case; they share one forward pass.

    Parameters
    ----------
    scenario, prepared_case
        Validated model of the case, and the prepared case.
    history
        Linear covariance of the case.
    request
        Requested diagnostics.
    """
    events = flight_events(prepared_case)
    event = _choose_event(events, request.event)
    results: dict[str, Any] = {"event": event}
    tape = None
    if (events and (request.adjoint or request.observability)) or request.error_bound:
        tape = forward_tape(prepared_case)
    if event and request.adjoint:
        results["adjoint"] = adjoint(prepared_case, events[event], tape=tape)
        results["source_covariances"] = _source_covariances(prepared_case, events, (event, *request.events), tape)
    if event and request.sensitivity:
        results["sensitivity"] = _sensitivities(scenario, prepared_case, history, events[event])
    if request.observability:
        results["phases"] = _phases(prepared_case, events, tape, request.window)
    if request.nonlinearity:
        results["nonlinearities"] = _nonlinearities(prepared_case, history, events)
    if request.error_bound and tape is not None:
        bound = error_bound(prepared_case, tape)
        results["bound"] = bound
        results["weakest_direction"] = _direction_text(
            prepared_case, float(prepared_case.reference.t[0]), bound.weakest_direction
        )
    if request.spot_check:
        results["spot_check"] = spot_check(prepared_case, history, events, request.seed, request.spot_check)
    if request.allan:
        results["allan"] = allan_curves(prepared_case, request.allan, request.seed)
    if request.protection:
        results["protection"] = protection(prepared_case, history, request.protection)
    return CaseDiagnostics(**results)


def _nonlinearities(
    prepared_case: PreparedCase, history: CovHistory, events: Mapping[str, float]
) -> tuple[tuple[str, Nonlinearity], ...]:
    """Return the nonlinearity at every event and over every gap by name; of an open loop at the events only."""
    if prepared_case.scenario.filter.feedback == "open" and prepared_case.model.has_epochs:
        times = list(dict.fromkeys(events.values()))
        by_time = dict(zip(times, open_loop_nonlinearities(prepared_case, history, times), strict=True))
        return tuple((name, by_time[t]) for name, t in events.items())
    results = [(name, nonlinearity(prepared_case, history, t)) for name, t in events.items()]
    for gap in gaps(history):
        results.append((gap.name, nonlinearity(prepared_case, history, gap.begin, end=gap.end)))
    return tuple(results)


def flight_events(prepared_case: PreparedCase) -> dict[str, float]:
    """Return the events within the flight, s since lift-off by name."""
    first, last = prepared_case.t_hist[0], prepared_case.t_hist[-1]
    return {name: t for name, t in prepared_case.trajectory.events.items() if first <= t <= last}


def _choose_event(events: dict[str, float], event_name: str) -> str:
    """Return the requested event if the flight has it, else the injection, else the last event."""
    if event_name in events:
        return event_name
    if "injection" in events:
        return "injection"
    return max(events, key=lambda name: events[name], default="")


def _source_covariances(
    prepared_case: PreparedCase, events: dict[str, float], event_names: tuple[str, ...], tape: UpdateTape | None
) -> tuple[SourceCovariance, ...]:
    sources = source_labels(prepared_case)
    results = []
    for name in dict.fromkeys(event_names):
        if name in events:
            time = events[name]
            covariance_by_source = source_covariances(prepared_case, time, tape)
            results.append(SourceCovariance(name, time, sources, covariance_by_source))
    return tuple(results)


def _sensitivities(
    scenario: Scenario, prepared_case: PreparedCase, history: CovHistory, time: float
) -> tuple[SigmaSensitivity, ...]:
    cache: dict[tuple[str, float], CovHistory] = {}
    quantities = np.array([output.quantity for output in prepared_case.outputs])
    results = []
    for quantity in QUANTITIES:
        columns = np.flatnonzero(quantities == quantity).tolist()
        results.append(sensitivity(scenario, history, time, quantity, columns, covariance_cache=cache))
    return tuple(results)


def _phases(
    prepared_case: PreparedCase, events: dict[str, float], tape: UpdateTape | None, window: float
) -> tuple[PhaseView, ...]:
    """Return the observability of the phases between events, or of windows of that many seconds (0: by events)."""
    marks = _windows(prepared_case, window) if window > 0.0 else _marks(prepared_case, events)
    names = [name for name, _ in marks]
    edges = np.array([t for _, t in marks])
    phases = []
    for (first, second), interval in zip(pairwise(names), observability(prepared_case, edges, tape), strict=True):
        weakest_direction = "every direction"
        directions: tuple[str, ...] = ()
        if interval.measurement_count:
            weakest_direction = _direction_text(prepared_case, interval.start, interval.weakest_direction)
            directions = tuple(
                _direction_text(prepared_case, interval.start, direction) for direction in interval.directions
            )
        phase = PhaseView(
            name=f"{first} to {second}",
            start=interval.start,
            end=interval.end,
            rank=interval.rank,
            tolerance=TOLERANCE,
            singular_values=interval.singular_values,
            measurement_count=interval.measurement_count,
            weakest_direction=weakest_direction,
            directions=directions,
        )
        phases.append(phase)
    return tuple(phases)


def _direction_text(prepared_case: PreparedCase, start: float, direction: Floats) -> str:
    """Return a direction of the state space in words, in reporting axes.

    direction : (n,) in units of the initial sigmas of the states; a state without initial sigma in its own unit. The
    words are in units of the initial sigmas in reporting axes.
    """
    turn = reporting_rotations(prepared_case)[int(np.argmin(np.abs(prepared_case.t_hist - start)))]
    states = np.array(prepared_case.layout.reported_states)
    P = prepared_case.initial_state.P[np.ix_(states, states)]
    sigma = np.sqrt(np.diag(P))
    reported_sigma = np.sqrt(np.diag(turn @ P @ turn.T))
    error = np.where(sigma > 0.0, sigma, 1.0) * direction
    reported_direction = turn @ error / np.where(reported_sigma > 0.0, reported_sigma, 1.0)
    names = tuple(f"{output.quantity.replace('_', ' ')} {output.axis}" for output in prepared_case.outputs)
    return direction_text(reported_direction / reported_direction[np.argmax(np.abs(reported_direction))], names)


def _windows(prepared_case: PreparedCase, window: float) -> list[tuple[str, float]]:
    """Return names and times of the edges of windows from the start on; the last window includes the remainder."""
    t = prepared_case.reference.t
    n_window = int((t[-1] - t[0]) / window + 1e-9)
    edges = t[0] + window * np.arange(n_window)
    return [(f"{edge:g} s", float(edge)) for edge in (*edges, t[-1])]


def _marks(prepared_case: PreparedCase, events: dict[str, float]) -> list[tuple[str, float]]:
    """Return names and times of the bounds of the phases."""
    t = prepared_case.reference.t
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
    step, remaining_path = path[0], path[1:]
    if isinstance(model, dict):
        return model | {step: _multiply(model[step], remaining_path, factor)}
    if isinstance(model, tuple):
        items = list(model)
        index = int(step)
        if index < len(items):
            items[index] = _multiply(items[index], remaining_path, factor)
        return tuple(items)
    fields = type(model).model_fields
    if step not in fields and "parts" in fields:
        return model.model_copy(update={"parts": tuple(_multiply(item, path, factor) for item in model.parts)})
    value = getattr(model, step, None)
    if value is None:
        return model
    return model.model_copy(update={step: _multiply(value, remaining_path, factor)})


def _fields(scenario: Scenario, source: str) -> tuple[Field, ...]:
    """Return the fields of the scenario with the sigma of an error source."""
    sensors = used_sensors(scenario)
    measurements = [card.measurement for card in sensors.values()]
    for name, card in sensors.items():
        # sources of several sensors of one measurement have the name of their sensor
        suffix = "" if measurements.count(card.measurement) == 1 else f" {name}"
        fields = [error.field for error in card.correlated_errors() if source == error.source + suffix]
        if source == card.noise + suffix:
            fields = list(card.noise_fields)
        elif not fields:
            continue
        return tuple((("sensors", name, field), 1) for field in fields)
    return fields_of(source)


def scale_source(scenario: Scenario, source: str, factor: float) -> Scenario:
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
    covariance_cache: dict[tuple[str, float], CovHistory] | None = None,
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
    covariance_cache
        Cache of linear covariances by (source, factor), which is extended; all quantities need the same.
    """
    cache = {} if covariance_cache is None else covariance_cache
    hist = int(np.argmin(np.abs(history.t - time)))
    source_variances = history.budget[hist][:, columns].sum(axis=1)
    total = source_variances.sum() + np.sum(history.mean[hist, columns] ** 2)
    main_sources = []
    for k in np.argsort(-source_variances):
        if source_variances[k] >= share * source_variances.sum() and _fields(scenario, history.sources[k]):
            main_sources.append(k)
    sources = tuple(history.sources[k] for k in main_sources)
    factors = np.array(FACTORS)
    frozen_rms = np.sqrt(total + (factors**2 - 1.0) * source_variances[main_sources][:, None])
    retuned_rms = np.empty_like(frozen_rms)
    for row, source in enumerate(sources):
        for column, factor in enumerate(FACTORS):
            if factor != 1.0 and (source, factor) not in cache:
                cache[source, factor] = covariance(prepare(scale_source(scenario, source, factor)))
            retuned_history = history if factor == 1.0 else cache[source, factor]
            retuned_rms[row, column] = _rms_norm(retuned_history, time, columns)
    return SigmaSensitivity(
        time=float(history.t[hist]),
        quantity=quantity,
        sources=sources,
        factors=FACTORS,
        frozen_rms=frozen_rms,
        retuned_rms=retuned_rms,
    )


def _rms_norm(history: CovHistory, time: float, columns: list[int]) -> float:
    """Return the true root-mean-square of the norm of an error at the history time closest to a time (s)."""
    hist = int(np.argmin(np.abs(history.t - time)))
    squares = history.true_sigma[hist, columns] ** 2 + history.mean[hist, columns] ** 2
    return float(np.sqrt(np.sum(squares)))
