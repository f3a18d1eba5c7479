"""Receiver measurements on the true flight, the same in all runs: true side, filter side, arrays for the kernels."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.clock import clock_step
from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.error_sources import CLOCK_START, CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE
from lvnav_trade.quantities.line_of_sight import lever_partials, ranging_rows
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import RELATIVE, ExtraBlock
from lvnav_trade.scenario.filter_models import epoch_interval, filter_models, solves
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels, MeasurementGeometry, partial, sensor_states
from lvnav_trade.simulation.preparation.filtering import CaseFilter
from lvnav_trade.simulation.preparation.inputs import CorrelatedErrors, Signals
from lvnav_trade.simulation.preparation.sensors import Sensor
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.simulation.preparation.signals.noise import assumed_variance, by_channel, grown_sigma, true_sigma
from lvnav_trade.simulation.preparation.true_flight import TrueFlight
from lvnav_trade.simulation.preparation.tuning import weights

_DRAWS = (CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE, CLOCK_START)


class UsedSatellites(NamedTuple):
    """Satellites in use at the epochs.

    used : (n_epoch, n_slot). Satellite of each slot, -1 none.
    n_used : (n_epoch,). Number of satellites in use.
    frozen : (n_epoch,). Whether the receiver repeats the output of the epoch before.
    """

    used: Ints
    n_used: Ints
    frozen: Bools


class TrueSignals(NamedTuple):
    """True side of `Signals`: measurements of the receiver, independent of the filter; fields as there.

    used : (n_epoch, n_slot). Satellite of each slot, -1 none.
    n_used : (n_epoch,). Number of satellites in use, before the filter checks them.
    words : (n_sat,). Keys of the satellites for random draws.
    range : (n_epoch, n_sat) m. Pseudorange without clock and random errors.
    rate : (n_epoch, n_sat) m/s. Range rate, likewise.
    position : (n_epoch, 3) m. Receiver's solution without random errors, frame i.
    velocity : (n_epoch, 3) m/s. Receiver's solution without random errors, frame i.
    satellite : (n_epoch, n_sat, 3) m. Satellite position that the filter uses, frame i.
    satellite_velocity : (n_epoch, n_sat, 3) m/s. Satellite velocity that the filter uses, frame i.
    sigma : (n_epoch, n_measured) SI. True sigma of white noise.
    clock_step : (3,). Cholesky factor of the receiver clock's noise over an epoch.
    clock_start : (2,) m, m/s. Initial sigma of clock bias and drift.
    clock_jump : (n_epoch, 2) m, m/s. Jump of clock bias and drift at the epoch.
    frozen : (n_epoch,). Whether the receiver repeats the output of the epoch before.
    interval : s. Time between epochs.
    sources : (4,). Keys of random draws.
    shared : Correlated measurement errors.
    """

    used: Ints
    n_used: Ints
    words: NDArray[np.uint64]
    range: Floats
    rate: Floats
    position: Floats
    velocity: Floats
    satellite: Floats
    satellite_velocity: Floats
    sigma: Floats
    clock_step: Floats
    clock_start: Floats
    clock_jump: Floats
    frozen: Bools
    interval: float
    sources: NDArray[np.uint64]
    shared: CorrelatedErrors


class AssumedNoise(NamedTuple):
    """Filter side of `Signals`: noise model of the measurements, (n_epoch, n_channel) unless given.

    variance : SI squared. Noise variance, with the factor of its tuning.
    scale : Square root of that factor.
    beta : Underweighting: share of H P H' added to the innovation variance.
    partial : (n_extra_family, n_epoch, n_channel). Derivative of the measurement by the filter's extra states.
    """

    variance: Floats
    scale: Floats
    beta: Floats
    partial: Floats


def _in_solution(line: Lines, tracked: Bools, errors: Floats) -> Floats:
    """Return the errors (n_epoch, 6) of a least-squares solution by errors of ranges and rates (n_epoch, n_sat, 2)."""
    position_error = _shifts(line, tracked, errors[:, :, 0])
    velocity_error = _shifts(line, tracked, errors[:, :, 1])
    return np.hstack([position_error, velocity_error])


def geometry_of(line: Lines, tracked: Bools, troposphere: Floats, ionosphere: Floats) -> MeasurementGeometry:
    """Return the inputs of partial derivatives of measurements.

    Parameters
    ----------
    line
        Lines of sight.
    tracked
        (n_epoch, n_sat). Whether the satellite is tracked.
    troposphere, ionosphere
        (n_epoch, n_sat, 2) m, m/s. Delays and their rates.
    """
    return MeasurementGeometry(
        rate=line.sight.rate,
        acceleration=line.acceleration,
        velocity=line.velocity,
        push=line.push,
        troposphere=troposphere,
        ionosphere=ionosphere,
        solution_troposphere=_in_solution(line, tracked, troposphere),
        solution_ionosphere=_in_solution(line, tracked, ionosphere),
        lever=lever_partials(line.sight, line.C_b_i, line.at.w_ib_b),
    )


def slots(tracked: Bools) -> tuple[np.ndarray, np.ndarray]:
    """Return the satellite in each slot, (n_epoch, n_slot), -1 none, and the number of satellites, (n_epoch,).

    tracked : (n_epoch, n_sat). Whether the satellite is tracked.
    """
    n_used = tracked.sum(axis=1).astype(np.int64)
    n_epoch = len(tracked)
    n_slot = max(1, int(n_used.max(initial=0)))
    satellite_by_slot = np.full((n_epoch, n_slot), -1, dtype=np.int64)
    for epoch in range(n_epoch):
        satellites = np.flatnonzero(tracked[epoch])
        satellite_by_slot[epoch, : satellites.size] = satellites
    return satellite_by_slot, n_used


def _shifts(line: Lines, tracked: Bools, errors: Floats) -> Floats:
    """Return the errors (n_epoch, 3) of a least-squares solution by errors of ranges or of rates (n_epoch, n_sat)."""
    shift = np.zeros((len(errors), 3))
    tracked_errors = np.where(tracked, errors, 0.0)
    erroneous = np.any(tracked_errors != 0.0, axis=1)
    for epoch in np.flatnonzero(erroneous):
        is_tracked = tracked[epoch]
        if np.count_nonzero(is_tracked) >= 4:
            directions = line.sight.direction[epoch, is_tracked]
            rows = ranging_rows(directions)
            solution, *_ = np.linalg.lstsq(rows, errors[epoch, is_tracked])
            shift[epoch] = solution[:3]
    return shift


def freeze_output(frozen: Bools, *tables: NDArray[Any]) -> None:
    """Copy the previous epoch to every frozen epoch; tables (n_epoch, ...) are updated in place."""
    for epoch in np.flatnonzero(frozen):
        for table in tables:
            table[epoch] = table[epoch - 1]


def _extra_partial(
    block: ExtraBlock, geometry: MeasurementGeometry, channels: Channels, devices: tuple[Sensor, ...]
) -> Floats:
    """Return the derivatives (n_epoch, n_channel) of the measurements with respect to a block of extra states."""
    partials = partial(block.name, geometry, channels)
    for state, _, sensor_partials in sensor_states(block.name, channels):
        if state.label in block.labels:
            partials = sensor_partials
            break
    for first, device in zip(channels.first, devices, strict=True):
        if RELATIVE.get(device.channels.measures) == block.name:
            partials[:, first : first + 3] = device.since[:, None]
    return partials


def received_of(
    scenario: Scenario,
    flight: TrueFlight,
    shared: CorrelatedErrors,
    residual: Floats,
    tabled: Floats,
) -> TrueSignals:
    """Return the true side of satellites and receiver at the epochs.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    shared
        Correlated measurement errors.
    residual
        (n_epoch, n_sat, 2) m, m/s. Residual errors of ranges and rates after corrections: delays, clocks, smoothing.
    tabled
        (n_epoch, 6) m, m/s. Deterministic errors of the solution, frame i.
    """
    clock = scenario.receiver.clock
    sky = flight.sky
    line = flight.lines
    failed = flight.failed
    satellite_by_slot, n_used = slots(sky.tracked)
    noise = true_sigma(scenario, sky, line, flight.ranging)
    sigma = by_channel(flight.ranging, sky.t.size, noise, flight.devices, "sigma")
    interval = epoch_interval(scenario)
    range_error, rate_error = np.moveaxis(flight.biased + residual, 2, 0)
    ranges = np.asarray(line.sight.distance + range_error)
    rates = np.asarray(line.sight.rate + rate_error)
    position_error = _shifts(line, sky.tracked, range_error)
    velocity_error = _shifts(line, sky.tracked, rate_error)
    position = line.position + position_error + tabled[:, :3]
    velocity = line.velocity + velocity_error + tabled[:, 3:]
    if not solves(scenario):  # otherwise the receiver continues internally while its output is frozen
        freeze_output(failed.frozen, satellite_by_slot, n_used, ranges, rates, position, velocity)
    return TrueSignals(
        used=satellite_by_slot,
        n_used=n_used,
        words=np.array([source_word(name) for name in sky.names], dtype=np.uint64),
        range=ranges,
        rate=rates,
        position=position,
        velocity=velocity,
        satellite=np.ascontiguousarray(sky.r_i),
        satellite_velocity=np.ascontiguousarray(sky.v_i),
        sigma=grown_sigma(sigma, flight.ranging, failed),
        clock_step=np.array(clock_step(interval, clock.h0, clock.h_minus2)),
        clock_start=np.array([clock.initial_bias, clock.initial_drift]),
        clock_jump=failed.jump,
        frozen=failed.frozen,
        interval=interval,
        sources=np.array([source_word(name) for name in _DRAWS], dtype=np.uint64),
        shared=shared,
    )


def assumed_of(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter) -> AssumedNoise:
    """Return the noise model of the measurements in the filter."""
    sky = flight.sky
    line = flight.lines
    delays = flight.delays
    channels = flight.channels
    devices = flight.devices
    modelled = geometry_of(line, sky.tracked, delays.modelled_troposphere, delays.modelled_ionosphere)
    extra = [_extra_partial(block, modelled, channels, devices) for block in filtering.layout.extras]
    _, model, _ = filter_models(scenario)
    variance = assumed_variance(scenario, model, channels, sky, line, devices)
    cards = scenario.filter.underweighting
    course = flight.trajectory.course
    beta, factor = weights(cards, course, filtering.model.row_type, flight.epochs.t)
    weighted_variance = variance * factor
    shape = (len(extra), sky.t.size, channels.n_channel)
    partials = np.array(extra).reshape(shape)
    return AssumedNoise(weighted_variance, np.sqrt(factor), beta, partials)


def signals_of(
    flight: TrueFlight,
    received: TrueSignals,
    assumed: AssumedNoise,
    in_use: UsedSatellites,
    reference: Ints,
) -> Signals:
    """Return satellites and receiver as arrays for the kernels: true side and filter side.

    Parameters
    ----------
    flight
        True flight.
    received, assumed
        True side, filter side.
    in_use
        Satellites that the filter uses.
    reference
        (n_epoch, n_kind). Slot of the reference satellite, -1 none.
    """
    channels = flight.channels
    antenna = flight.sky.antenna
    common = {
        "n_used": in_use.n_used,
        "antenna": antenna if channels.tight else np.zeros_like(antenna),
        "n_receiver": channels.n_receiver,
        "reference": reference,
        "shift": flight.ranging.n_receiver - channels.n_receiver,
    }
    return Signals(**(received._asdict() | assumed._asdict() | common))
