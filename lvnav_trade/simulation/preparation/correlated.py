"""Correlated measurement errors of a case: causes by the cards of the truth, and the measurements they enter."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.constellation import LETTERS, Part, PreciseConstellation, RinexConstellation, constellation_parts
from lvnav_trade.gnss.faults import FaultEffects
from lvnav_trade.gnss.receiver_cards import DirectSolution, ReceiverCard
from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout, states_modelling
from lvnav_trade.scenario.filter_models import has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import LEVER_AXES, PHASES, Channels, MeasurementGeometry, members, partial
from lvnav_trade.sensors.sensor import CorrelatedError
from lvnav_trade.simulation.preparation.inputs import CorrelatedErrors
from lvnav_trade.simulation.preparation.options import direct_solution
from lvnav_trade.simulation.preparation.sensors import Sensor

RECORDED = "recorded"  # type of an error that is not drawn but read, from a start in a recording
MULTIPATH = "multipath"  # source that enters the code and not the carrier


class EnteringError(NamedTuple):
    """Correlated error, and the measurements of a case that it enters.

    error : The error, with one component per label.
    member : (n_channel,). Component that enters the channel, -1 none.
    partial : (n_epoch, n_channel). Derivative of the measurement with respect to that component.
    """

    error: CorrelatedError
    member: Ints
    partial: Floats


def entering_errors(
    scenario: Scenario,
    geometry: MeasurementGeometry,
    channels: Channels,
    failures: FaultEffects,
    devices: tuple[Sensor, ...] = (),
) -> tuple[EnteringError, ...]:
    """Return the correlated measurement errors of a case: receiver and satellites, sensors, wild samples.

    Errors that are zero or enter no measurement are omitted.

    Parameters
    ----------
    scenario
        Validated model of the case.
    geometry
        Inputs of the partial derivatives.
    channels
        Measurement channels.
    failures
        Effects of faults on the receiver.
    devices
        Sensors other than the receiver.
    """
    n_epoch = len(failures.jump)
    errors = []
    for error in receiver_errors(scenario, channels):
        if error.sigma > 0.0 and error.labels:
            errors.append(_entering_error(error, geometry, channels))
    errors += _sensor_errors(devices, channels, n_epoch)
    errors += _wild_samples(failures, channels)
    return tuple(errors)


def receiver_errors(scenario: Scenario, channels: Channels) -> list[CorrelatedError]:
    """Return the correlated errors of receiver, atmosphere and satellites by the cards of the truth.

    Settings of errors that enter no channel are not read.
    """
    receiver = scenario.receiver
    errors = list[CorrelatedError]()
    solution = None if has_receiver_solution(scenario) else direct_solution(scenario)
    if _labels("range_bias", channels):
        multipath_sigma = receiver.amplification * receiver.multipath
        errors.append(_error(MULTIPATH, "range_bias", multipath_sigma, channels, receiver.multipath_time))
    if _labels("ambiguity", channels):
        errors.append(_error("carrier ambiguity", "ambiguity", receiver.carrier_ambiguity, channels))
    if _labels("range_rate_offset", channels):
        errors += _rate_errors(receiver, channels)
    if _labels("timing", channels):
        errors.append(_error("latency error", "timing", receiver.latency_error, channels))
        errors.append(_error("latency jitter", "timing", receiver.latency_sigma, channels, 0.0, state=""))
    for axis in LEVER_AXES:
        if _labels(axis, channels):
            errors.append(_error("lever arm", axis, receiver.lever_error, channels, state=""))
    if solution is not None and _labels("position_bias", channels):
        errors.append(_solution_bias("position", solution, channels))
    errors += _atmosphere_errors(scenario, channels)
    for constellation in constellation_parts(scenario.constellation):
        errors += _satellite_errors(constellation, channels)
    if solution is not None and _labels("velocity_bias", channels):
        errors.append(_solution_bias("velocity", solution, channels))
    return errors


def _labels(error_type: str, channels: Channels) -> tuple[str, ...]:
    """Return the components of a type of error; empty if it enters no measurement."""
    return members(error_type, channels)[0]


def _error(
    source: str,
    error_type: str,
    sigma: float,
    channels: Channels,
    time_constant: float = math.inf,
    state: str | None = None,
) -> CorrelatedError:
    """Return an error with all components of its type.

    Parameters
    ----------
    source, error_type
        Name of the error source, type of the error.
    sigma
        Standard deviation, SI.
    channels
        Measurement channels.
    time_constant
        s. Infinite: constant during a run; zero: independent from epoch to epoch.
    state
        Filter state that models the error; None: that with the name of the type; empty: none.
    """
    state = error_type if state is None else state
    return CorrelatedError(source, error_type, sigma, "", time_constant, _labels(error_type, channels), state=state)


def _rate_errors(receiver: ReceiverCard, channels: Channels) -> list[CorrelatedError]:
    """Return the errors that all range rates have in common, in addition to the clock drift."""
    name = "range_rate_offset"
    time = receiver.range_rate_instability_time
    return [
        _error("range-rate offset", name, receiver.range_rate_offset, channels),
        _error("range-rate instability", name, receiver.range_rate_instability, channels, time),
    ]


def _solution_bias(quantity: str, solution: DirectSolution, channels: Channels) -> CorrelatedError:
    name = f"{quantity}_bias"
    sigma = getattr(solution, name)
    return _error(f"solution {quantity} bias", name, sigma, channels, solution.bias_time)


def _atmosphere_errors(scenario: Scenario, channels: Channels) -> list[CorrelatedError]:
    """Return the scale-factor errors of the atmospheric delays; with two frequencies none of the ionosphere."""
    errors = []
    atmosphere = scenario.atmosphere
    layers = ["troposphere_scale"]
    if not scenario.receiver.is_dual:
        layers.append("ionosphere_scale")
    for layer in layers:
        if _labels(layer, channels):
            sigma = getattr(atmosphere, layer)
            time_constant = getattr(atmosphere, f"{layer}_time") or math.inf
            errors.append(_error(layer.replace("_", " "), layer, sigma, channels, time_constant))
    return errors


def letters(constellation: Part) -> tuple[str, ...]:
    """Return the letters of the satellite systems in a part of a constellation."""
    if isinstance(constellation, RinexConstellation | PreciseConstellation):
        return tuple(LETTERS[system] for system in constellation.systems or LETTERS)
    return (LETTERS[constellation.system],)


def _satellite_errors(constellation: Part, channels: Channels) -> list[CorrelatedError]:
    """Return the residual error of each satellite and the time offset of each system of a part of a constellation."""
    part_systems = letters(constellation)
    system_of = dict(zip(channels.satellites, channels.systems, strict=True))
    errors = []
    range_labels = _labels("range_bias", channels)
    if range_labels:
        error = CorrelatedError(
            "satellite clock and ephemeris",
            "range_bias",
            constellation.range_error,
            "",
            constellation.range_error_time or math.inf,
            labels=tuple(satellite for satellite in range_labels if system_of[satellite] in part_systems),
            state="range_bias",
        )
        errors.append(error)
    offset_labels = _labels("time_offset", channels)
    if offset_labels:
        error = CorrelatedError(
            "system time offset",
            "time_offset",
            constellation.time_offset,
            "",
            constellation.time_offset_time or math.inf,
            labels=tuple(system for system in offset_labels if system in part_systems),
            state="time_offset",
        )
        errors.append(error)
    return errors


def _entering_error(error: CorrelatedError, geometry: MeasurementGeometry, channels: Channels) -> EnteringError:
    """Return an error of the receiver's measurements with the channels that its components enter, by its type."""
    labels, label_number = members(error.error_type, channels)
    # the error may have components for some of the labels of its type only
    component = [error.labels.index(label) if label in error.labels else -1 for label in labels]
    member = [component[number] if number >= 0 else -1 for number in label_number.tolist()]
    partials = partial(error.error_type, geometry, channels)
    if error.source == MULTIPATH:
        for phase in PHASES:
            if phase in channels.further:
                partials[:, channels.observable_slice(phase)] = 0.0
    return EnteringError(error, np.array(member, dtype=np.int64), partials)


def _sensor_errors(devices: tuple[Sensor, ...], channels: Channels, n_epoch: int) -> list[EnteringError]:
    """Return the correlated errors of the sensors other than the receiver, one error per label."""
    errors = []
    for first, device in zip(channels.first_channels, devices, strict=True):
        scalars = slice(first, first + len(device.channels.labels))
        states = device.card.model.states
        for error, by_label in device.lasting_errors:
            if error.sigma <= 0.0:
                continue
            state = states[error.field].name if error.field in states else ""
            for k, label in enumerate(error.labels):
                sensor_partials = by_label[:, :, k]
                partials = np.zeros((n_epoch, channels.n_channel))
                partials[:, scalars] = sensor_partials
                is_entered = np.any(sensor_partials != 0.0, axis=0)
                member = np.full(channels.n_channel, -1, dtype=np.int64)
                member[scalars] = np.where(is_entered, 0, -1)
                label_error = error._replace(labels=(label,), state=state)
                errors.append(EnteringError(label_error, member, partials))
    return errors


def _wild_samples(failures: FaultEffects, channels: Channels) -> list[EnteringError]:
    """Return the wild samples of a fault: an error of each range or axis that is independent from epoch to epoch."""
    partials = np.zeros((len(failures.jump), channels.n_channel))
    if channels.tight:
        partials[:, channels.observable_slice("pseudorange")] = failures.wild_sigma
    else:
        partials[:, :3] = failures.solution_wild_sigma[:, None]
    is_hit = np.any(partials > 0.0, axis=0)
    hit = np.flatnonzero(is_hit)
    if not hit.size:
        return []
    member = np.full(channels.n_channel, -1, dtype=np.int64)
    member[hit] = range(hit.size)
    if channels.tight:
        n_observable = len(channels.observables)
        labels = tuple(channels.satellites[channel // n_observable] for channel in hit.tolist())
    else:
        labels = tuple("xyz"[channel] for channel in hit.tolist())
    error = CorrelatedError("wild samples", "wild", 1.0, "", time_constant=0.0, labels=labels)
    return [EnteringError(error, member, partials)]


def correlated_errors_of(
    error_entries: Sequence[EnteringError], layout: StateLayout, interval: float, shape: tuple[int, int]
) -> CorrelatedErrors:
    """Return the correlated measurement errors as arrays for the kernels, one family per error.

    Parameters
    ----------
    error_entries
        Errors, and the measurements that they enter.
    layout
        States of the filter; a block of extra states models every error that names it.
    interval
        s. Time between epochs.
    shape
        (n_epoch, n_channel).
    """
    errors = [item.error for item in error_entries]
    counts = np.array([len(error.labels) for error in errors], dtype=np.int64)
    # components by family: the first component of family k has the index first[k]
    first = np.cumsum(counts) - counts
    n_family = len(errors)
    n_channel = shape[1]
    member = np.empty((n_family, n_channel), dtype=np.int64)
    partials = np.empty((n_family, *shape))
    sigma = np.empty(n_family)
    decay = np.zeros(n_family)
    for family, item in enumerate(error_entries):
        error = item.error
        component = first[family] + item.member
        member[family] = np.where(item.member >= 0, component, -1)
        partials[family] = item.partial
        sigma[family] = error.sigma
        if error.time_constant > 0.0:
            decay[family] = math.exp(-interval / error.time_constant)
    source_keys: list[np.uint64] = []
    satellite_keys: list[int | np.uint64] = []
    extra: list[int] = []
    pairs: list[tuple[int, int]] = []  # component, extra state that models it
    for error in errors:
        for label in error.labels:
            component = len(source_keys)
            states = [number for _, number in states_modelling(layout.extras, error.state, label)]
            pairs += [(component, number) for number in states]
            extra.append(states[0] if states else -1)
            source_keys.append(source_word(f"{error.source} {error.error_type}"))
            satellite_keys.append(source_word(label) if label else 0)
    is_recorded = [error.error_type == RECORDED for error in errors]
    walk = sigma * np.sqrt(1.0 - decay * decay)
    return CorrelatedErrors(
        member=member,
        partial=partials,
        initial_sigma=np.repeat(sigma, counts),
        decay=np.repeat(decay, counts),
        walk=np.repeat(walk, counts),
        source_keys=np.array(source_keys, dtype=np.uint64),
        satellite_keys=np.array(satellite_keys, dtype=np.uint64),
        extra=np.array(extra, dtype=np.int64),
        error_of=np.array([component for component, _ in pairs], dtype=np.int64),
        state_of=np.array([number for _, number in pairs], dtype=np.int64),
        is_recorded=np.repeat(np.array(is_recorded, dtype=np.bool_), counts),
    )
