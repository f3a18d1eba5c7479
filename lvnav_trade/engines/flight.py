"""One flight of one run, or of eight at once: truth corrupts, belief navigates, and they meet in measurements only."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.filters.belief import INERTIAL, TIGHT
from lvnav_trade.filters.ekf import clear_epoch, correct, predict_window, update_loose, update_tight
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import from_rotation, matrix, multiply, normalise, small_rotation
from lvnav_trade.kernels.covariance import normalised_square
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, size, sqrt, where
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.strapdown import Q, R, V, mechanise
from lvnav_trade.kernels.transition import ATT, CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2, POS, VEL
from lvnav_trade.observables import doppler, position, pseudorange, velocity

Floats = NDArray[np.float64]

_ZERO, _ONE = np.uint64(0), np.uint64(1)


class Schedule(NamedTuple):
    """Windows of IMU ticks: first_tick, n_tick, length (index of its length), epoch and hist (-1: none), all
    (n_window,).
    """

    first_tick: NDArray[np.int64]
    n_tick: NDArray[np.int64]
    length: NDArray[np.int64]
    epoch: NDArray[np.int64]
    hist: NDArray[np.int64]


class Unit(NamedTuple):
    """The inertial unit's truth. dt s; noise_source word; lean: only constant parameters; dtheta, dvel (n_imu, 3).

    white (4,) per-tick sigma of gyro and accelerometer, quantisation steps; process_ticks between steps of wandering
    parameters; wandering: any; sigma, decay, walk (n_block,); sources words, sensors, drivers (n_block,); ramp_start,
    ramp_end (2,) s, ramp (2, 3) of gyro and accelerometer; start s since lift-off of tick 0.
    """

    dt: float
    noise_source: np.uint64
    lean: bool
    dtheta: Floats
    dvel: Floats
    white: Floats
    process_ticks: int
    wandering: bool
    sigma: Floats
    decay: Floats
    walk: Floats
    sources: NDArray[np.uint64]
    sensors: NDArray[np.int64]
    drivers: NDArray[np.int64]
    ramp_start: Floats
    ramp_end: Floats
    ramp: Floats
    start: float


class Signals(NamedTuple):
    """What is true of the satellites and the receiver at the epochs.

    used (n_epoch, n_slot) satellite index in each slot, -1 none; n_used (n_epoch,); words (n_sat,) of satellites;
    range, rate (n_epoch, n_sat) true, m and m/s; position, velocity (n_epoch, 3) of the antenna, frame i; satellite,
    satellite_velocity (n_epoch, n_sat, 3) as the filter knows them; sigma (4,) by row type; clock_step (3,) Cholesky
    factor over an epoch; clock_start (2,) sigma; interval s between epochs; sources (4,) words: clock, ranges,
    solution, clock start.
    """

    used: NDArray[np.int64]
    n_used: NDArray[np.int64]
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
    interval: float
    sources: NDArray[np.uint64]


class Start(NamedTuple):
    """True state at tick 0 and the spread of the filter's: nav (10,); roots (3, 3, 3) of the covariance of attitude,
    velocity and position error, frame i; sources (3,) words; P (n_state, n_state) the filter's own covariance.
    """

    nav: Floats
    roots: Floats
    sources: NDArray[np.uint64]
    P: Floats


class Record(NamedTuple):
    """What is true at the history times.

    r, v (n_hist, 3), q (n_hist, 4) true motion; axes (n_hist, 3, 3) from frame i to the reporting frame; t (n_hist,) s;
    since (n_hist,) s since the last epoch; limit m of position error beyond which a run has failed.
    """

    r: Floats
    v: Floats
    q: Floats
    axes: Floats
    t: Floats
    since: Floats
    limit: float


class Work(NamedTuple):
    """Arrays of a run (or lane views of eight): states, scratch, and what is handed out. See `work_shapes`."""

    run: NDArray[np.uint64]
    nav: Floats
    sums: Floats
    previous: Floats
    increments: Floats
    P: Floats
    X: Floats
    D: Floats
    x: Floats
    K: Floats
    H: Floats
    z: Floats
    antenna: Floats
    rate: Floats
    true_par: Floats
    true_tables: Floats
    par: Floats
    tables: Floats
    remainder: Floats
    clock: Floats
    clock_hat: Floats
    ranges: Floats
    solution: Floats
    err: Floats
    sigma: Floats
    nees: Floats
    nis: Floats
    n_row: Floats
    n_reject: Floats
    innovation: Floats
    failed: Floats
    t_failed: Floats


def work_shapes(
    n_state: int,
    n_par: int,
    n_true: int,
    n_block: int,
    n_tick: int,
    n_hist: int,
    n_epoch: int,
    n_slot: int,
    n_channel: int,
) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array of Work for one run."""
    n_row = max(6, 2 * n_slot)
    return {
        "run": (1,), "nav": (10,), "sums": (21,), "previous": (6,), "increments": (n_tick, 6),
        "P": (n_state, n_state), "X": (n_state, n_state), "D": (n_block, 9), "x": (n_state,), "K": (n_state,),
        "H": (n_row, 10), "z": (n_row,), "antenna": (12,), "rate": (3,),
        "true_par": (max(1, n_true), 3), "true_tables": (2, processes.N_TABLE),
        "par": (max(1, n_par), 3), "tables": (2, processes.N_TABLE),
        "remainder": (6,), "clock": (2,), "clock_hat": (2,), "ranges": (n_slot, 2), "solution": (6,),
        "err": (n_hist, n_state), "sigma": (n_hist, n_state), "nees": (n_hist,),
        "nis": (n_epoch,), "n_row": (n_epoch,), "n_reject": (n_epoch,), "innovation": (n_epoch, n_channel),
        "failed": (1,), "t_failed": (1,),
    }  # fmt: skip


@jit
def begin(work, unit, signals, start, belief, k0, k1):
    """Set every state of a run at tick 0: true parameters and clock drawn, the estimate off by its initial error."""
    run = work.run[0]
    q = from_errors(work, start, k0, k1, run)
    work.nav[Q], work.nav[Q + 1], work.nav[Q + 2], work.nav[Q + 3] = q
    for i in range(6):
        work.previous[i] = like(q[0], 0.0)
        work.remainder[i] = like(q[0], 0.0)
    for i in range(belief.n_state):
        work.x[i] = like(q[0], 0.0)
        for j in range(belief.n_state):
            work.P[i, j] = like(q[0], start.P[i, j])
    processes.zero_all(work.par)
    processes.zero_all(work.tables)
    processes.zero_all(work.true_par)
    processes.start(work.true_par, unit.sigma, unit.sources, k0, k1, run)
    processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
    n0, n1, _, _ = normals(k0, k1, signals.sources[3], run, _ZERO, _ZERO)
    work.clock[0], work.clock[1] = signals.clock_start[0] * n0, signals.clock_start[1] * n1
    work.clock_hat[0], work.clock_hat[1] = like(n0, 0.0), like(n0, 0.0)
    work.failed[0], work.t_failed[0] = like(n0, 0.0), like(n0, np.nan)


@jit
def from_errors(work, start, k0, k1, run):
    """Set velocity and position of the estimate, and return its attitude, off the truth by drawn errors."""
    for block in range(1, 3):
        n0, n1, n2, _ = normals(k0, k1, start.sources[block], run, _ZERO, _ZERO)
        root, at = start.roots[block], V if block == 1 else R
        for i in range(3):
            error = root[i, 0] * n0 + root[i, 1] * n1 + root[i, 2] * n2
            work.nav[at + i] = start.nav[at + i] - error
    n0, n1, n2, _ = normals(k0, k1, start.sources[0], run, _ZERO, _ZERO)
    root = start.roots[0]
    x = root[0, 0] * n0 + root[0, 1] * n1 + root[0, 2] * n2
    y = root[1, 0] * n0 + root[1, 1] * n1 + root[1, 2] * n2
    z = root[2, 0] * n0 + root[2, 1] * n1 + root[2, 2] * n2
    e0, e1, e2, e3 = from_rotation(-x, -y, -z)
    t = start.nav
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, t[Q], t[Q + 1], t[Q + 2], t[Q + 3])
    return normalise(q0, q1, q2, q3)


@jit
def ramp_value(unit, sensor, axis, t):
    """Return the bias (SI) that the temperature ramp of a sensor has at time t (s since lift-off)."""
    first, last = unit.ramp_start[sensor], unit.ramp_end[sensor]
    share = min(1.0, max(0.0, (t - first) / (last - first)))
    return share * unit.ramp[sensor, axis]


@inlined
def sense(work, unit, first, n_tick, k0, k1):
    """Fill the window's increments with what the unit puts out; wandering parameters step on their own clock."""
    run, done = work.run[0], 0
    while done < n_tick:
        tick = first + done
        phase = tick % unit.process_ticks
        if tick == 0 or (unit.wandering and phase == 0):
            if tick > 0:
                epoch = np.uint64(tick // unit.process_ticks)
                processes.step(work.true_par, unit.decay, unit.walk, unit.sources, k0, k1, run, epoch)
            processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
            middle = unit.start + unit.dt * (tick + 0.5 * unit.process_ticks)
            for sensor in range(2):
                for axis in range(3):
                    bias = work.true_tables[sensor, axis] + ramp_value(unit, sensor, axis, middle)
                    work.true_tables[sensor, axis] = bias
        count = min(n_tick - done, unit.process_ticks - phase)
        processes.corrupt(
            work.increments, done, tick, count, unit.dtheta, unit.dvel, work.true_tables[0], work.true_tables[1],
            unit.white, work.remainder, unit, k0, k1, run,
        )  # fmt: skip
        done += count


@jit
def observe(work, signals, tight, epoch, k0, k1):
    """Step the receiver's clock to the epoch and fill the measurements that the filter uses."""
    run = work.run[0]
    word = np.uint64(epoch + 1)
    n0, n1, _, _ = normals(k0, k1, signals.sources[0], run, word, _ZERO)
    step = signals.clock_step
    work.clock[0] = work.clock[0] + signals.interval * work.clock[1] + step[0] * n0
    work.clock[1] = work.clock[1] + step[1] * n0 + step[2] * n1
    if tight:
        for slot in range(signals.n_used[epoch]):
            s = signals.used[epoch, slot]
            m0, m1, _, _ = normals(k0, k1, signals.sources[1], run, word, signals.words[s])
            work.ranges[slot, 0] = pseudorange.observe(signals.range[epoch, s], work.clock[0], signals.sigma[0], m0)
            work.ranges[slot, 1] = doppler.observe(signals.rate[epoch, s], work.clock[1], signals.sigma[1], m1)
    else:
        p0, p1, p2, _ = normals(k0, k1, signals.sources[2], run, word, _ZERO)
        v0, v1, v2, _ = normals(k0, k1, signals.sources[2], run, word, _ONE)
        p, v = (p0, p1, p2), (v0, v1, v2)
        for axis in range(3):
            work.solution[axis] = position.observe(signals.position[epoch, axis], signals.sigma[2], p[axis])
            work.solution[3 + axis] = velocity.observe(signals.velocity[epoch, axis], signals.sigma[3], v[axis])


@jit
def true_parameter(tables, sensor, kind, axis):
    """Return the true value of what a filter's parameter stands for: all true parameters of the same driver."""
    table = tables[sensor]
    if kind == CONSTANT:
        return table[processes.BIAS + axis]
    if OWN_0 <= kind and kind <= OWN_2:
        return table[processes.OWN + 3 * axis + (axis + kind - OWN_0) % 3]
    if OTHER_0 <= kind and kind <= OTHER_2:
        return table[processes.OTHER + 3 * axis + kind - OTHER_0]
    return table[processes.SQUARES + axis]


@jit
def _turned_sigma(work, at, c0, c1, c2):
    """Return the sigma of a block's component along a direction (c0, c1, c2)."""
    P = work.P
    a = P[at, at] * c0 * c0 + P[at + 1, at + 1] * c1 * c1 + P[at + 2, at + 2] * c2 * c2
    b = P[at, at + 1] * c0 * c1 + P[at, at + 2] * c0 * c2 + P[at + 1, at + 2] * c1 * c2
    return sqrt(a + 2.0 * b)


@jit
def record(work, history, belief, hist):
    """Write errors (truth minus estimate), the filter's sigma and NEES at a history time, in reporting axes."""
    nav, x = work.nav, work.x
    q = history.q[hist]
    x[ATT], x[ATT + 1], x[ATT + 2] = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]
    for b in range(belief.par_offset.shape[0]):
        for i in range(3):
            true = true_parameter(work.true_tables, belief.par_sensor[b], belief.par_driver[b], i)
            x[belief.par_offset[b] + i] = true - work.par[b, i]
    if belief.clock >= 0:
        # the true clock steps at epochs; between them its bias moves on by its drift
        x[belief.clock] = work.clock[0] + history.since[hist] * work.clock[1] - work.clock_hat[0]
        x[belief.clock + 1] = work.clock[1] - work.clock_hat[1]
    c = matrix(q[0], q[1], q[2], q[3])
    axes = history.axes[hist]
    for i in range(3):
        work.err[hist, ATT + i] = c[i] * x[ATT] + c[3 + i] * x[ATT + 1] + c[6 + i] * x[ATT + 2]
        work.sigma[hist, ATT + i] = _turned_sigma(work, ATT, c[i], c[3 + i], c[6 + i])
        for at in (VEL, POS):
            work.err[hist, at + i] = axes[i, 0] * x[at] + axes[i, 1] * x[at + 1] + axes[i, 2] * x[at + 2]
            work.sigma[hist, at + i] = _turned_sigma(work, at, axes[i, 0], axes[i, 1], axes[i, 2])
    for i in range(9, belief.n_state):
        work.err[hist, i] = x[i]
        work.sigma[hist, i] = sqrt(work.P[i, i])
    work.nees[hist] = normalised_square(work.P, work.X, work.K, x, belief.n_estimated)
    _judge(work, history, hist)
    for i in range(belief.n_state):
        x[i] = like(x[i], 0.0)


@jit
def _judge(work, history, hist):
    """Mark a run whose position error is not finite (1) or beyond the limit (2), with the time when it was first so."""
    x, failed = work.x, work.failed[0]
    square = x[POS] * x[POS] + x[POS + 1] * x[POS + 1] + x[POS + 2] * x[POS + 2] + 0.0 * work.P[ATT, ATT]
    good = square <= history.limit * history.limit
    code = where(square > history.limit * history.limit, 2.0, 1.0)
    now = where(good, failed, where(failed > 0.0, failed, code))
    work.t_failed[0] = where((now > 0.0) & (failed == 0.0), history.t[hist], work.t_failed[0])
    work.failed[0] = now


@inlined
def fly(work, schedule, unit, signals, start, history, belief, k0, k1):
    """Fly one run (float64 arrays) or eight (lane views) from start to end; `work` is filled.

    Parameters
    ----------
    work : Work; schedule : Schedule; unit : Unit; signals : Signals; start : Start; history : Record; belief : Belief
    k0, k1 : key words of the campaign's seed
    """
    begin(work, unit, signals, start, belief, k0, k1)
    tight, dt = belief.kind == TIGHT, unit.dt * belief.group
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            sense(work, unit, first, n_tick, k0, k1)
            processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], belief.lean, unit.dt)
            if belief.group > 1:
                processes.combine(work.increments, n_tick, belief.group)
            mechanise(
                work.nav, work.sums, work.previous, work.increments, n_tick // belief.group, dt, belief.gravity
            )  # fmt: skip
            predict_window(work, belief, schedule.length[w])
        epoch = schedule.epoch[w]
        if epoch >= 0:
            clear_epoch(work, epoch, size(work.innovation, 1))
        if epoch >= 0 and belief.kind != INERTIAL:
            observe(work, signals, tight, epoch, k0, k1)
            if tight:
                update_tight(work, belief, signals, epoch, dt)
            elif signals.n_used[epoch] >= 4:
                update_loose(work, belief, epoch, dt)
            correct(work, belief)
        if schedule.hist[w] >= 0:
            record(work, history, belief, schedule.hist[w])
