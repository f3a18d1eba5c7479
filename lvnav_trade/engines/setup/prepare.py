"""A scenario made ready for both engines: everything that is the same for all runs, computed once."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.engines.setup.families import ErrorFamily, shared_of
from lvnav_trade.engines.setup.inputs import Options, Record, Report, Schedule, Sensors, Signals, Start, Unit, Units
from lvnav_trade.engines.setup.options import clone_times, delays_taken, every, gains_of, late_of, passes_of, solver_of
from lvnav_trade.engines.setup.receiver.atmosphere import Delays, delays
from lvnav_trade.engines.setup.receiver.further import delayed_of, further_of, references_of
from lvnav_trade.engines.setup.receiver.recorded import Recorded, recorded
from lvnav_trade.engines.setup.receiver.signals import Line, channels_of, families, geometry_of, signals
from lvnav_trade.engines.setup.receiver.smoothing import smoothing_gains, smoothing_numbers, smoothing_offsets
from lvnav_trade.engines.setup.receiver.solution import Chain, chain_of
from lvnav_trade.engines.setup.redundancy import Profile, redundant_of
from lvnav_trade.engines.setup.sensors import Sensor, for_kernels, sensors_of
from lvnav_trade.engines.setup.shared import built, identity, sampled, seen_in
from lvnav_trade.engines.setup.times import epochs_of, times_of
from lvnav_trade.engines.setup.tuning import underweighted, with_linearisation, with_regions
from lvnav_trade.engines.setup.units import arriving, elements, fused, units_of, white_of
from lvnav_trade.engines.setup.vehicle import samples_of, vehicle_of
from lvnav_trade.engines.setup.watching import failing, integrity_of, left_out, pdop, watched
from lvnav_trade.envelope import EnvelopeCard
from lvnav_trade.filters.model import FilterModel, build_filter_model, initial_covariance
from lvnav_trade.filters.strapdown import strapdown_of
from lvnav_trade.frames import earth_angle, rotation_i_e, rotation_i_n, rotation_i_o
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.strapdown import Strapdown
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OWN_0
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.layout import StateLayout, backup_outputs, outputs, solution_outputs
from lvnav_trade.observables.partials import Channels
from lvnav_trade.per_axis import axes
from lvnav_trade.records import Floats, Ints, Output, Reference, Sky
from lvnav_trade.scenario import Scenario, epoch_interval, filter_models, has_covariance, measured, reported, solves
from lvnav_trade.sources import IMU_NOISE
from lvnav_trade.world.conditions import Course
from lvnav_trade.world.fault_cards import (
    AccelBiasStep,
    AccelScaleFactorStep,
    AnyFault,
    GyroBiasStep,
    GyroScaleFactorStep,
)
from lvnav_trade.world.faults import delay, failures, periods
from lvnav_trade.world.flight.trajectory import Trajectory
from lvnav_trade.world.gravity import disturbance
from lvnav_trade.world.receiver.interference import feigned
from lvnav_trade.world.sensors.imu import ErrorBlock, ImuCard
from lvnav_trade.world.sensors.units import ImuSet, blocks_of, equivalent, triads_of
from lvnav_trade.world.sky.satellites import time_offsets

_STEPS = {
    GyroBiasStep: (GYRO, CONSTANT),
    AccelBiasStep: (ACCEL, CONSTANT),
    GyroScaleFactorStep: (GYRO, OWN_0),
    AccelScaleFactorStep: (ACCEL, OWN_0),
}
# What begins with a step is a profile that grows within this time (s), far less than an IMU tick.
STEP = 1e-6


class Prepared(NamedTuple):
    """A scenario and all that its runs share. sources: true error blocks of the unit; families: errors that
    measurements share; recorded: of a receiver; t_hist, t_epoch: s since lift-off of history and epochs; devices: the
    sensors beside the receiver, sensors the same in numbers; channels: of the filter; channel_names: of all
    innovations; failing (n_epoch,): which check at the input the receiver's sample fails, 0 where none.
    """

    scenario: Scenario
    trajectory: Trajectory
    reference: Reference
    sky: Sky
    outputs: tuple[Output, ...]
    layout: StateLayout
    model: FilterModel
    sources: tuple[ErrorBlock, ...]
    families: tuple[ErrorFamily, ...]
    schedule: Schedule
    unit: Unit
    signals: Signals
    start: Start
    record: Record
    t_hist: Floats
    t_epoch: Floats
    lengths: Floats
    delays: Delays
    recorded: Recorded
    options: Options
    chain: Chain | None
    devices: tuple[Sensor, ...]
    sensors: Sensors | None
    channels: Channels
    channel_names: tuple[str, ...]
    failing: Ints

    @property
    def n_row(self) -> int:
        """How many Jacobian rows an epoch has at most: the receiver's, then those of the sensors."""
        return (
            max(6, self.model.n_kind * self.signals.used.shape[1]) + self.channels.n_channel - self.channels.n_receiver
        )


def _profiles(card: ImuCard | ImuSet, faults: Sequence[AnyFault], course: Course) -> list[Profile]:
    """List the errors that are the same in every run: warming, and faults that begin and end with a step."""
    found: list[Profile] = []
    owners = [0] if isinstance(card, ImuCard) else [triad.unit for triad in triads_of(card)]
    for triad, number in enumerate(owners):
        unit = card if isinstance(card, ImuCard) else card.units[number]
        for sensor, ramp in ((GYRO, unit.gyro.temperature), (ACCEL, unit.accel.temperature)):
            if ramp is not None:
                found.append((2 * triad + sensor, CONSTANT, ramp.start, ramp.end, ramp.amplitude))
    for number, fault in enumerate(faults):
        if isinstance(fault, GyroBiasStep | AccelBiasStep | GyroScaleFactorStep | AccelScaleFactorStep):
            kind, driver = _STEPS[type(fault)]
            sensor = 2 * owners.index(fault.unit - 1) + kind
            x, y, z = fault.size
            for start, end in periods(number, fault, course):
                begin = start if math.isfinite(start) else course.begin(start) - STEP
                found.append((sensor, driver, begin, begin + STEP, (x, y, z)))
                if math.isfinite(end):
                    found.append((sensor, driver, end, end + STEP, (-x, -y, -z)))
    return found


def _unit(
    scenario: Scenario, ref: Reference, blocks: tuple[ErrorBlock, ...], course: Course, units: Units | None = None
) -> Unit:
    card = scenario.imu
    one = equivalent(card)
    inertial = [block for block in blocks if block.sensor >= 0]
    dt = 1.0 / card.rate
    process_ticks = max(1, round(card.rate / card.process_rate))
    step = process_ticks * dt
    decay = np.array([math.exp(-step / b.time_constant) for b in blocks])
    walk = np.array([
        [math.hypot(w * math.sqrt(step), s * math.sqrt(-math.expm1(-2.0 * step / b.time_constant)))
         for w, s in zip(axes(b.walk), axes(b.sigma), strict=True)] for b in blocks
    ]).reshape(-1, 3)  # fmt: skip
    profiles = _profiles(card, scenario.faults, course)
    if units is None:
        sensed = arriving(ref, one, scenario.faults, course)
        dtheta, dvel = elements(sensed, one, np.eye(3), 0, scenario.faults, course, ref.t[1:])
    else:
        dtheta, dvel = fused(units, dt)
    return Unit(
        dt=dt,
        noise_source=source_word(IMU_NOISE),
        biases_only=all(b.driver == CONSTANT for b in inertial) and all(p[1] == CONSTANT for p in profiles),
        dtheta=dtheta,
        dvel=dvel,
        white=white_of(one, dt),
        process_ticks=process_ticks,
        drifting=bool(np.any(walk > 0.0)) or bool(profiles),
        sigma=np.array([axes(b.sigma) for b in blocks], dtype=float).reshape(-1, 3),
        decay=decay,
        walk=walk,
        sources=np.array([source_word(f"{b.source} {b.part}") for b in blocks], dtype=np.uint64),
        sensors=np.array([b.sensor for b in inertial], dtype=np.int64),
        drivers=np.array([b.driver for b in inertial], dtype=np.int64),
        profile_sensor=np.array([p[0] for p in profiles], dtype=np.int64),
        profile_driver=np.array([p[1] for p in profiles], dtype=np.int64),
        profile_start=np.array([p[2] for p in profiles], dtype=float),
        profile_end=np.array([p[3] for p in profiles], dtype=float),
        profile=np.array([p[4] for p in profiles], dtype=float).reshape(len(profiles), 3),
        gravity=len(inertial) if len(blocks) > len(inertial) else -1,
        start=float(ref.t[0]),
    )  # fmt: skip


def reporting_axes(frame: str, t: Floats, r_i: Floats, v_i: Floats, theta0: float) -> Floats:
    """Return the matrices (n, 3, 3) from frame i to the frame that errors are reported in, at the true state.

    Velocity errors are errors of inertial velocity resolved in these axes.
    """
    if frame == "inertial":
        return np.tile(np.eye(3), (t.size, 1, 1))
    if frame == "orbital":
        return rotation_i_o(r_i, v_i)
    theta = earth_angle(theta0, t)
    return rotation_i_e(theta) if frame == "ecef" else rotation_i_n(r_i, theta)


def _flown(scenario: Scenario) -> tuple[Trajectory, Reference]:
    """Return the flight of a scenario and its samples."""
    card = scenario.trajectory
    text = identity(card)
    return built(text, card), sampled(text, card, scenario.imu.rate)


def prepare(
    scenario: Scenario,
    history: float = 1.0,
    every_step_beside: Floats | None = None,
    flown: tuple[Trajectory, Reference] | None = None,
) -> Prepared:
    """Make a scenario ready: trajectory, increments, satellites, filter models, and the windows of the flight.

    Long because all that runs share is put together here, once, each part by a function of its own.

    Parameters
    ----------
    history
        Interval of the history in s; every event time is added to it.
    every_step_beside
        History times (s) of a block; they are kept, and every covariance step is recorded beside them (for a replay:
        where windows are cut, and so the last bit of every number, is as in the block).
    flown
        The flight and its samples in place of those of the scenario's trajectory.
    """
    card = scenario.filter
    trajectory, ref = flown or _flown(scenario)
    epochs = epochs_of(scenario, ref)
    t_epoch = epochs.t
    seen = seen_in(scenario, trajectory, t_epoch, float(ref.t[0]))
    unstamped = delay(scenario.faults, trajectory.course, t_epoch)
    devices = sensors_of(scenario, trajectory, t_epoch, float(ref.t[0]))
    delayed = delays_taken(scenario, t_epoch, np.minimum(t_epoch, seen.t + unstamped), devices)
    kept = clone_times(scenario, t_epoch, delayed, ref.t, epochs.group)
    at = times_of(scenario, trajectory, ref, epochs, kept, history, every_step_beside)
    imu, receiver, initial = filter_models(scenario)
    channels, lever_b = channels_of(scenario, seen, devices), np.array(scenario.receiver.lever_b)
    received = channels._replace(tight=True) if solves(scenario) else channels
    lever_arms = seen.lever_arms if channels.tight else lever_b[None, :]
    layout, model = build_filter_model(
        card, imu, receiver, lever_arms, at.lengths, channels, _strapdown(scenario, trajectory, ref), every(scenario),
        has_covariance(scenario), solves(scenario), measured(scenario), initial.clock_drift,
    )  # fmt: skip
    schedule, model = with_regions(card.region_noise, trajectory.course, ref, at.schedule, model, layout, imu)
    schedule = with_linearisation(card, scenario.imu.rate, schedule)
    gains = gains_of(scenario, layout, channels, t_epoch, trajectory.events)
    if gains is not None:
        model = model._replace(measured=model.measured & gains.stored)
    line = Line(trajectory, lever_b, seen)
    late_by = delays(trajectory, scenario.receiver, seen, scenario.atmosphere, card.corrections)
    geometry = geometry_of(line, seen.tracked, late_by.troposphere, late_by.ionosphere)
    modelled = geometry_of(line, seen.tracked, late_by.modelled_troposphere, late_by.modelled_ionosphere)
    failed = failures(scenario.faults, trajectory.course, t_epoch, seen.names, seen.elevation, seen.tracked)
    walked = feigned(scenario.faults, trajectory, t_epoch, line.position, line.line, line.moving)
    failed = failed._replace(bias=failed.bias + walked[..., 0], drift=failed.drift + walked[..., 1])
    tabled = recorded(scenario, trajectory.theta0, line, seen, received, failed.frozen)
    shared_errors = (*families(scenario, geometry, received, failed, devices), *tabled.families)
    shared = shared_of(shared_errors, layout, epoch_interval(scenario), (t_epoch.size, received.n_channel))
    offsets = time_offsets(scenario.constellation, seen.systems, trajectory.epoch, seen.t)
    gain = smoothing_gains(scenario, seen)
    left = late_by.left + offsets + smoothing_offsets(scenario, gain, late_by.ionosphere[:, :, 0], line)
    truth = signals(
        scenario, seen, line, receiver, layout, modelled, channels, received, shared, failed, left, tabled.mean, devices
    )  # fmt: skip
    truth = underweighted(card.underweighting, trajectory.course, model.row_type, t_epoch, truth)
    blocks = (*blocks_of(scenario.imu), *disturbance(scenario.gravity))
    units = units_of(scenario, ref, trajectory.course, devices, layout)
    units = redundant_of(scenario.imu, units, ref, _profiles(scenario.imu, scenario.faults, trajectory.course))
    C_n_i = reporting_axes("ned", ref.t[:1], ref.r_i[:1], ref.v_i[:1], trajectory.theta0)[0].T
    P = initial_covariance(layout, initial, C_n_i, card.envelope or EnvelopeCard())
    check = failing(card, failed, truth, channels, lambda: pdop(line.direction, seen.tracked))
    rules = watched(card, check, channels, P)
    smoothing = smoothing_numbers(scenario, gain, seen, line, shared_errors)
    solver = solver_of(scenario, receiver, truth.used.shape[1], smoothing)
    chain = chain_of(solver, has_covariance(scenario), truth, line)
    truth = left_out(rules, truth, chain)
    if chain is not None and solver is not None:
        scale = truth.scale[:, :6]
        chain = chain._replace(reported=chain.reported * scale[:, :, None] * scale[:, None, :])
        truth.variance[:, :6] = np.diagonal(chain.reported, axis1=1, axis2=2)
    left_of_phase = line.distance + failed.bias + late_by.left_of_phase + offsets[..., 0]
    further = further_of(scenario, seen, truth, shared_errors, channels, left_of_phase, failed.slip)
    successive = delayed_of(scenario, receiver, seen, line, truth, layout, model, channels)
    truth = truth._replace(reference=references_of(scenario, seen, truth, channels, successive))
    report = _report(scenario, chain, channels, layout, solver)
    shown = (*outputs(layout, scenario.frame), *(solution_outputs(scenario.frame) if reported(scenario) else ()))
    return Prepared(
        scenario=scenario,
        trajectory=trajectory,
        reference=ref,
        sky=seen,
        outputs=(*shown, *(backup_outputs(scenario.frame) if card.backup else ())),
        layout=layout,
        model=model,
        sources=blocks,
        families=shared_errors,
        schedule=schedule,
        unit=_unit(scenario, ref, blocks, trajectory.course, units),
        signals=truth,
        start=_start(scenario, ref, C_n_i, P),
        record=_record(scenario, trajectory, ref, at.hist_tick, at.t_hist, epochs.tick),
        t_hist=at.t_hist,
        t_epoch=t_epoch,
        lengths=at.lengths,
        delays=late_by,
        recorded=tabled,
        options=Options(
            solver,
            rules,
            late_of(scenario, delayed, kept, schedule, channels),
            gains,
            vehicle_of(scenario, trajectory, ref, layout, imu),
            samples_of(scenario, ref, layout, imu),
            report,
            units=units,
            direct=True if card.feedback == "direct" else None,
            backup=len(shown) if card.backup else None,
            further=further,
            delayed=successive,
            unscented=True if card.algorithm == "unscented" else None,
            integrity=None if card.integrity is None else integrity_of(card.integrity, truth, model, card.update_rate),
            iterated=passes_of(card, layout),
        ),
        chain=chain,
        devices=devices,
        sensors=for_kernels(devices, channels, t_epoch.size),
        channels=channels,
        channel_names=_channel_names(scenario, channels, report),
        failing=check,
    )


def _strapdown(scenario: Scenario, trajectory: Trajectory, ref: Reference) -> Strapdown:
    """Return the algorithm of the strapdown, with the Earth's angle and the place where the flight starts."""
    card, angle = scenario.filter, float(earth_angle(trajectory.theta0, ref.t[0]))
    turn = float(np.sqrt(np.max(np.sum(ref.dtheta * ref.dtheta, axis=1))))
    return strapdown_of(card.strapdown, card.gravity, card.mechanisation, angle, ref.r_i[0], turn)


def _report(
    scenario: Scenario, chain: Chain | None, channels: Channels, layout: StateLayout, solver: Any
) -> Report | None:
    """Return what is reported of the receiver's own solution; None where nothing is."""
    if chain is None or not reported(scenario):
        return None
    first = channels.n_channel + N_SAMPLE * (layout.motion >= 0)
    n_own = 2 * len(channels.satellites) if solver is not None and solver.filter is not None else 0
    return Report(chain.point, len(outputs(layout, scenario.frame)), first, n_own)


def _channel_names(scenario: Scenario, channels: Channels, report: Report | None) -> tuple[str, ...]:
    """Return the names of all innovations: of the filter's channels, of the IMU's samples, of the receiver's own."""
    if not measured(scenario) and not solves(scenario):
        return ("none",)
    sensors = ("gyro", "accelerometer") if "imu" in scenario.filter.measurements else ()
    solved = channels.satellites if report is not None and report.n_channel else ()
    own = [f"receiver {name} {what}" for name in solved for what in ("range", "range rate")]
    return (*channels.names, *(f"{sensor} {axis}" for sensor in sensors for axis in "xyz"), *own)


def _start(scenario: Scenario, ref: Reference, C_n_i: Floats, P: Floats) -> Start:
    initial = scenario.initial
    attitude = C_n_i @ np.diag([initial.tilt, initial.tilt, initial.heading])
    roots = np.array([attitude, np.eye(3) * initial.velocity, np.eye(3) * initial.position])
    words = np.array([source_word(f"initial {name}") for name in ("attitude", "velocity", "position")], dtype=np.uint64)
    return Start(np.concatenate([ref.q_b_i[0], ref.v_i[0], ref.r_i[0]]), roots, words, P)


def _record(
    scenario: Scenario, trajectory: Trajectory, ref: Reference, ticks: Ints, t_hist: Floats, epoch_tick: Ints
) -> Record:
    r, v, q = (np.ascontiguousarray(a[ticks]) for a in (ref.r_i, ref.v_i, ref.q_b_i))
    shown = reporting_axes(scenario.frame, t_hist, r, v, trajectory.theta0)
    marks = np.concatenate([[0], epoch_tick])
    since = (ticks - marks[np.searchsorted(marks, ticks, side="right") - 1]) / scenario.imu.rate
    return Record(r, v, q, np.ascontiguousarray(shown), t_hist, since, scenario.diverged)
