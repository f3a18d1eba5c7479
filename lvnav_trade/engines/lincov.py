"""Linear covariance: covariance(prepared) -> CovHistory: formal, true, by source, on the nominal flight."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.flight import ramp_value
from lvnav_trade.engines.prepare import Prepared, rotation_matrices
from lvnav_trade.filters.belief import (
    INERTIAL,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    TIGHT,
    VELOCITY,
    transition_blocks,
    window_tables,
)
from lvnav_trade.filters.ekf import fill_loose, fill_tight
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.covariance import absorb, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.joint import apply_phi, propagate_component, update_covariance, update_vector
from lvnav_trade.kernels.strapdown import Q, R, V, gravity, mechanise
from lvnav_trade.kernels.transition import ACCEL, ATT, CONSTANT, GYRO, POS, VEL, parameter_block
from lvnav_trade.observables.base import antenna
from lvnav_trade.records import CovHistory, Floats

Ints = NDArray[np.int64]

# A parameter that is not multiplied by anything but enters as a difference: what quantisation holds back.
REMAINDER = -1


class TrueModel(NamedTuple):
    """What is true of the error sources, apart from what the filter believes.

    Blocks of three parameters: sensor, driver (REMAINDER: quantisation), matched (offset of the filter's state for the same
    thing, -1 none), source (index of each block's source), ramp (sensor whose ramp is its mean, -1 none), all (n_block,);
    fade, wander (n_length, n_block): decay and driving variance over each window length; start (n_block,) variance.
    nav_rows ... nav_drivers: blocks of the true transition of e; decay (n_length, n_state) of the filter's own estimates.
    noise (n_source, n_length, n_state): white noise of each source; initial (n_source, n_state, n_state);
    row_source (4,) source of each row type; row_variance (4,) true.
    """

    sensor: Ints
    driver: Ints
    matched: Ints
    source: Ints
    ramp: Ints
    fade: Floats
    wander: Floats
    start: Floats
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints
    noise: Floats
    initial: Floats
    row_source: Ints
    row_variance: Floats


class Nominal(NamedTuple):
    """Scratch of the one nominal run, in the form that the filter's row functions take."""

    nav: Floats
    antenna: Floats
    rate: Floats
    H: Floats
    z: Floats
    ranges: Floats
    solution: Floats
    clock_hat: Floats


class Cover(NamedTuple):
    """What the covariance pass fills: formal, true (n_hist, n, n) frame i; mean (n_hist, n); budget (n_hist, n_source, n)
    in reporting axes; n_row (n_epoch,); expected_nis (n_epoch,)."""

    formal: Floats
    true: Floats
    mean: Floats
    budget: Floats
    n_row: Ints
    expected_nis: Floats


def source_names(prepared: Prepared) -> list[str]:
    """Return every physical source of error of a case, in the order of the budget."""
    scenario, tight = prepared.scenario, prepared.belief.kind == TIGHT
    names = ["initial attitude", "initial velocity", "initial position", "gyro random walk", "accelerometer random walk"]
    names += list(dict.fromkeys(block.source for block in prepared.sources))
    if scenario.imu.gyro.quantisation > 0.0:
        names.append("gyro quantisation")
    if scenario.imu.accel.quantisation > 0.0:
        names.append("accelerometer quantisation")
    if tight:
        names += ["receiver clock start", "receiver clock", "pseudorange noise", "range-rate noise"]
    elif prepared.belief.kind != INERTIAL:
        names += ["position solution noise", "velocity solution noise"]
    return names


def _block_table(prepared: Prepared, names: list[str]) -> list[tuple[int, int, int, int, float, float, float, int]]:
    """List every true block: sensor, driver, matched state, source, start variance, walk PSD, time constant, ramp."""
    imu = prepared.scenario.imu
    states = {(p.sensor, p.driver): p.offset for p in prepared.layout.parameters}
    table = [
        (b.sensor, b.driver, states.get((b.sensor, b.driver), -1), names.index(b.source), b.sigma**2, b.walk**2, b.time_constant, -1)
        for b in prepared.sources
    ]  # fmt: skip
    for sensor, card, label in ((GYRO, imu.gyro, "gyro"), (ACCEL, imu.accel, "accelerometer")):
        if card.quantisation > 0.0:
            table.append((sensor, REMAINDER, -1, names.index(f"{label} quantisation"), 0.0, card.quantisation**2 / 12.0, 0.0, -1))
        if card.temperature is not None:
            table.append((sensor, CONSTANT, states.get((sensor, CONSTANT), -1), 0, 0.0, 0.0, math.inf, sensor))
    return table


def _fade_and_wander(table: list[Any], seconds: Floats) -> tuple[Floats, Floats]:
    fade, wander = np.ones((seconds.size, len(table))), np.zeros((seconds.size, len(table)))
    for j, (_, driver, _, _, variance, walk, time_constant, _) in enumerate(table):
        if driver == REMAINDER:
            # a new remainder at the end of every window, uniform over a step; a window of no ticks leaves it as it was
            fade[:, j], wander[:, j] = np.where(seconds > 0.0, 0.0, 1.0), np.where(seconds > 0.0, walk, 0.0)
        else:
            fade[:, j] = np.exp(-seconds / time_constant)
            wander[:, j] = walk * seconds - variance * np.expm1(-2.0 * seconds / time_constant)
    return fade, wander


def _white_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, receiver, layout = prepared.scenario.imu, prepared.scenario.receiver, prepared.layout
    noise = np.zeros((len(names), prepared.lengths.size, layout.n_state))
    seconds = prepared.lengths[:, None]
    noise[names.index("gyro random walk"), :, ATT : ATT + 3] = imu.gyro.random_walk**2 * seconds
    noise[names.index("accelerometer random walk"), :, VEL : VEL + 3] = imu.accel.random_walk**2 * seconds
    if layout.clock >= 0:
        densities = np.array(spectral_densities(receiver.clock.h0, receiver.clock.h_minus2))
        noise[names.index("receiver clock"), :, layout.clock : layout.clock + 2] = seconds * densities
    return noise


def _initial(prepared: Prepared, names: list[str]) -> Floats:
    n, layout, clock = prepared.layout.n_state, prepared.layout, prepared.scenario.receiver.clock
    initial = np.zeros((len(names), n, n))
    for index, at in enumerate((ATT, VEL, POS)):
        root = prepared.start.roots[index]
        initial[index, at : at + 3, at : at + 3] = root @ root.T
    if layout.clock >= 0:
        variances = np.array([clock.initial_bias, clock.initial_drift]) ** 2
        states = slice(layout.clock, layout.clock + 2)
        initial[names.index("receiver clock start"), states, states] = np.diag(variances)
    return initial


def true_model(prepared: Prepared, names: list[str]) -> TrueModel:
    """Turn the truth's cards into numbers; the filter's card is asked only which states it carries."""
    table = _block_table(prepared, names)
    columns = list(zip(*table, strict=True)) if table else [()] * 8
    fade, wander = _fade_and_wander(table, prepared.lengths)
    rows, cols, kinds, drivers = transition_blocks(prepared.layout.parameters, 2)
    row_names = ("pseudorange noise", "range-rate noise", "position solution noise", "velocity solution noise")
    return TrueModel(
        sensor=np.array(columns[0], dtype=np.int64),
        driver=np.array(columns[1], dtype=np.int64),
        matched=np.array(columns[2], dtype=np.int64),
        source=np.array(columns[3], dtype=np.int64),
        ramp=np.array(columns[7], dtype=np.int64),
        fade=fade,
        wander=wander,
        start=np.array(columns[4], dtype=float),
        nav_rows=rows,
        nav_columns=cols,
        nav_kinds=kinds,
        nav_drivers=drivers,
        noise=_white_noise(prepared, names),
        initial=_initial(prepared, names),
        row_source=np.array([names.index(name) if name in names else -1 for name in row_names], dtype=np.int64),
        row_variance=prepared.signals.sigma**2,
    )


@jit
def _fill_inputs(b, g, block, j, true, sums, seconds, decay, fade):
    """Set how the three components of block j and their driving noise enter e: b, g (3, n), minus what the filter's own
    estimate of the same thing takes off."""
    for axis in range(3):
        for i in range(b.shape[1]):
            b[axis, i], g[axis, i] = 0.0, 0.0
    sensor, driven_by, matched = true.sensor[j], true.driver[j], true.matched[j]
    at = ATT if sensor == GYRO else VEL
    if driven_by == REMAINDER:
        if seconds > 0.0:
            for axis in range(3):
                for i in range(3):
                    turn = sums[3 * i + axis] / seconds
                    b[axis, at + i], g[axis, at + i] = turn, -turn
        return
    if matched >= 0:
        # the filter takes off its estimate with the same blocks, so only what the estimate misses remains: in e already
        for axis in range(3):
            b[axis, matched + axis] = fade - decay[matched + axis]
            g[axis, matched + axis] = 1.0
        return
    if seconds == 0.0:
        return
    first, last = (transition.ATT_GYRO, transition.POS_GYRO) if sensor == GYRO else (transition.VEL_ACCEL, transition.POS_ACCEL)
    for kind in range(first, last + 1):
        parameter_block(block, kind, driven_by, sums, seconds)
        for i in range(3):
            for axis in range(3):
                b[axis, at + i] = block[3 * i + axis]
        at = VEL if at == ATT else POS


@jit
def _advance_mean(mean, work, deviation, sums, gravity_error, seconds):
    """Add what is the same in every run: sensed minus true increments (bandwidth), and a gravity model that is not the truth's."""
    for i in range(3):
        turned, pushed = 0.0, 0.0
        for axis in range(3):
            turned += sums[3 * i + axis] * deviation[axis] / seconds
            pushed += sums[3 * i + axis] * deviation[3 + axis] / seconds
        mean[ATT + i] -= turned
        mean[VEL + i] += gravity_error[i] * seconds - pushed
        mean[POS + i] += 0.5 * seconds * (gravity_error[i] * seconds - pushed)


@jit
def _propagate(formal, sources, cross, variance, mean, ramp_now, scratch, nominal, sums, true, unit, belief, length, first, n_tick, dtheta, dvel):
    """Propagate everything over one window: the filter's own covariance by its model, each source's by the truth's."""
    X, D, DT, work, b, g, block = scratch
    seconds = belief.seconds[length]
    nav = nominal.nav
    transition.fill(D, belief.block_kinds, belief.block_drivers, sums, nav[R], nav[R + 1], nav[R + 2], seconds)
    predict(formal, X, D, belief.block_rows, belief.block_columns, belief.decay[length], belief.noise[length], belief.clock, seconds)
    transition.fill(DT, true.nav_kinds, true.nav_drivers, sums, nav[R], nav[R + 1], nav[R + 2], seconds)
    rows, columns, decay = true.nav_rows, true.nav_columns, belief.decay[length]
    for i in range(sources.shape[0]):
        predict(sources[i], X, DT, rows, columns, decay, true.noise[i, length], belief.clock, seconds)
    apply_phi(mean, work, DT, rows, columns, decay, belief.clock, seconds)
    for j in range(true.sensor.shape[0]):
        fade = true.fade[length, j]
        _fill_inputs(b, g, block, j, true, sums, seconds, decay, fade)
        s = true.source[j]
        for axis in range(3):
            if true.ramp[j] >= 0:
                middle = unit.start + unit.dt * (first + 0.5 * n_tick)
                value = ramp_value(unit, true.ramp[j], axis, middle)
                change = value - ramp_now[true.ramp[j], axis]
                ramp_now[true.ramp[j], axis] = value
                for i in range(mean.shape[0]):
                    mean[i] += b[axis, i] * value + g[axis, i] * change
            else:
                variance[j, axis] = propagate_component(
                    sources[s], cross[j, axis], b[axis], g[axis], work, variance[j, axis], fade, true.wander[length, j],
                    DT, rows, columns, decay, belief.clock, seconds,
                )  # fmt: skip
    deviation, gravity_error = _deviation(unit, nominal, belief, first, n_tick, dtheta, dvel)
    _advance_mean(mean, work, deviation, sums, gravity_error, seconds)


@jit
def _deviation(unit, nominal, belief, first, n_tick, dtheta, dvel):
    """Return sensed minus true increments summed over a window (6,), and the error of the filter's gravity (3,)."""
    deviation = np.zeros(6)
    for k in range(first, first + n_tick):
        for axis in range(3):
            deviation[axis] += unit.dtheta[k, axis] - dtheta[k, axis]
            deviation[3 + axis] += unit.dvel[k, axis] - dvel[k, axis]
    x, y, z = nominal.nav[R], nominal.nav[R + 1], nominal.nav[R + 2]
    true, own = gravity(2, x, y, z), gravity(belief.gravity, x, y, z)
    return deviation, np.array([true[0] - own[0], true[1] - own[1], true[2] - own[2]])


@jit
def _absorb_true(formal, sources, cross, mean, K, x, work, gain, h, kind, true, belief):
    """Absorb one row in the filter's covariance, and its gain in every source; return the expected square of its normalised
    innovation."""
    n = belief.n_entry[kind]
    entries, columns = belief.entry[kind, :n], belief.column[kind, :n]
    _, weight = absorb(
        formal, x, K, h, entries, columns, 0.0, belief.variance[kind], np.inf, belief.n_estimated, belief.joseph
    )
    for i in range(gain.shape[0]):
        gain[i] = K[i] * weight if i < belief.n_estimated else 0.0
    spread = true.row_variance[kind]
    for i in range(sources.shape[0]):
        noise = true.row_variance[kind] if true.row_source[kind] == i else 0.0
        spread += update_covariance(sources[i], work, gain, h, entries, columns, noise)
    for j in range(cross.shape[0]):
        for axis in range(3):
            update_vector(cross[j, axis], gain, h, entries, columns)
    offset = update_vector(mean, gain, h, entries, columns)
    return (spread + offset * offset) * weight


@jit
def _turned(P, at, c0, c1, c2):
    a = P[at, at] * c0 * c0 + P[at + 1, at + 1] * c1 * c1 + P[at + 2, at + 2] * c2 * c2
    return a + 2.0 * (P[at, at + 1] * c0 * c1 + P[at, at + 2] * c0 * c2 + P[at + 1, at + 2] * c1 * c2)


@jit
def _write(out, hist, formal, sources, mean, axes_att, axes):
    n = mean.shape[0]
    for i in range(n):
        out.mean[hist, i] = mean[i]
        for j in range(n):
            out.formal[hist, i, j] = formal[i, j]
            total = 0.0
            for s in range(sources.shape[0]):
                total += sources[s, i, j]
            out.true[hist, i, j] = total
    for s in range(sources.shape[0]):
        for i in range(3):
            out.budget[hist, s, ATT + i] = _turned(sources[s], ATT, axes_att[i, 0], axes_att[i, 1], axes_att[i, 2])
            for at in (VEL, POS):
                out.budget[hist, s, at + i] = _turned(sources[s], at, axes[i, 0], axes[i, 1], axes[i, 2])
        for i in range(9, n):
            out.budget[hist, s, i] = sources[s, i, i]


@jit
def cover(out, schedule, unit, signals, record, axes_att, belief, true, nominal, formal, sources, cross, variance, r, v, q, dtheta, dvel):
    """Carry the filter's covariance and the true one, source by source, over the nominal flight; `out` (Cover) is filled.

    formal (n, n), sources (n_source, n, n), cross (n_block, 3, n), variance (n_block, 3): state at the start, updated.
    r, v (n_imu + 1, 3), q (n_imu + 1, 4), dtheta, dvel (n_imu, 3): the true motion and the ideal unit's increments.
    """
    n = formal.shape[0]
    mean, ramp_now = np.zeros(n), np.zeros((2, 3))
    K, x, gain = np.zeros(n), np.zeros(n), np.zeros(n)
    scratch = (
        np.zeros((n, n)), np.zeros((belief.block_rows.shape[0], 9)), np.zeros((true.nav_rows.shape[0], 9)),
        np.zeros(n), np.zeros((3, n)), np.zeros((3, n)), np.zeros(9),
    )  # fmt: skip
    sums, previous, increments = np.zeros(21), np.zeros(6), np.zeros((schedule.n_tick.max(), 6))
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            for i in range(4):
                nominal.nav[Q + i] = q[first, i]
            for i in range(3):
                nominal.nav[V + i], nominal.nav[R + i] = v[first, i], r[first, i]
            for k in range(n_tick):
                for axis in range(3):
                    increments[k, axis], increments[k, 3 + axis] = dtheta[first + k, axis], dvel[first + k, axis]
            mechanise(nominal.nav, sums, previous, increments, n_tick, unit.dt, belief.gravity)
            _propagate(
                formal, sources, cross, variance, mean, ramp_now, scratch, nominal, sums, true, unit, belief,
                schedule.length[w], first, n_tick, dtheta, dvel,
            )  # fmt: skip
        epoch = schedule.epoch[w]
        if epoch >= 0 and belief.kind != INERTIAL:
            last = first + n_tick
            for i in range(4):
                nominal.nav[Q + i] = q[last, i]
            for i in range(3):
                nominal.nav[V + i], nominal.nav[R + i] = v[last, i], r[last, i]
                nominal.rate[i] = previous[i] / unit.dt
            antenna(nominal.antenna, nominal.nav, nominal.rate, belief.lever)
            if belief.kind == TIGHT:
                fill_tight(nominal, belief, signals, epoch)
                for slot in range(signals.n_used[epoch]):
                    for half in range(2):
                        kind = PSEUDORANGE if half == 0 else RANGE_RATE
                        out.expected_nis[epoch] += _absorb_true(
                            formal, sources, cross, mean, K, x, scratch[3], gain, nominal.H[2 * slot + half], kind, true, belief
                        )
                out.n_row[epoch] = 2 * signals.n_used[epoch]
            elif signals.n_used[epoch] >= 4:
                fill_loose(nominal)
                for row in range(6):
                    kind = POSITION if row < 3 else VELOCITY
                    out.expected_nis[epoch] += _absorb_true(
                        formal, sources, cross, mean, K, x, scratch[3], gain, nominal.H[row], kind, true, belief
                    )
                out.n_row[epoch] = 6
        hist = schedule.hist[w]
        if hist >= 0:
            _write(out, hist, formal, sources, mean, axes_att[hist], record.axes[hist])


def _initial_cross(prepared: Prepared, true: TrueModel) -> tuple[Floats, Floats]:
    """Return Cov(e, c) (n_block, 3, n) and Var(c) (n_block, 3) at the start: the estimate is zero, so the filter's error in a
    parameter is the true parameter itself, and Cov = +Var."""
    n_block = true.sensor.size
    cross = np.zeros((n_block, 3, prepared.layout.n_state))
    variance = np.repeat(true.start[:, None], 3, axis=1) if n_block else np.zeros((0, 3))
    for j in range(n_block):
        if true.matched[j] >= 0:
            for axis in range(3):
                cross[j, axis, true.matched[j] + axis] = variance[j, axis]
    return cross, variance


def _start_sources(true: TrueModel, cross: Floats) -> Floats:
    sources = true.initial.copy()
    for j in range(true.sensor.size):
        if true.matched[j] >= 0:
            for axis in range(3):
                at = true.matched[j] + axis
                sources[true.source[j], at, at] += cross[j, axis, at]
    return sources


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    names = source_names(prepared)
    true = true_model(prepared, names)
    n, n_hist, n_epoch = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size
    n_slot = prepared.signals.used.shape[1]
    n_row = max(6, 2 * n_slot)
    nominal = Nominal(
        np.zeros(10), np.zeros(12), np.zeros(3), np.zeros((n_row, 10)), np.zeros(n_row), np.zeros((n_slot, 2)), np.zeros(6), np.zeros(2)
    )  # fmt: skip
    out = Cover(
        np.zeros((n_hist, n, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n)), np.zeros((n_hist, len(names), n)),
        np.zeros(n_epoch, dtype=np.int64), np.zeros(n_epoch),
    )  # fmt: skip
    cross, variance = _initial_cross(prepared, true)
    ref, record = prepared.reference, prepared.record
    axes_att = np.ascontiguousarray(np.swapaxes(rotation_matrices(record.q), 1, 2))
    cover(
        out, prepared.schedule, prepared.unit, prepared.signals, record, axes_att, prepared.belief, true, nominal,
        prepared.start.P.copy(), _start_sources(true, cross), cross, variance,
        ref.r_i, ref.v_i, ref.q_b_i, ref.dtheta, ref.dvel,
    )  # fmt: skip
    return _history(prepared, names, out, axes_att)


def _history(prepared: Prepared, names: list[str], out: Cover, axes_att: Floats) -> CovHistory:
    n, m = prepared.layout.n_state, prepared.layout.n_estimated
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, ATT : ATT + 3, ATT : ATT + 3] = axes_att
    turn[:, VEL : VEL + 3, VEL : VEL + 3] = prepared.record.axes
    turn[:, POS : POS + 3, POS : POS + 3] = prepared.record.axes
    turn[:, range(9, n), range(9, n)] = 1.0
    total = out.true + out.mean[:, :, None] * out.mean[:, None, :]
    expected = np.trace(np.linalg.solve(out.formal[:, :m, :m], total[:, :m, :m]), axis1=1, axis2=2)
    formal, true = turn @ out.formal @ np.swapaxes(turn, 1, 2), turn @ out.true @ np.swapaxes(turn, 1, 2)
    diagonal = range(n)
    return CovHistory(
        t=prepared.t_hist,
        formal=np.sqrt(formal[:, diagonal, diagonal]),
        true_sigma=np.sqrt(np.maximum(0.0, true[:, diagonal, diagonal])),
        mean=np.einsum("hij,hj->hi", turn, out.mean),
        sources=tuple(names),
        budget=out.budget,
        formal_cov=formal,
        true_cov=true,
        t_epoch=prepared.t_epoch,
        n_row=out.n_row.astype(np.int32),
        expected_nees=expected,
        expected_nis=out.expected_nis,
    )
