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
from lvnav_trade.scenario.filter_models import epoch_interval, filter_models, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels, MeasurementGeometry, partial, sensor_states
from lvnav_trade.simulation.preparation.filtering import CaseFilter
from lvnav_trade.simulation.preparation.inputs import CorrelatedErrors, Signals
from lvnav_trade.simulation.preparation.sensors import Sensor
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.simulation.preparation.signals.noise import (
    assumed_variance,
    channel_table,
    sigma_with_faults,
    true_sigma,
)
from lvnav_trade.simulation.preparation.true_flight import TrueFlight
from lvnav_trade.simulation.preparation.tuning import weights

_DRAWS = (CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE, CLOCK_START)


class UsedSatellites(NamedTuple):
    """Satellites in use at the epochs.

    satellite_by_slot : (n_epoch, n_slot). Satellite of each slot, -1 none.
    n_used : (n_epoch,). Number of satellites in use.
    is_frozen : (n_epoch,). Whether the receiver repeats the output of the epoch before.
    """

    satellite_by_slot: Ints
    n_used: Ints
    is_frozen: Bools


class TrueSignals(NamedTuple):
    """True side of `Signals`: measurements of the receiver, independent of the filter; fields as there.

    satellite_by_slot : (n_epoch, n_slot). Satellite of each slot, -1 none.
    n_used : (n_epoch,). Number of satellites in use, before the filter checks them.
    satellite_keys : (n_sat,). Keys of the satellites for random draws.
    range : (n_epoch, n_sat) m. Pseudorange without clock and random errors.
    rate : (n_epoch, n_sat) m/s. Range rate, likewise.
    position : (n_epoch, 3) m. Receiver's solution without random errors, frame i.
    velocity : (n_epoch, 3) m/s. Receiver's solution without random errors, frame i.
    satellite_position : (n_epoch, n_sat, 3) m. Satellite position that the filter uses, frame i.
    satellite_velocity : (n_epoch, n_sat, 3) m/s. Satellite velocity that the filter uses, frame i.
    sigma : (n_epoch, n_measured) SI. True sigma of white noise.
    clock_step : (3,). Cholesky factor of the receiver clock's noise over an epoch.
    clock_start : (2,) m, m/s. Initial sigma of clock bias and drift.
    clock_jump : (n_epoch, 2) m, m/s. Jump of clock bias and drift at the epoch.
    is_frozen : (n_epoch,). Whether the receiver repeats the output of the epoch before.
    interval : s. Time between epochs.
    source_keys : (4,). Keys of random draws.
    correlated_errors : Correlated measurement errors.
    """

    satellite_by_slot: Ints
    n_used: Ints
    satellite_keys: NDArray[np.uint64]
    range: Floats
    rate: Floats
    position: Floats
    velocity: Floats
    satellite_position: Floats
    satellite_velocity: Floats
    sigma: Floats
    clock_step: Floats
    clock_start: Floats
    clock_jump: Floats
    is_frozen: Bools
    interval: float
    source_keys: NDArray[np.uint64]
    correlated_errors: CorrelatedErrors


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


def _solution_errors(line: Lines, is_tracked: Bools, errors: Floats) -> Floats:
    """Return the errors (n_epoch, 6) of a least-squares solution by errors of ranges and rates (n_epoch, n_sat, 2)."""
    position_error = _solution_shifts(line, is_tracked, errors[:, :, 0])
    velocity_error = _solution_shifts(line, is_tracked, errors[:, :, 1])
    return np.hstack([position_error, velocity_error])


def geometry_of(line: Lines, is_tracked: Bools, troposphere: Floats, ionosphere: Floats) -> MeasurementGeometry:
    """Return the inputs of partial derivatives of measurements.

    Parameters
    ----------
    line
        Lines of sight.
    is_tracked
        (n_epoch, n_sat). Whether the satellite is tracked.
    troposphere, ionosphere
        (n_epoch, n_sat, 2) m, m/s. Delays and their rates.
    """
    return MeasurementGeometry(
        rate=line.sight.rate,
        acceleration=line.acceleration,
        velocity=line.velocity,
        antenna_acceleration=line.vehicle_acceleration,
        troposphere=troposphere,
        ionosphere=ionosphere,
        solution_troposphere=_solution_errors(line, is_tracked, troposphere),
        solution_ionosphere=_solution_errors(line, is_tracked, ionosphere),
        lever=lever_partials(line.sight, line.C_b_i, line.motion.w_ib_b),
    )


def slots(is_tracked: Bools) -> tuple[np.ndarray, np.ndarray]:
    """Return the satellite in each slot, (n_epoch, n_slot), -1 none, and the number of satellites, (n_epoch,).

    is_tracked : (n_epoch, n_sat). Whether the satellite is tracked.
    """
    n_used = is_tracked.sum(axis=1).astype(np.int64)
    n_epoch = len(is_tracked)
    n_slot = max(1, int(n_used.max(initial=0)))
    satellite_by_slot = np.full((n_epoch, n_slot), -1, dtype=np.int64)
    for epoch in range(n_epoch):
        satellites = np.flatnonzero(is_tracked[epoch])
        satellite_by_slot[epoch, : satellites.size] = satellites
    return satellite_by_slot, n_used


def _solution_shifts(line: Lines, is_tracked: Bools, errors: Floats) -> Floats:
    """Return the errors (n_epoch, 3) of a least-squares solution by errors of ranges or of rates (n_epoch, n_sat)."""
    shift = np.zeros((len(errors), 3))
    tracked_errors = np.where(is_tracked, errors, 0.0)
    erroneous = np.any(tracked_errors != 0.0, axis=1)
    n_tracked = is_tracked.sum(axis=1)
    # epochs with equally many satellites are solved together; the tolerance is that of np.linalg.lstsq
    for n in np.unique(n_tracked[n_tracked >= 4]):
        epochs = np.flatnonzero(erroneous & (n_tracked == n))
        selection = is_tracked[epochs]
        directions = line.sight.direction[epochs][selection].reshape(epochs.size, n, 3)
        pseudoinverse = np.linalg.pinv(ranging_rows(directions), rcond=n * np.finfo(np.float64).eps)
        selected_errors = errors[epochs][selection].reshape(epochs.size, n, 1)
        shift[epochs] = (pseudoinverse[:, :3] @ selected_errors)[:, :, 0]
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
    for first, device in zip(channels.first_channels, devices, strict=True):
        if RELATIVE.get(device.channels.measurement) == block.name:
            partials[:, first : first + 3] = device.time_since_measurement[:, None]
    return partials


def true_signals_of(
    scenario: Scenario,
    flight: TrueFlight,
    correlated_errors: CorrelatedErrors,
    residual: Floats,
    solution_errors: Floats,
) -> TrueSignals:
    """Return the true side of satellites and receiver at the epochs.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    correlated_errors
        Correlated measurement errors.
    residual
        (n_epoch, n_sat, 2) m, m/s. Residual errors of ranges and rates after corrections: delays, clocks, smoothing.
    solution_errors
        (n_epoch, 6) m, m/s. Deterministic errors of the solution, frame i.
    """
    clock = scenario.receiver.clock
    sky = flight.sky
    line = flight.lines
    failures = flight.failures
    satellite_by_slot, n_used = slots(sky.is_tracked)
    noise = true_sigma(scenario, sky, line, flight.ranging)
    sigma = channel_table(flight.ranging, sky.t.size, noise, flight.devices, "sigma")
    interval = epoch_interval(scenario)
    range_error, rate_error = np.moveaxis(flight.fault_errors + residual, 2, 0)
    ranges = np.asarray(line.sight.distance + range_error)
    rates = np.asarray(line.sight.rate + rate_error)
    position_error = _solution_shifts(line, sky.is_tracked, range_error)
    velocity_error = _solution_shifts(line, sky.is_tracked, rate_error)
    position = line.position + position_error + solution_errors[:, :3]
    velocity = line.velocity + velocity_error + solution_errors[:, 3:]
    if not has_receiver_solution(scenario):  # otherwise the receiver continues internally while its output is frozen
        freeze_output(failures.is_frozen, satellite_by_slot, n_used, ranges, rates, position, velocity)
    return TrueSignals(
        satellite_by_slot=satellite_by_slot,
        n_used=n_used,
        satellite_keys=np.array([source_word(name) for name in sky.names], dtype=np.uint64),
        range=ranges,
        rate=rates,
        position=position,
        velocity=velocity,
        satellite_position=np.ascontiguousarray(sky.r_i),
        satellite_velocity=np.ascontiguousarray(sky.v_i),
        sigma=sigma_with_faults(sigma, flight.ranging, failures),
        clock_step=np.array(clock_step(interval, clock.h0, clock.h_minus2)),
        clock_start=np.array([clock.initial_bias, clock.initial_drift]),
        clock_jump=failures.jump,
        is_frozen=failures.is_frozen,
        interval=interval,
        source_keys=np.array([source_word(name) for name in _DRAWS], dtype=np.uint64),
        correlated_errors=correlated_errors,
    )


def assumed_noise_of(scenario: Scenario, flight: TrueFlight, filtering: CaseFilter) -> AssumedNoise:
    """Return the noise model of the measurements in the filter."""
    sky = flight.sky
    line = flight.lines
    delays = flight.atmospheric_delays
    channels = flight.channels
    devices = flight.devices
    modelled_geometry = geometry_of(line, sky.is_tracked, delays.modelled_troposphere, delays.modelled_ionosphere)
    extra = [_extra_partial(block, modelled_geometry, channels, devices) for block in filtering.layout.extras]
    _, model, _ = filter_models(scenario)
    variance = assumed_variance(scenario, model, channels, sky, line, devices)
    cards = scenario.filter.underweighting
    flight_profile = flight.trajectory.flight_profile
    beta, factor = weights(cards, flight_profile, filtering.model.channel_type, flight.epochs.t)
    weighted_variance = variance * factor
    shape = (len(extra), sky.t.size, channels.n_channel)
    partials = np.array(extra).reshape(shape)
    return AssumedNoise(weighted_variance, np.sqrt(factor), beta, partials)


def signals_of(
    flight: TrueFlight,
    true_signals: TrueSignals,
    assumed_noise: AssumedNoise,
    in_use: UsedSatellites,
    reference: Ints,
) -> Signals:
    """Return satellites and receiver as arrays for the kernels: true side and filter side.

    Parameters
    ----------
    flight
        True flight.
    true_signals, assumed_noise
        True side, filter side.
    in_use
        Satellites that the filter uses.
    reference
        (n_epoch, n_observable). Slot of the reference satellite, -1 none.
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
    return Signals(**(true_signals._asdict() | assumed_noise._asdict() | common))
