"""The pass of linear covariance of a flight with an attitude reference: all sources at once, tick by tick.

The covariance of e (truth minus estimate) that each source puts there is one lane of a group of eight, because gains
and transition are the same for all of them. True rate and acceleration are the same in every run: what they change by
from tick to tick and the filter does not know moves the mean. A true parameter c that the filter's own state does not
follow exactly (another time constant, or no state at all) is carried with its covariance with e, y = Cov(e, c).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from lvnav_trade.engines.sensing import profile_value
from lvnav_trade.filters.ekf import fill_loose, place_antenna, rows_at
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.covariance import absorb, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.strapdown import J4, Q, R, V, gravity, mechanise
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.kernels.vehicle import (
    N_SAMPLE,
    absorb_samples,
    advance,
    advance_vector,
    joint_gain,
    mirror,
    update_rows,
    update_rows_vector,
)
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]


class Spread(NamedTuple):
    """State of the pass, updated: formal (n, n); mean (n,); sources (n_group, n, n, 8), a source a lane (without
    compiled code: (n_source, n, n)); y (n_part, n) and variance (n_part,) of the true parameters.
    """

    formal: Floats
    mean: Floats
    sources: Floats
    y: Floats
    variance: Floats


class Desk(NamedTuple):
    """Work arrays: of the filter's own covariance, of eight sources, of rows, of a window of the nominal flight."""

    X: Floats
    D: Floats
    D_true: Floats
    moved: Floats
    K: Floats
    x: Floats
    z: Floats
    weight: Floats
    residual: Floats
    gain: Floats
    work: Floats
    seen: Floats
    X_source: Floats
    moved_source: Floats
    Y: Floats
    S: Floats
    sample_noise: Floats
    row_noise: Floats
    row_gain: Floats
    sums: Floats
    increments: Floats
    still: Floats


class Parts(NamedTuple):
    """True parameters, a component an entry: source; matched state of the filter, -1 none; followed: c is carried with
    its y; sample: component of the unit's samples that it adds to, -1 none; shared: component of the errors that
    measurements share, -1 none; fade, wander (n_length, n_part); family (n_family,) of the filter's extra states that
    stands for the same thing, -1 none. row_source (3,) of position, velocity and attitude rows; sample_rows,
    sample_columns (6, 2) and sample_entries (6,) of the unit's rows. noise (n_length, n_source, n_state) white noise of
    a filter without a vehicle model. nav_rows ... nav_drivers: blocks of the true transition.
    """

    source: Ints
    matched: Ints
    followed: NDArray[np.bool_]
    sample: Ints
    shared: Ints
    fade: Floats
    wander: Floats
    family: Ints
    row_source: Ints
    sample_rows: Floats
    sample_columns: Ints
    sample_entries: Ints
    noise: Floats
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints


class Covered(NamedTuple):
    """What the pass fills: formal, true (n_hist, n, n) and mean (n_hist, n), frame i; sources (n_hist, n_source, n, n);
    sample_spread (n_hist, n_source, 6) variance of true parameters in a sample; n_row, expected_nis, worst_ratio
    (n_epoch,).
    """

    formal: Floats
    true: Floats
    mean: Floats
    sources: Floats
    sample_spread: Floats
    n_row: Ints
    expected_nis: Floats
    worst_ratio: Floats


def group(array, index):
    """Return one group of sources, as eight lanes where they are lanes."""
    return array[index]


@overload(group)
def _group(array, index):
    return lambda array, index: view(array[index])


def add_to(array, source, i, j, value):
    """Add to an entry of one source; of two that mirror each other the upper one is meant."""
    array[source, min(i, j), max(i, j)] += value


@overload(add_to)
def _add_to(array, source, i, j, value):
    def lanes(array, source, i, j, value):
        array[source // WIDTH, min(i, j), max(i, j), source % WIDTH] += value

    return lanes


def entry(array, source, i, j):
    """Return an entry (i, j) of one source."""
    return array[source, i, j]


@overload(entry)
def _entry(array, source, i, j):
    return lambda array, source, i, j: array[source // WIDTH, i, j, source % WIDTH]


def set_noise(array, source, row, value):
    """Set the noise that one source has in a row."""
    array[source, row] = value


@overload(set_noise)
def _set_noise(array, source, row, value):
    def lanes(array, source, row, value):
        array[source // WIDTH, row, source % WIDTH] = value

    return lanes


@jit
def _total(S, n_source, r, q):
    total = 0.0
    for s in range(n_source):
        total += entry(S, s, r, q)
    return total


@jit
def _nominal_tick(sums, reference, tick, dt):
    """Set the integral of C_b_i and the velocity gained over a tick of the nominal flight."""
    q, a, f = reference.q_b_i[tick], reference.dtheta[tick], reference.dvel[tick]
    c = matrix(q[0], q[1], q[2], q[3])
    rx, ry, rz = cross(a[0], a[1], a[2], f[0], f[1], f[2])
    for i in range(3):
        for j in range(3):
            sums[3 * i + j] = dt * c[3 * i + j]
        sums[9 + i] = (
            c[3 * i] * (f[0] + 0.5 * rx) + c[3 * i + 1] * (f[1] + 0.5 * ry) + c[3 * i + 2] * (f[2] + 0.5 * rz)
        )


@jit
def _take_part(spread, p, a, gain, parts):
    """Take a true parameter through one row that it is in by the partial `a`, after y and its source's covariance
    were updated; return what it adds to the innovation's variance beside 2 a h y.
    """
    y, variance, s, n = spread.y[p], spread.variance[p], parts.source[p], gain.shape[0]
    for i in range(n):
        for j in range(i, n):
            value = a * a * variance * gain[i] * gain[j] - a * (y[i] * gain[j] + gain[i] * y[j])
            add_to(spread.sources, s, i, j, value)
    for i in range(n):
        y[i] -= gain[i] * a * variance
    return a * a * variance


@inlined
def _samples(spread, desk, unit, vehicle, parts, reference, tick, n_group):
    """Absorb the samples of a tick in the filter's covariance, and with those gains in all sources and in the mean."""
    m, mean = vehicle.motion, spread.mean
    for i in range(3):
        if tick > 0:
            mean[m + i] += vehicle.rate[tick, i] - vehicle.rate[tick - 1, i]
            mean[m + 3 + i] += vehicle.force[tick, i] - vehicle.force[tick - 1, i]
        desk.z[i] = (unit.dtheta[tick, i] - reference.dtheta[tick, i]) / unit.dt
        desk.z[3 + i] = (unit.dvel[tick, i] - reference.dvel[tick, i]) / unit.dt
    for i in range(N_SAMPLE):
        spread.formal[m + i, m + i] += vehicle.walk[tick, i]
    absorb_samples(
        spread.formal, desk.x, desk.K, desk.weight, desk.residual, desk.still, vehicle.variance, vehicle.bias, m
    )
    joint_gain(desk.gain, desk.K, desk.weight, vehicle.bias, m)
    rows, columns, entries = parts.sample_rows, parts.sample_columns, parts.sample_entries
    for g in range(n_group):
        update_rows(
            group(spread.sources, g), desk.Y, group(desk.S, g), desk.gain, rows, columns, entries,
            group(desk.sample_noise, g),
        )  # fmt: skip
    for p in range(parts.source.shape[0]):
        if parts.followed[p]:
            update_rows_vector(spread.y[p], desk.seen, desk.gain, rows, columns, entries)
    update_rows_vector(mean, desk.seen, desk.gain, rows, columns, entries)
    for r in range(N_SAMPLE):
        desk.seen[r] += desk.z[r]
        for i in range(mean.shape[0]):
            mean[i] -= desk.gain[r, i] * desk.z[r]


@jit
def _expected_of_samples(desk, vehicle, n_source):
    """Return the expected sum of squares of the normalised innovations of the last tick's rows."""
    m, b, total = vehicle.motion, vehicle.bias, 0.0
    S, T = np.zeros((N_SAMPLE, N_SAMPLE)), np.eye(N_SAMPLE)
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            S[r, q] = _total(desk.S, n_source, r, q) + desk.seen[r] * desk.seen[q]
    for r in range(N_SAMPLE):
        for q in range(r):
            seen = (desk.K[q, m + r] + desk.K[q, b + r]) * desk.weight[q]
            for c in range(N_SAMPLE):
                T[r, c] -= seen * T[q, c]
        for c in range(N_SAMPLE):
            for d in range(N_SAMPLE):
                total += T[r, c] * S[c, d] * T[r, d] * desk.weight[r]
    return total


@inlined
def _modelled_window(spread, desk, unit, vehicle, parts, reference, first, n_tick, n_group):
    for k in range(n_tick):
        tick = first + k
        _samples(spread, desk, unit, vehicle, parts, reference, tick, n_group)
        _nominal_tick(desk.sums, reference, tick, unit.dt)
        advance(spread.formal, desk.moved, desk.sums, unit.dt, vehicle.motion)
        for g in range(n_group):
            advance(group(spread.sources, g), desk.moved_source, desk.sums, unit.dt, vehicle.motion)
        for p in range(parts.source.shape[0]):
            if parts.followed[p]:
                advance_vector(spread.y[p], desk.sums, unit.dt, vehicle.motion)
        advance_vector(spread.mean, desk.sums, unit.dt, vehicle.motion)


@inlined
def _mechanised_window(nominal, desk, unit, reference, first, n_tick, kind):
    """Mechanise the ideal increments of a window from the true state: the sums that the transition needs."""
    for k in range(n_tick):
        for axis in range(3):
            desk.increments[k, axis] = reference.dtheta[first + k, axis]
            desk.increments[k, 3 + axis] = reference.dvel[first + k, axis]
    take_nominal(nominal, reference, first)
    mechanise(nominal.nav, desk.sums, nominal.previous, desk.increments, n_tick, unit.dt, kind)


@jit
def take_nominal(nominal, reference, tick):
    """Set the nominal navigation state to the true one at a tick."""
    for i in range(4):
        nominal.nav[Q + i] = reference.q_b_i[tick, i]
    for i in range(3):
        nominal.nav[V + i], nominal.nav[R + i] = reference.v_i[tick, i], reference.r_i[tick, i]


@jit
def _add_noise(sources, noise, n_source):
    """Add half of the white noise (n_source, n) of a window to the diagonals of the sources."""
    for s in range(n_source):
        for i in range(noise.shape[1]):
            if noise[s, i] != 0.0:
                add_to(sources, s, i, i, 0.5 * noise[s, i])


@inlined
def _slow(spread, desk, nominal, parts, belief, modelled, length, n_group, n_source):
    """Propagate over a window what no tick has propagated: all of it without a vehicle model; else decay, the biases'
    walk, the gradient of gravity. Then the true parameters.
    """
    seconds, decay, nav = belief.seconds[length], belief.decay[length], nominal.nav
    rows, columns = belief.block_rows, belief.block_columns
    transition.fill(
        desk.D, belief.block_kinds, belief.block_drivers, desk.sums, nav[R], nav[R + 1], nav[R + 2], seconds
    )
    mirror(spread.formal)
    predict(spread.formal, desk.X, desk.D, rows, columns, decay, belief.noise[length], belief.clock, seconds)
    D = desk.D
    if not modelled:
        rows, columns, D = parts.nav_rows, parts.nav_columns, desk.D_true
        transition.fill(D, parts.nav_kinds, parts.nav_drivers, desk.sums, nav[R], nav[R + 1], nav[R + 2], seconds)
        _add_noise(spread.sources, parts.noise[length], n_source)
    for g in range(n_group):
        P = group(spread.sources, g)
        mirror(P)
        predict(P, desk.X_source, D, rows, columns, decay, desk.work, belief.clock, seconds)
    if not modelled:
        _add_noise(spread.sources, parts.noise[length], n_source)
    apply_phi(spread.mean, desk.seen_n, D, rows, columns, decay, belief.clock, seconds)
    for p in range(parts.source.shape[0]):
        if parts.followed[p]:
            apply_phi(spread.y[p], desk.seen_n, D, rows, columns, decay, belief.clock, seconds)
        _step_part(spread, parts, p, length, decay)


@jit
def _step_part(spread, parts, p, length, decay):
    """Let a true parameter fade and wander over a window; in e it acts where a state stands for it."""
    s, at, y, variance = parts.source[p], parts.matched[p], spread.y[p], spread.variance[p]
    fade, wander = parts.fade[length, p], parts.wander[length, p]
    if at >= 0:
        b = fade - decay[at]
        if parts.followed[p]:
            for i in range(y.shape[0]):
                add_to(spread.sources, s, i, at, b * y[i] if i != at else 2.0 * b * y[i])
            add_to(spread.sources, s, at, at, b * b * variance)
            y[at] += b * variance
        add_to(spread.sources, s, at, at, wander)
    if parts.followed[p]:
        for i in range(y.shape[0]):
            y[i] *= fade
        if at >= 0:
            y[at] += wander
    spread.variance[p] = fade * fade * variance + wander


@jit
def _move_mean(spread, nominal, unit, belief, vehicle, first, n_tick, reference):
    """Move the mean by what is the same in every run: error of the filter's gravity, profiles of bias."""
    mean, nav, seconds = spread.mean, nominal.nav, unit.dt * n_tick
    t = gravity(J4, nav[R], nav[R + 1], nav[R + 2])
    o = gravity(belief.gravity, nav[R], nav[R + 1], nav[R + 2])
    for i in range(3):
        lost = seconds * (t[i] - o[i])
        mean[VEL + i] += lost
        mean[POS + i] += 0.5 * seconds * lost
    now = unit.start + unit.dt * first
    for profile in range(unit.profile_sensor.shape[0]):
        at = vehicle.bias + 3 * unit.profile_sensor[profile]
        for axis in range(3):
            mean[at + axis] += profile_value(unit, profile, axis, now + seconds) - profile_value(
                unit, profile, axis, now
            )


@inlined
def _row(out, spread, desk, parts, signals, belief, epoch, channel, h, entries, columns, surprise, variance, noise,
         source, n_group, n_source):  # fmt: skip
    """Absorb one row of an epoch in the filter's covariance, and with that gain in all sources and in the mean."""
    K, n = desk.K[0], spread.mean.shape[0]
    _, weight = absorb(
        spread.formal, desk.x, K, h, entries, columns, 0.0, variance, np.inf, belief.n_estimated, belief.joseph
    )
    for i in range(n):
        desk.row_gain[0, i] = K[i] * weight if i < belief.n_estimated else 0.0
    sparse, at = np.zeros((1, columns.shape[0])), np.zeros((1, columns.shape[0]), np.int64)
    for c in range(columns.shape[0]):
        sparse[0, c], at[0, c] = h[entries[c]], columns[c]
    count = np.full(1, columns.shape[0])
    set_noise(desk.row_noise, source, 0, noise)
    for g in range(n_group):
        update_rows(
            group(spread.sources, g), desk.Y, group(desk.S, g), desk.row_gain, sparse, at, count,
            group(desk.row_noise, g),
        )  # fmt: skip
    set_noise(desk.row_noise, source, 0, 0.0)
    total = _total(desk.S, n_source, 0, 0)
    for p in range(parts.source.shape[0]):
        if not parts.followed[p]:
            continue
        update_rows_vector(spread.y[p], desk.seen, desk.row_gain, sparse, at, count)
        if parts.shared[p] < 0 or channel >= 6:
            continue
        for family in range(signals.shared.member.shape[0]):
            if signals.shared.member[family, channel] == parts.shared[p]:
                own = parts.family[family]
                known = signals.partial[own, epoch, channel] if own >= 0 else 0.0
                a = signals.shared.partial[family, epoch, channel] - known
                total += 2.0 * a * desk.seen[0] + _take_part(spread, p, a, desk.row_gain[0], parts)
    update_rows_vector(spread.mean, desk.seen, desk.row_gain, sparse, at, count)
    offset = desk.seen[0] + surprise
    for i in range(n):
        spread.mean[i] -= desk.row_gain[0, i] * surprise
    square = (total + offset * offset) * weight
    out.expected_nis[epoch] += square
    out.worst_ratio[epoch] = max(out.worst_ratio[epoch], square)
    out.n_row[epoch] += 1


@inlined
def _epoch(out, spread, desk, nominal, signals, belief, vehicle, parts, epoch, n_group, n_source):
    """Absorb the rows that the filter would absorb at an epoch."""
    if vehicle.modelled:
        out.expected_nis[epoch] += _expected_of_samples(desk, vehicle, n_source)
        out.n_row[epoch] += N_SAMPLE
    n_row = rows_at(belief, signals, epoch)
    if n_row > 0:
        for axis in range(3):
            nominal.solution[axis] = signals.position[epoch, axis]
            nominal.solution[3 + axis] = signals.velocity[epoch, axis]
        fill_loose(nominal, belief, signals, epoch)
    for row in range(n_row):
        k = belief.n_entry[row]
        _row(
            out, spread, desk, parts, signals, belief, epoch, row, nominal.H[row], belief.entry[row, :k],
            belief.column[row, :k], nominal.z[row], signals.variance[epoch, row], signals.sigma[epoch, row] ** 2,
            parts.row_source[row // 3], n_group, n_source,
        )  # fmt: skip
    for axis in range(3):
        _row(
            out, spread, desk, parts, signals, belief, epoch, 6 + axis, np.ones(1), np.zeros(1, np.int64),
            np.full(1, ATT + axis), 0.0, vehicle.believed, vehicle.sigma**2, parts.row_source[2], n_group, n_source,
        )  # fmt: skip


@jit
def _write(out, hist, spread, parts, n_source):
    n = spread.mean.shape[0]
    for i in range(n):
        out.mean[hist, i] = spread.mean[i]
        for j in range(i, n):
            total = 0.0
            for s in range(n_source):
                value = entry(spread.sources, s, i, j)
                out.sources[hist, s, i, j], out.sources[hist, s, j, i] = value, value
                total += value
            out.formal[hist, i, j], out.formal[hist, j, i] = spread.formal[i, j], spread.formal[i, j]
            out.true[hist, i, j], out.true[hist, j, i] = total, total
    for p in range(parts.source.shape[0]):
        if parts.sample[p] >= 0:
            out.sample_spread[hist, parts.source[p], parts.sample[p]] += spread.variance[p]


@jit
def cover_vehicle(
    out, spread, desk, nominal, schedule, unit, signals, belief, vehicle, parts, reference, n_group, n_source
):
    """Carry the filter's covariance, every source's and the mean over the nominal flight; `out` is filled.

    Parameters
    ----------
    out : Covered; spread : Spread at the start; desk : Desk; nominal : carried.Nominal; all updated
    schedule : Schedule; unit : Unit; signals : Signals; belief : Belief; vehicle : Vehicle; parts : Parts
    reference : Reference, the true motion; n_group, n_source : numbers of groups and sources
    """
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick, epoch = schedule.first_tick[w], schedule.n_tick[w], schedule.epoch[w]
        if n_tick > 0:
            if vehicle.modelled:
                _modelled_window(spread, desk, unit, vehicle, parts, reference, first, n_tick, n_group)
                take_nominal(nominal, reference, first)
            else:
                _mechanised_window(nominal, desk, unit, reference, first, n_tick, belief.gravity)
            _slow(spread, desk, nominal, parts, belief, vehicle.modelled, schedule.length[w], n_group, n_source)
            _move_mean(spread, nominal, unit, belief, vehicle, first, n_tick, reference)
        if epoch >= 0:
            take_nominal(nominal, reference, first + n_tick)
            for i in range(3):
                nominal.previous[i] = reference.dtheta[max(0, first + n_tick - 1), i]
            place_antenna(nominal, belief, unit.dt)
            _epoch(out, spread, desk, nominal, signals, belief, vehicle, parts, epoch, n_group, n_source)
        if schedule.hist[w] >= 0:
            _write(out, schedule.hist[w], spread, parts, n_source)
