"""The pass of linear covariance of a flight with an attitude reference: all sources at once, tick by tick.

The covariance of e (truth minus estimate) that each source puts there is one lane of a group of eight, because gains
and transition are the same for all of them. True rate and acceleration are the same in every run: what they change by
from tick to tick and the filter does not know moves the mean. A true parameter c that the filter's own state does not
follow exactly (another time constant, or no state at all) is carried with its covariance with e, y = Cov(e, c).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.sensing import profile_value
from lvnav_trade.engines.vehicle_carried import (
    add_to,
    entry,
    group,
    nominal_tick,
    nominal_window,
    set_noise,
    whole,
)
from lvnav_trade.filters.ekf import fill_loose, place_antenna, rows_at
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import absorb, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.strapdown import J4, R, gravity, place
from lvnav_trade.kernels.transition import POS, VEL
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

Ints = NDArray[np.int64]


@jit
def _total(S, n_source, r, q):
    total = 0.0
    for s in range(n_source):
        total += entry(S, s, r, q)
    return total


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
            group(spread.sources, g), whole(desk.Y), group(desk.S, g), desk.gain, rows, columns, entries,
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
    S, T = desk.expected, desk.turned
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            T[r, q] = 1.0 if q == r else 0.0
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
        nominal_tick(desk.sums, reference, tick, unit.dt)
        advance(spread.formal, desk.moved, desk.sums, unit.dt, vehicle.motion)
        for g in range(n_group):
            advance(group(spread.sources, g), whole(desk.moved_source), desk.sums, unit.dt, vehicle.motion)
        for p in range(parts.source.shape[0]):
            if parts.followed[p]:
                advance_vector(spread.y[p], desk.sums, unit.dt, vehicle.motion)
        advance_vector(spread.mean, desk.sums, unit.dt, vehicle.motion)


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
    predict(spread.formal, desk.D, rows, columns, decay, belief.noise[length], belief.clock, seconds)
    D = desk.D
    if not modelled:
        rows, columns, D = parts.nav_rows, parts.nav_columns, desk.D_true
        transition.fill(D, parts.nav_kinds, parts.nav_drivers, desk.sums, nav[R], nav[R + 1], nav[R + 2], seconds)
        _add_noise(spread.sources, parts.noise[length], n_source)
    for g in range(n_group):
        P = group(spread.sources, g)
        mirror(P)
        predict(P, D, rows, columns, decay, desk.work, belief.clock, seconds)
    if not modelled:
        _add_noise(spread.sources, parts.noise[length], n_source)
    apply_phi(spread.mean, D, rows, columns, decay, belief.clock, seconds)
    for p in range(parts.source.shape[0]):
        if parts.followed[p]:
            apply_phi(spread.y[p], D, rows, columns, decay, belief.clock, seconds)
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
    sparse, at, count = desk.sparse, desk.at, desk.n_at
    count[0] = columns.shape[0]
    for c in range(columns.shape[0]):
        sparse[0, c], at[0, c] = h[entries[c]], columns[c]
    set_noise(desk.row_noise, source, 0, noise)
    for g in range(n_group):
        update_rows(
            group(spread.sources, g), whole(desk.Y), group(desk.S, g), desk.row_gain, sparse, at, count,
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
    for axis in range(3 if vehicle.on[epoch] else 0):
        _row(
            out, spread, desk, parts, signals, belief, epoch, 6 + axis, desk.one, vehicle.entries,
            vehicle.columns[axis], 0.0, vehicle.believed, vehicle.sigma**2, parts.row_source[2], n_group, n_source,
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
                place(nominal.nav, reference, first)
            else:
                nominal_window(nominal, desk.sums, desk.increments, reference, first, n_tick, unit.dt, belief.gravity)
            _slow(spread, desk, nominal, parts, belief, vehicle.modelled, schedule.length[w], n_group, n_source)
            _move_mean(spread, nominal, unit, belief, vehicle, first, n_tick, reference)
        if epoch >= 0:
            place(nominal.nav, reference, first + n_tick)
            for i in range(3):
                nominal.previous[i] = reference.dtheta[max(0, first + n_tick - 1), i]
            place_antenna(nominal, None, belief, unit.dt)
            _epoch(out, spread, desk, nominal, signals, belief, vehicle, parts, epoch, n_group, n_source)
        if schedule.hist[w] >= 0:
            _write(out, schedule.hist[w], spread, parts, n_source)
