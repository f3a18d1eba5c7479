"""A scenario made ready for both engines: everything that is the same for all runs, computed once."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.flight import Record, Schedule, Signals, Start, Unit
from lvnav_trade.filters.belief import Belief, believe, initial_covariance
from lvnav_trade.frames import earth_angle, matrices, rotation_i_e, rotation_i_n, rotation_i_o
from lvnav_trade.kernels.clock import clock_step
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.layout import StateLayout, outputs
from lvnav_trade.records import Floats, Output, Reference, Sky
from lvnav_trade.scenario import Scenario, beliefs
from lvnav_trade.world.imu import ErrorBlock, ImuCard, error_blocks, lag
from lvnav_trade.world.sky import sky
from lvnav_trade.world.trajectory import (
    Trajectory,
    TrajectoryCard,
    build,
    content,
    motion,
    reference,
    refuse_contradiction,
)

Ints = NDArray[np.int64]


class Prepared(NamedTuple):
    """A scenario and all that its runs share. t_hist, t_epoch: s since lift-off of history and epochs."""

    scenario: Scenario
    trajectory: Trajectory
    reference: Reference
    sky: Sky
    outputs: tuple[Output, ...]
    layout: StateLayout
    belief: Belief
    sources: tuple[ErrorBlock, ...]
    schedule: Schedule
    unit: Unit
    signals: Signals
    start: Start
    record: Record
    t_hist: Floats
    t_epoch: Floats
    lengths: Floats


@lru_cache(maxsize=4)
def _built(identity: str, kind: type[TrajectoryCard]) -> Trajectory:
    return build(kind.model_validate_json(identity.partition("\n")[0]))


def _identity(card: TrajectoryCard) -> str:
    """Return a card as a line of JSON, and in a second line the digest of the file it names: a changed one is read."""
    return f"{card.model_dump_json()}\n{content(card)}"


def trajectory_of(scenario: Scenario) -> Trajectory:
    """Return the scenario's trajectory; the last few that were built are kept.

    InputError where it cannot be flown, or where a user's own file contradicts itself.
    """
    card = scenario.trajectory
    flight = _built(_identity(card), type(card))
    refuse_contradiction(card, scenario.imu)
    return flight


@lru_cache(maxsize=4)
def _sampled(identity: str, kind: type[TrajectoryCard], rate: float) -> Reference:
    return reference(_built(identity, kind), rate)


def _ticks(times: Floats, start: float, rate: float, n_imu: int, group: int = 1) -> Ints:
    """Return the tick nearest to each time, on a step of the strapdown (`group` ticks)."""
    return np.clip(np.rint((times - start) * rate / group).astype(np.int64) * group, 0, n_imu)


def _history_times(trajectory: Trajectory, start: float, end: float, every: float) -> Floats:
    """Return the grid and every event time, sorted; a time that is on the grid stands once."""
    grid = np.arange(math.ceil(start / every), math.floor(end / every) + 1) * every
    events = np.array([t for t in trajectory.events.values() if start <= t <= end])
    return np.unique(np.concatenate([[start], grid, events]))


def _schedule(n_imu: int, per_window: int, hist_tick: Ints, epoch_tick: Ints) -> tuple[Schedule, Ints]:
    """Cut the flight into windows at covariance steps, epochs and history times; a second history time on the same tick
    gets a window of no ticks. Returns the schedule and the distinct window lengths in ticks.
    """
    bounds = np.unique(np.concatenate([np.arange(0, n_imu + 1, per_window), hist_tick, epoch_tick, [0, n_imu]]))
    epoch_at = {int(tick): index for index, tick in enumerate(epoch_tick)}
    hist_at: dict[int, list[int]] = {}
    for index, tick in enumerate(hist_tick):
        hist_at.setdefault(int(tick), []).append(index)
    rows: list[tuple[int, int, int, int]] = []
    last = 0
    for tick in bounds.tolist():
        here = hist_at.get(tick, [])
        if tick > 0 or here:
            rows.append((last, tick - last, epoch_at.get(tick, -1), here[0] if here else -1))
        rows += [(tick, 0, -1, index) for index in here[1:]]
        last = tick
    first, counts, epoch, hist = (np.array(column, dtype=np.int64) for column in zip(*rows, strict=True))
    lengths, which = np.unique(counts, return_inverse=True)
    return Schedule(first, counts, which.astype(np.int64), epoch, hist), lengths


def _unit(card: ImuCard, ref: Reference, blocks: tuple[ErrorBlock, ...]) -> Unit:
    dt = 1.0 / card.rate
    process_ticks = max(1, round(card.rate / card.process_rate))
    step = process_ticks * dt
    decay = np.array([math.exp(-step / b.time_constant) for b in blocks])
    walk = np.array(
        [
            math.hypot(b.walk * math.sqrt(step), b.sigma * math.sqrt(-math.expm1(-2.0 * step / b.time_constant)))
            for b in blocks
        ]
    )
    ramps = (card.gyro.temperature, card.accel.temperature)
    return Unit(
        dt=dt,
        noise_source=source_word("inertial unit white noise"),
        lean=all(b.driver == CONSTANT for b in blocks),
        dtheta=np.ascontiguousarray(lag(ref.dtheta, card.gyro.bandwidth, dt)),
        dvel=np.ascontiguousarray(lag(ref.dvel, card.accel.bandwidth, dt)),
        white=np.array([
            card.gyro.random_walk * math.sqrt(dt), card.accel.random_walk * math.sqrt(dt),
            card.gyro.quantisation, card.accel.quantisation,
        ]),
        process_ticks=process_ticks,
        wandering=bool(np.any(walk > 0.0)) or any(r is not None for r in ramps),
        sigma=np.array([b.sigma for b in blocks], dtype=float),
        decay=decay,
        walk=walk,
        sources=np.array([source_word(f"{b.source} {b.part}") for b in blocks], dtype=np.uint64),
        sensors=np.array([b.sensor for b in blocks], dtype=np.int64),
        drivers=np.array([b.driver for b in blocks], dtype=np.int64),
        ramp_start=np.array([0.0 if r is None else r.start for r in ramps]),
        ramp_end=np.array([1.0 if r is None else r.end for r in ramps]),
        ramp=np.array([(0.0, 0.0, 0.0) if r is None else r.amplitude for r in ramps]),
        start=float(ref.t[0]),
    )  # fmt: skip


def _signals(scenario: Scenario, trajectory: Trajectory, seen: Sky) -> Signals:
    receiver = scenario.receiver
    at = motion(trajectory, seen.t)
    C_b_i = matrices(at.q_b_i)
    lever = np.array(receiver.lever_b)
    position = at.r_i + C_b_i @ lever
    velocity = at.v_i + np.einsum("nij,nj->ni", C_b_i, np.cross(at.w_ib_b, lever))
    line = seen.r_i - position[:, None, :]
    distance = np.linalg.norm(line, axis=2)
    rate = np.einsum("esi,esi->es", line / distance[:, :, None], seen.v_i - velocity[:, None, :])
    n_used = seen.tracked.sum(axis=1).astype(np.int64)
    used = np.full((seen.t.size, max(1, int(n_used.max(initial=0)))), -1, dtype=np.int64)
    for epoch in range(seen.t.size):
        found = np.flatnonzero(seen.tracked[epoch])
        used[epoch, : found.size] = found
    interval = 1.0 / scenario.filter.update_rate
    names = ("receiver clock", "range noise", "solution noise", "receiver clock start")
    return Signals(
        used=used,
        n_used=n_used,
        words=np.array([source_word(name) for name in seen.names], dtype=np.uint64),
        range=distance,
        rate=rate,
        position=position,
        velocity=velocity,
        satellite=np.ascontiguousarray(seen.r_i),
        satellite_velocity=np.ascontiguousarray(seen.v_i),
        sigma=np.array([
            receiver.pseudorange_sigma, receiver.range_rate_sigma,
            receiver.solution.position_sigma, receiver.solution.velocity_sigma,
        ]),
        clock_step=np.array(clock_step(interval, receiver.clock.h0, receiver.clock.h_minus2)),
        clock_start=np.array([receiver.clock.initial_bias, receiver.clock.initial_drift]),
        interval=interval,
        sources=np.array([source_word(name) for name in names], dtype=np.uint64),
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


def _with_steps(t_hist: Floats, steps: Floats, start: float, rate: float, n_imu: int, group: int) -> Floats:
    """Return history times and covariance steps (s), sorted; a step on the tick of a history time stands once."""
    grid = (start, rate, n_imu, group)
    new = ~np.isin(_ticks(steps, *grid), _ticks(t_hist, *grid))
    return np.sort(np.concatenate([t_hist, steps[new]]))


def prepare(scenario: Scenario, history: float = 1.0, every_step_beside: Floats | None = None) -> Prepared:
    """Make a scenario ready: trajectory, increments, satellites, beliefs, and the windows of the flight.

    Parameters
    ----------
    history
        Interval of the history in s; every event time is added to it.
    every_step_beside
        History times (s) of a block; they are kept, and every covariance step is recorded beside them (for a replay:
        where windows are cut, and so the last bit of every number, is as in the block).
    """
    kind, text = type(scenario.trajectory), _identity(scenario.trajectory)
    trajectory, card = _built(text, kind), scenario.filter
    ref = _sampled(text, kind, scenario.imu.rate)
    start, end, rate = float(ref.t[0]), float(ref.t[-1]), scenario.imu.rate
    group = 1 if card.strapdown_rate is None else round(rate / card.strapdown_rate)
    n_imu = ref.dtheta.shape[0] // group * group
    interval = 1.0 / card.update_rate
    t_epoch = start + interval * np.arange(1, math.floor((end - start) / interval + 1e-9) + 1)
    epoch_tick = _ticks(t_epoch, start, rate, n_imu, group)
    t_epoch = ref.t[epoch_tick]  # increments end at ticks: half a tick is 20 m at orbital speed
    per_window = max(1, round(rate / card.covariance_rate))
    t_hist = _history_times(trajectory, start, end, history)
    if every_step_beside is not None:
        t_hist = _with_steps(every_step_beside, ref.t[::per_window], start, rate, n_imu, group)
    hist_tick = _ticks(t_hist, start, rate, n_imu, group)
    schedule, lengths = _schedule(n_imu, per_window, hist_tick, epoch_tick)
    measured = np.maximum(start, t_epoch - scenario.receiver.latency)
    seen = sky(scenario.constellation, scenario.receiver, trajectory, measured, scenario.faults)
    imu, receiver, initial = beliefs(scenario)
    layout, belief = believe(card, imu, receiver, scenario.receiver.lever_b, lengths / rate, group)
    blocks = tuple(error_blocks(scenario.imu))
    C_n_i = reporting_axes("ned", ref.t[:1], ref.r_i[:1], ref.v_i[:1], trajectory.theta0)[0].T
    return Prepared(
        scenario=scenario,
        trajectory=trajectory,
        reference=ref,
        sky=seen,
        outputs=outputs(layout, scenario.frame),
        layout=layout,
        belief=belief,
        sources=blocks,
        schedule=schedule,
        unit=_unit(scenario.imu, ref, blocks),
        signals=_signals(scenario, trajectory, seen),
        start=_start(scenario, ref, C_n_i, initial_covariance(layout, initial, C_n_i)),
        record=_record(scenario, trajectory, ref, hist_tick, t_hist, epoch_tick),
        t_hist=t_hist,
        t_epoch=t_epoch,
        lengths=lengths / rate,
    )


def _start(scenario: Scenario, ref: Reference, C_n_i: Floats, P: Floats) -> Start:
    initial = scenario.initial
    attitude = C_n_i @ np.diag([initial.tilt, initial.tilt, initial.heading])
    roots = np.array([attitude, np.eye(3) * initial.velocity, np.eye(3) * initial.position])
    names = ("initial attitude", "initial velocity", "initial position")
    words = np.array([source_word(name) for name in names], dtype=np.uint64)
    return Start(np.concatenate([ref.q_b_i[0], ref.v_i[0], ref.r_i[0]]), roots, words, P)


def _record(
    scenario: Scenario, trajectory: Trajectory, ref: Reference, ticks: Ints, t_hist: Floats, epoch_tick: Ints
) -> Record:
    r, v, q = (np.ascontiguousarray(a[ticks]) for a in (ref.r_i, ref.v_i, ref.q_b_i))
    axes = reporting_axes(scenario.frame, t_hist, r, v, trajectory.theta0)
    marks = np.concatenate([[0], epoch_tick])
    since = (ticks - marks[np.searchsorted(marks, ticks, side="right") - 1]) / scenario.imu.rate
    return Record(r, v, q, np.ascontiguousarray(axes), t_hist, since, scenario.diverged)
