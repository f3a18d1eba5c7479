"""Samples of the IMU as measurements, in the joint covariance: update and propagation of a tick, source by source."""

from lvnav_trade.engines.lincov.units import add_unit_profiles, fill_unit_partials
from lvnav_trade.engines.simulate.sensing import profile_value
from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.groups import group, whole
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.transition import CONSTANT, GYRO, sensed_driver
from lvnav_trade.kernels.vehicle import (
    N_SAMPLE,
    advance,
    advance_vector,
    fill_samples,
    joint_gain,
    mirror,
    update_samples,
    update_together,
    update_vector_together,
)


@jit
def nominal_tick(sums, reference, tick, dt):
    """Set the integral of C_b_i, by the trapezoidal rule, and the velocity gained over a tick of the nominal flight."""
    q, p, a, f = reference.q_b_i[tick], reference.q_b_i[tick + 1], reference.dtheta[tick], reference.dvel[tick]
    c, d = matrix(q[0], q[1], q[2], q[3]), matrix(p[0], p[1], p[2], p[3])
    rx, ry, rz = cross(a[0], a[1], a[2], f[0], f[1], f[2])
    for i in range(3):
        for j in range(3):
            sums[3 * i + j] = 0.5 * dt * (c[3 * i + j] + d[3 * i + j])
        sums[9 + i] = c[3 * i] * (f[0] + 0.5 * rx) + c[3 * i + 1] * (f[1] + 0.5 * ry) + c[3 * i + 2] * (f[2] + 0.5 * rz)


@jit
def fill_partials(a, true, units, vehicle, tick, dt):
    """Set how components of one unit, or of a set (Units), enter the samples of a tick, where no state of the filter
    stands for them.
    """
    if units is None:
        _fill_partials(a, true, vehicle, tick)
    else:
        fill_unit_partials(a, true, units, tick, dt)


@jit
def _fill_partials(a, true, vehicle, tick):
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            u = sensed_driver(true.sensor[j], true.driver[j], vehicle.rate[tick], vehicle.force[tick])
            source, k = true.source[true.first[j]], true.slot[true.first[j]]
            for axis in range(3):
                a[true.group[source], k + axis, 3 * true.sensor[j] + axis, true.lane[source]] = u[axis]


@jit
def _add_profiles(z, true, unit, reference, tick, t):
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 and true.sampled[j]:
            first = 3 * true.sensor[j]
            own = reference.dtheta[tick] if true.sensor[j] == GYRO else reference.dvel[tick]
            for axis in range(3):
                u = 1.0 if true.driver[j] == CONSTANT else own[axis] / unit.dt
                z[first + axis] += u * profile_value(unit, true.profile[j], axis, t)


@jit
def _deviations(z, true, unit, units, reference, tick):
    """Set what the samples hold in every run beyond the truth: bandwidth, what sensing elements lack, and profiles that
    no state stands for.
    """
    for i in range(3):
        z[i] = (unit.dtheta[tick, i] - reference.dtheta[tick, i]) / unit.dt
        z[3 + i] = (unit.dvel[tick, i] - reference.dvel[tick, i]) / unit.dt
    t = unit.start + unit.dt * (tick + 0.5)
    if units is None:
        _add_profiles(z, true, unit, reference, tick, t)
    else:
        add_unit_profiles(z, true, unit, units, tick, t)


@jit
def _enter(P, y, through, seen, S, a, variance, gain):
    """Let components c, a lane each, enter by the samples: a (6,) partials, y = Cov(x, c) after the update by H."""
    n = P.shape[0]
    for i in range(n):
        total = like(y[0], 0.0)
        for r in range(N_SAMPLE):
            total = total + gain[r, i] * a[r]
        through[i] = total
    half = 0.5 * variance
    for i in range(n):
        t, u = through[i], y[i] - half * through[i]
        for j in range(i, n):
            P[i, j] = P[i, j] - (t * (y[j] - half * through[j]) + u * through[j])
    for i in range(n):
        y[i] = y[i] - through[i] * variance
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            S[r, q] = S[r, q] + a[r] * seen[q] + seen[r] * a[q] + a[r] * a[q] * variance


@jit
def _update_sources(joint, work, true, columns):
    h, gain = work.h, work.gain
    for g in range(true.n_slot.shape[0]):
        P, S = group(joint.sources, g), group(work.S, g)
        update_together(P, whole(work.Y), S, gain, h, columns, group(work.noise, g))
        cross_g, variance = group(joint.cross, g), group(joint.variance, g)
        seen = whole(work.seen_source)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                update_vector_together(cross_g[k], seen, gain, h, columns)
                if true.samples[g, k]:
                    a = group(work.a, g)[k]
                    _enter(P, cross_g[k], whole(work.through), seen, S, a, variance[k, 0], gain)


@jit
def update_tick(joint, scratch, work, tape, true, unit, units, model, vehicle, reference, tick):
    """Update by the samples of a tick: the filter's covariance, and with those gains every source and the mean."""
    m, mean, n = vehicle.motion, joint.mean, model.n_state
    for i in range(3):
        if tick > 0:
            mean[m + i] += vehicle.rate[tick, i] - vehicle.rate[tick - 1, i]
            mean[m + 3 + i] += vehicle.force[tick, i] - vehicle.force[tick - 1, i]
    _deviations(work.deviation, true, unit, units, reference, tick)
    for i in range(N_SAMPLE):
        joint.formal[m + i, m + i] += vehicle.walk[tick, i]
    fill_samples(work.h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
    update_samples(
        joint.formal, scratch.x, work.K, work.weight, work.residual, work.still, vehicle.variance, work.h,
        vehicle.columns, model.n_estimated,
    )  # fmt: skip
    joint_gain(work.gain, work.K, work.weight, work.h, vehicle.columns, model.n_estimated)
    if tape.sample_gain.shape[0] > 0:
        for r in range(N_SAMPLE):
            for i in range(n):
                tape.sample_gain[tick, r, i] = work.gain[r, i]
    fill_partials(work.a, true, units, vehicle, tick, unit.dt)
    _update_sources(joint, work, true, vehicle.columns)
    update_vector_together(mean, work.seen, work.gain, work.h, vehicle.columns)
    for r in range(N_SAMPLE):
        work.seen[r] += work.deviation[r]
        for i in range(n):
            mean[i] -= work.gain[r, i] * work.deviation[r]


@jit
def propagate_tick(joint, work, true, vehicle, reference, tick, dt):
    """Propagate over a tick what its motion states move."""
    nominal_tick(work.sums, reference, tick, dt)
    advance(joint.formal, work.moved, work.sums, dt, vehicle.motion)
    for g in range(true.n_slot.shape[0]):
        advance(group(joint.sources, g), whole(work.moved_source), work.sums, dt, vehicle.motion)
        cross_g = group(joint.cross, g)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                advance_vector(cross_g[k], work.sums, dt, vehicle.motion)
    advance_vector(joint.mean, work.sums, dt, vehicle.motion)


@jit
def sample_window(joint, scratch, work, tape, true, unit, units, model, vehicle, reference, first, n_tick):
    """Process the samples of a window, tick by tick; the covariances are whole again at its end."""
    for tick in range(first, first + n_tick):
        update_tick(joint, scratch, work, tape, true, unit, units, model, vehicle, reference, tick)
        propagate_tick(joint, work, true, vehicle, reference, tick, unit.dt)
    mirror(joint.formal)
    for g in range(true.n_slot.shape[0]):
        mirror(group(joint.sources, g))


@jit
def expected_of_samples(work, true, vehicle):
    """Return the expected sum of squares of the normalised innovations of the last tick's samples."""
    S, T, h, columns, total = work.expected, work.turned, work.h, vehicle.columns, 0.0
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            T[r, q] = 1.0 if q == r else 0.0
            S[r, q] = work.seen[r] * work.seen[q]
            for source in range(true.group.shape[0]):
                S[r, q] += work.S[true.group[source], r, q, true.lane[source]]
    # samples are processed one after the other: innovation r is T_r z with what those before it have taken off
    for r in range(N_SAMPLE):
        for q in range(r):
            seen = 0.0
            for k in range(columns.shape[1]):
                seen += h[r, k] * work.K[q, columns[r, k]]
            factor = seen * work.weight[q]
            for k in range(N_SAMPLE):
                T[r, k] -= factor * T[q, k]
        value = 0.0
        for k in range(N_SAMPLE):
            for q in range(N_SAMPLE):
                value += T[r, k] * S[k, q] * T[r, q]
        total += value * work.weight[r]
    return total
