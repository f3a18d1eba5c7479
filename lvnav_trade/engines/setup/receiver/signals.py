"""What a receiver measures on the nominal flight, and what is common to all runs of it: Signals for the kernels."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.setup.families import Cause, ErrorFamily, families_of
from lvnav_trade.engines.setup.inputs import Shared, Signals
from lvnav_trade.engines.setup.options import direct
from lvnav_trade.engines.setup.receiver.noise import assumed_variance, by_channel, grown_sigma, true_sigma
from lvnav_trade.engines.setup.sensors import Sensor
from lvnav_trade.filters.base import ReceiverModel
from lvnav_trade.frames import matrices
from lvnav_trade.kernels.clock import clock_step
from lvnav_trade.kernels.earth import GM
from lvnav_trade.kernels.random import source_word
from lvnav_trade.layout import RELATIVE, ExtraBlock, StateLayout
from lvnav_trade.noise import NoiseFactor
from lvnav_trade.observables.partials import (
    FURTHER,
    LEVER_AXES,
    Channels,
    Geometry,
    members,
    partial,
    sensor_states,
)
from lvnav_trade.records import Bools, Floats, Sky
from lvnav_trade.scenario import Scenario, epoch_interval, solves
from lvnav_trade.sources import CLOCK_START, CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE
from lvnav_trade.world.faults import Failures
from lvnav_trade.world.flight.trajectory import Trajectory, motion
from lvnav_trade.world.receiver.dynamics import factors
from lvnav_trade.world.receiver.receiver import ReceiverCard
from lvnav_trade.world.receiver.visibility import point_of
from lvnav_trade.world.sky.constellation import LETTERS, Part, PreciseConstellation, RinexConstellation, parts_of

_DRAWS = (CLOCK_STEP, RANGE_NOISE, SOLUTION_NOISE, CLOCK_START)


def channels_of(scenario: Scenario, seen: Sky, devices: tuple[Sensor, ...] = ()) -> Channels:
    """Return the channels of a case."""
    ever = tuple(bool(np.any(seen.tracked[:, s])) for s in range(len(seen.names)))
    sensors = tuple(device.channels for device in devices)
    receiver = scenario.filter.tight or scenario.filter.loose
    further = tuple(name for name in scenario.filter.measurements if name in FURTHER)
    return Channels(scenario.filter.tight, seen.names, seen.systems, ever, receiver, sensors, further)


class Line:
    """The lines of sight at the epochs: antenna and satellites, their distance and its first two derivatives.

    at: Motion of the vehicle; C_b_i (n_epoch, 3, 3); position, velocity, push (n_epoch, 3) of the point that the
    receiver's solution is for, frame i (push without the swing of the lever arm); from the antenna that hears the
    satellite: line (n_epoch, n_sat, 3) m and its derivative, moving; direction (n_epoch, n_sat, 3) and its rate of
    change, drift; distance, rate, acceleration (n_epoch, n_sat).
    """

    def __init__(self, trajectory: Trajectory, lever_b: Floats, seen: Sky) -> None:
        at, self.trajectory, self.t = motion(trajectory, seen.t), trajectory, seen.t
        self.at, self.C_b_i = at, matrices(at.q_b_i)
        self.position, self.velocity = point_of(at, self.C_b_i, lever_b)
        self.push = _pull(at.r_i) + np.einsum("nij,nj->ni", self.C_b_i, at.f_b)
        points = [point_of(at, self.C_b_i, lever) for lever in seen.lever_arms]
        places, speeds = (np.stack(arrays, axis=1) for arrays in zip(*points, strict=True))
        line = seen.r_i - np.take_along_axis(places, seen.antenna[:, :, None], axis=1)
        moving = seen.v_i - np.take_along_axis(speeds, seen.antenna[:, :, None], axis=1)
        self.line, self.moving = line, moving
        self.distance = np.linalg.norm(line, axis=2)
        self.direction = line / self.distance[:, :, None]
        self.rate = np.einsum("esi,esi->es", self.direction, moving)
        across = np.sum(moving**2, axis=2) - self.rate**2
        self.drift = (moving - self.rate[:, :, None] * self.direction) / self.distance[:, :, None]
        pulled = np.einsum("esi,esi->es", self.direction, _pull(seen.r_i) - self.push[:, None, :])
        self.acceleration = across / self.distance + pulled

    def noise_factors(self, tables: Sequence[NoiseFactor], measurements: Sequence[str]) -> list[Floats | float]:
        """Return the factor (n_epoch, 1) on the sigma of each measurement."""
        return factors(tables, measurements, self.trajectory, self.t)

    @property
    def lever(self) -> Floats:
        """Range and range rate with respect to the lever arm in body axes, (n_epoch, n_sat, 2, 3)."""
        towards = np.einsum("esi,eij->esj", self.direction, self.C_b_i)  # u in body axes
        swinging = np.cross(towards, self.at.w_ib_b[:, None, :])  # u . (w x l) = l . (u x w)
        return np.stack([-towards, -swinging - np.einsum("esi,eij->esj", self.drift, self.C_b_i)], axis=2)


def _pull(r_i: Floats) -> Floats:
    """Return point-mass gravity (m/s^2) at positions (..., 3): enough for the curvature of a range."""
    return -GM * r_i / np.linalg.norm(r_i, axis=-1, keepdims=True) ** 3


def _in_solution(line: Line, tracked: Bools, errors: Floats) -> Floats:
    """Return what errors of ranges and rates (n_epoch, n_sat, 2) put into a least-squares solution, (n_epoch, 6)."""
    return np.hstack([_shifts(line, tracked, errors[:, :, 0]), _shifts(line, tracked, errors[:, :, 1])])


def geometry_of(line: Line, tracked: Bools, troposphere: Floats, ionosphere: Floats) -> Geometry:
    """Return what partials of measurements are made of; delays (n_epoch, n_sat, 2) with their rates."""
    return Geometry(
        rate=line.rate,
        acceleration=line.acceleration,
        velocity=line.velocity,
        push=line.push,
        troposphere=troposphere,
        ionosphere=ionosphere,
        solution_troposphere=_in_solution(line, tracked, troposphere),
        solution_ionosphere=_in_solution(line, tracked, ionosphere),
        lever=line.lever,
    )


def letters(part: Part) -> tuple[str, ...]:
    """Return the letters of the systems of a part."""
    if isinstance(part, RinexConstellation | PreciseConstellation):
        return tuple(LETTERS[system] for system in part.systems or LETTERS)
    return (LETTERS[part.system],)


def causes_of(scenario: Scenario, channels: Channels) -> list[Cause]:
    """Return the causes of errors that the measurements of these channels share, as the cards of the truth state them.

    Nothing is read of a card for causes that enter no measurement.
    """
    receiver, air = scenario.receiver, scenario.atmosphere
    found: list[Cause] = []

    def enters(kind: str) -> bool:
        return bool(members(kind, channels)[0])

    if enters("range_bias"):
        reflected = receiver.amplification * receiver.multipath
        found.append(Cause("multipath", "range_bias", "range_bias", reflected, receiver.multipath_time, of_code=True))
    if enters("ambiguity"):
        found.append(Cause("carrier ambiguity", "ambiguity", "ambiguity", receiver.carrier_ambiguity))
    if enters("range_rate_offset"):
        found += _of_rates(receiver)
    if enters("timing"):
        found.append(Cause("latency error", "timing", "timing", receiver.latency_error))
        found.append(Cause("latency jitter", "timing", "", receiver.latency_sigma, 0.0))
    found += [Cause("lever arm", axis, "", receiver.lever_error) for axis in LEVER_AXES if enters(axis)]
    solution = None if solves(scenario) else direct(scenario)
    if solution is not None and enters("position_bias"):
        found.append(_of_solution("position", solution.position_bias, solution.bias_time))
    for layer in ("troposphere_scale",) if receiver.is_dual else ("troposphere_scale", "ionosphere_scale"):
        if enters(layer):
            sigma, time = (getattr(air, name) for name in (layer, f"{layer}_time"))
            found.append(Cause(layer.replace("_", " "), layer, layer, sigma, time or math.inf))
    for part in parts_of(scenario.constellation):
        systems = letters(part)
        if enters("range_bias"):
            residual, time_constant = part.range_error, part.range_error_time or math.inf
            found.append(
                Cause("satellite clock and ephemeris", "range_bias", "range_bias", residual, time_constant, systems)
            )
        if enters("time_offset"):
            offset, time_constant = part.time_offset, part.time_offset_time or math.inf
            found.append(Cause("system time offset", "time_offset", "time_offset", offset, time_constant, systems))
    if solution is not None and enters("velocity_bias"):
        found.append(_of_solution("velocity", solution.velocity_bias, solution.bias_time))
    return found


def _of_rates(receiver: ReceiverCard) -> list[Cause]:
    """Return the errors that range rates have in common beside the drift of the clock of the ranges."""
    kind, time = "range_rate_offset", receiver.range_rate_instability_time
    return [
        Cause("range-rate offset", kind, kind, receiver.range_rate_offset),
        Cause("range-rate instability", kind, kind, receiver.range_rate_instability, time),
    ]


def _of_solution(quantity: str, sigma: float, time_constant: float) -> Cause:
    kind = f"{quantity}_bias"
    return Cause(f"solution {quantity} bias", kind, kind, sigma, time_constant)


def lasting_errors(devices: tuple[Sensor, ...], channels: Channels, n_epoch: int) -> tuple[ErrorFamily, ...]:
    """Return the lasting errors of the sensors beside the receiver."""
    found = []
    for at, device in zip(channels.first, devices, strict=True):
        own, states = slice(at, at + len(device.channels.labels)), device.card.model.states
        for error, by_label in device.lasting:
            state = states[error.field].name if error.field in states else ""
            for k, label in enumerate(error.labels if error.sigma > 0.0 else ()):
                member = np.full(channels.n_channel, -1, dtype=np.int64)
                partials = np.zeros((n_epoch, channels.n_channel))
                partials[:, own] = by_label[:, :, k]
                member[own] = np.where(np.any(partials[:, own] != 0.0, axis=0), 0, -1)
                names = (error.source, error.kind, state, (label,))
                found.append(ErrorFamily(*names, member, partials, error.sigma, error.time_constant))
    return tuple(found)


def families(
    scenario: Scenario, geometry: Geometry, channels: Channels, failed: Failures, devices: tuple[Sensor, ...] = ()
) -> tuple[ErrorFamily, ...]:
    """Return the errors that the measurements of a case share, wild samples of a fault among them."""
    found = families_of(causes_of(scenario, channels), geometry, channels)
    found += lasting_errors(devices, channels, len(failed.jump))
    partial_of_wild = np.zeros((len(failed.jump), channels.n_channel))
    if channels.tight:
        partial_of_wild[:, channels.of("pseudorange")] = failed.wild
    else:
        partial_of_wild[:, :3] = failed.solution_wild[:, None]
    hit = np.flatnonzero(np.any(partial_of_wild > 0.0, axis=0))
    if not hit.size:
        return found
    member = np.full(channels.n_channel, -1, dtype=np.int64)
    member[hit] = range(hit.size)
    n_kind = len(channels.observables)
    labels = tuple(channels.satellites[c // n_kind] if channels.tight else "xyz"[c] for c in hit.tolist())
    return (*found, ErrorFamily("wild samples", "wild", "", labels, member, partial_of_wild, 1.0, 0.0))


def slots(tracked: Bools) -> tuple[np.ndarray, np.ndarray]:
    """Return (n_epoch, n_slot) satellite in each slot, -1 none, and how many there are, (n_epoch,); tracked: (n_epoch,
    n_sat).
    """
    n_used = tracked.sum(axis=1).astype(np.int64)
    used = np.full((len(tracked), max(1, int(n_used.max(initial=0)))), -1, dtype=np.int64)
    for epoch in range(len(tracked)):
        found = np.flatnonzero(tracked[epoch])
        used[epoch, : found.size] = found
    return used, n_used


def _shifts(line: Line, tracked: Bools, errors: Floats) -> Floats:
    """Return what errors of ranges or rates (n_epoch, n_sat) put into a least-squares solution, (n_epoch, 3)."""
    shift = np.zeros((len(errors), 3))
    for epoch in np.flatnonzero(np.any(np.where(tracked, errors, 0.0) != 0.0, axis=1)):
        on = tracked[epoch]
        if np.count_nonzero(on) >= 4:
            design = np.column_stack([-line.direction[epoch, on], np.ones(np.count_nonzero(on))])
            shift[epoch] = np.linalg.lstsq(design, errors[epoch, on])[0][:3]
    return shift


def hold(frozen: Bools, *tables: NDArray[Any]) -> None:
    """Let every frozen epoch repeat the one before, in place: tables (n_epoch, ...) updated."""
    for epoch in np.flatnonzero(frozen):
        for table in tables:
            table[epoch] = table[epoch - 1]


def _extra_partial(block: ExtraBlock, geometry: Geometry, channels: Channels, devices: tuple[Sensor, ...]) -> Floats:
    """Return the partials (n_epoch, n_channel) of the measurements with respect to an extra block's components."""
    of_sensors = (entering for state, _, entering in sensor_states(block.name, channels) if state.label in block.labels)
    found = next(of_sensors, partial(block.name, geometry, channels))
    for at, device in zip(channels.first, devices, strict=True):
        if RELATIVE.get(device.channels.measures) == block.name:
            found[:, at : at + 3] = device.since[:, None]
    return found


def signals(
    scenario: Scenario,
    seen: Sky,
    line: Line,
    model: ReceiverModel,
    layout: StateLayout,
    geometry: Geometry,
    channels: Channels,
    measured: Channels,
    shared: Shared,
    failed: Failures,
    left: Floats,
    tabled: Floats,
    devices: tuple[Sensor, ...] = (),
) -> Signals:
    """Return what is true of satellites and receiver at the epochs, and what the filter knows of it.

    channels are those of the filter's rows, `measured` those of what the receiver measures, which solves perhaps; left
    (n_epoch, n_sat, 2): what corrections leave of delays and of systems' times, in ranges and rates; tabled (n_epoch,
    6): errors of the solution that are the same in every run, frame i; devices: sensors beside the receiver.
    """
    clock = scenario.receiver.clock
    used, n_used = slots(seen.tracked)
    sigma = by_channel(measured, seen.t.size, true_sigma(scenario, seen, line, measured), devices, "sigma")
    extra = [_extra_partial(block, geometry, channels, devices) for block in layout.extras]
    interval = epoch_interval(scenario)
    off, off_rate = failed.bias + left[:, :, 0], failed.drift + left[:, :, 1]
    ranges, rates = np.asarray(line.distance + off), np.asarray(line.rate + off_rate)
    position = line.position + _shifts(line, seen.tracked, off) + tabled[:, :3]
    velocity = line.velocity + _shifts(line, seen.tracked, off_rate) + tabled[:, 3:]
    if not solves(scenario):  # else the receiver goes on behind a frozen output
        hold(failed.frozen, used, n_used, ranges, rates, position, velocity)
    variance = assumed_variance(scenario, model, channels, seen, line, devices)
    return Signals(
        used=used,
        n_used=n_used,
        words=np.array([source_word(name) for name in seen.names], dtype=np.uint64),
        range=ranges,
        rate=rates,
        position=position,
        velocity=velocity,
        satellite=np.ascontiguousarray(seen.r_i),
        satellite_velocity=np.ascontiguousarray(seen.v_i),
        antenna=seen.antenna if channels.tight else np.zeros_like(seen.antenna),
        sigma=grown_sigma(sigma, measured, failed),
        variance=variance,
        scale=np.ones_like(variance),
        beta=np.zeros_like(variance),
        partial=np.array(extra).reshape(len(extra), seen.t.size, channels.n_channel),
        clock_step=np.array(clock_step(interval, clock.h0, clock.h_minus2)),
        clock_start=np.array([clock.initial_bias, clock.initial_drift]),
        clock_jump=failed.jump,
        frozen=failed.frozen,
        interval=interval,
        n_receiver=channels.n_receiver,
        reference=np.full((n_used.size, len(channels.observables)), -1, dtype=np.int64),
        shift=measured.n_receiver - channels.n_receiver,
        sources=np.array([source_word(name) for name in _DRAWS], dtype=np.uint64),
        shared=shared,
    )
