"""Samples of the IMU in the joint covariance: how its errors enter them, update and propagation of a tick."""

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, like, whole
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.transition import CONSTANT, GYRO, OTHER_0, OTHER_2, OWN_0, OWN_2, SQUARE, sensed_driver
from lvnav_trade.kernels.vehicle import (
    N_SAMPLE,
    advance,
    advance_vector,
    fill_samples,
    joint_gain,
    mirror,
    update_together,
    update_vector_together,
)


@jit
def unit_input(frames, c, driver, own, other):
    """Return the driver of an error parameter of sensing axis c.

    Parameters
    ----------
    frames : (3, 3, 3) direction and misalignment directions of each axis, body axes
    c : sensing axis
    driver : as in `kernels.transition`
    own, other : (3,) inputs of the sensor itself and of the other sensor, body axes
    """
    if driver < 0 or driver == CONSTANT:
        return 1.0
    k, along = 0, own
    if OWN_0 <= driver and driver <= OWN_2:
        k = driver - OWN_0
    elif OTHER_0 <= driver and driver <= OTHER_2:
        k = (driver - OTHER_0 - c) % 3
        along = other
    value = frames[c, k, 0] * along[0] + frames[c, k, 1] * along[1] + frames[c, k, 2] * along[2]
    return value * value if driver == SQUARE else value


@jit
def _fill_partials_of_array(a, true, units, tick, dt):
    """Set the partial derivatives of a sample of the combined triad with respect to the components of all IMUs."""
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            sensor = true.sensor[j]
            triad = true.triad[j]
            component = true.first[j]
            source = true.source[component]
            k = true.slot[component]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, true.driver[j], tick, dt)
                for i in range(3):
                    entering = lasting_share(units, tick, triad, sensor, i, c) * u
                    a[true.group[source], k + c, 3 * sensor + i, true.lane[source]] = entering


@jit
def lasting_share(units, tick, triad, sensor, i, c):
    """Return the weight by which a lasting error of sensing axis c enters axis i of the combined triad at a tick."""
    stage = units.stage[tick]
    return units.solved[stage, triad, sensor, i, c] * units.noisy[stage, sensor, 0, i]


@jit
def tick_input(units, triad, sensor, c, driver, tick, dt):
    """Return the driver of an error parameter of sensing axis c in the sample of a tick."""
    a = units.dtheta[triad, tick]
    f = units.dvel[triad, tick]
    angle = (a[0] / dt, a[1] / dt, a[2] / dt)
    force = (f[0] / dt, f[1] / dt, f[2] / dt)
    if sensor == GYRO:
        return unit_input(units.frames[triad], c, driver, angle, force)
    return unit_input(units.frames[triad], c, driver, force, angle)


@jit
def _add_profiles_of_array(z, true, unit, units, tick, t):
    """Add the deterministic errors (profiles) of all IMUs of an array to the deviation (6,) of a sample."""
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0:
            for c in range(3):
                sensor = true.sensor[j]
                solved = units.solved[units.stage[tick], true.triad[j], true.sensor[j]]
                u = tick_input(units, true.triad[j], sensor, c, true.driver[j], tick, unit.dt)
                value = u * profile_value(unit, true.profile[j], c, t)
                for i in range(3):
                    z[3 * sensor + i] += solved[i, c] * value


@jit
def fill_partials(a, true, units, vehicle, tick, dt):
    """Set the partial derivatives of the samples of a tick with respect to components that no filter state models.

    Parameters
    ----------
    a : (n_group, n_slot, 6) in lanes, set here
    true : Components
    units : ImuArray; None for one IMU
    vehicle : VehicleModel
    tick, dt : index; s
    """
    if units is None:
        _fill_partials(a, true, vehicle, tick)
    else:
        _fill_partials_of_array(a, true, units, tick, dt)


@jit
def _fill_partials(a, true, vehicle, tick):
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            u = sensed_driver(true.sensor[j], true.driver[j], vehicle.rate[tick], vehicle.force[tick])
            source = true.source[true.first[j]]
            k = true.slot[true.first[j]]
            for axis in range(3):
                a[true.group[source], k + axis, 3 * true.sensor[j] + axis, true.lane[source]] = u[axis]


@jit
def _add_profiles(z, true, unit, reference, tick, t):
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 and true.sampled[j]:
            first = 3 * true.sensor[j]
            increment = reference.dtheta[tick] if true.sensor[j] == GYRO else reference.dvel[tick]
            for axis in range(3):
                u = 1.0 if true.driver[j] == CONSTANT else increment[axis] / unit.dt
                z[first + axis] += u * profile_value(unit, true.profile[j], axis, t)


@jit
def deviations(z, true, unit, units, reference, tick):
    """Set the deterministic errors of the samples of a tick: bandwidth, unsensed axes, and profiles without a state.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, set here
    true, unit : Components, ImuTruth
    units : ImuArray; None for one IMU
    reference : Reference, true motion
    tick : index
    """
    for i in range(3):
        z[i] = (unit.dtheta[tick, i] - reference.dtheta[tick, i]) / unit.dt
        z[3 + i] = (unit.dvel[tick, i] - reference.dvel[tick, i]) / unit.dt
    t = unit.start + unit.dt * (tick + 0.5)
    if units is None:
        _add_profiles(z, true, unit, reference, tick, t)
    else:
        _add_profiles_of_array(z, true, unit, units, tick, t)


@jit
def nominal_tick(sums, reference, tick, dt):
    """Set the integrals over a tick of the nominal flight: C_b_i (9) by the trapezoidal rule, velocity gained (3)."""
    q = reference.q_b_i[tick]
    p = reference.q_b_i[tick + 1]
    a = reference.dtheta[tick]
    f = reference.dvel[tick]
    c = matrix(q[0], q[1], q[2], q[3])
    d = matrix(p[0], p[1], p[2], p[3])
    receiver, ry, rz = cross(a[0], a[1], a[2], f[0], f[1], f[2])
    for i in range(3):
        for j in range(3):
            sums[3 * i + j] = 0.5 * dt * (c[3 * i + j] + d[3 * i + j])
        sums[9 + i] = (
            c[3 * i] * (f[0] + 0.5 * receiver) + c[3 * i + 1] * (f[1] + 0.5 * ry) + c[3 * i + 2] * (f[2] + 0.5 * rz)
        )


@jit
def begin_tick(joint, motion, vehicle, tick):
    """Set the estimated motion of a tick to the true motion, and the Jacobian of its samples (Joint, or None).

    The filter predicts the motion of the tick before, so the change of motion since then enters the mean error.
    """
    if joint is not None:
        first = vehicle.motion
        mean = joint.state.mean
        for i in range(3):
            if tick > 0:
                mean[first + i] += vehicle.rate[tick, i] - vehicle.rate[tick - 1, i]
                mean[first + 3 + i] += vehicle.force[tick, i] - vehicle.force[tick - 1, i]
        fill_samples(motion.h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])


@jit
def _enter_by_samples(P, y, through, seen, S, a, variance, gain):
    """Add the effect of components c, one per lane, on the update by the samples of a tick.

    Parameters
    ----------
    P : (n, n) upper triangle, updated in place
    y : (n,) Cov(x, c) after the update by H, updated in place
    through, seen : (n,) scratch; (6,) H Cov(x, c) before the update
    S : (6, 6) innovation covariance, updated in place
    a : (6,) partial derivatives of the samples
    variance, gain : variance of c; (6, n) joint gain
    """
    n = P.shape[0]
    for i in range(n):
        total = like(y[0], 0.0)
        for r in range(N_SAMPLE):
            total = total + gain[r, i] * a[r]
        through[i] = total
    half = 0.5 * variance
    for i in range(n):
        t = through[i]
        u = y[i] - half * through[i]
        for j in range(i, n):
            P[i, j] = P[i, j] - (t * (y[j] - half * through[j]) + u * through[j])
    for i in range(n):
        y[i] = y[i] - through[i] * variance
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            S[r, q] = S[r, q] + a[r] * seen[q] + seen[r] * a[q] + a[r] * a[q] * variance


@jit
def _update_sources(state, ticks, true, h, columns):
    """Update the covariance of every source, and its cross covariances, by the samples of a tick with `ticks.gain`."""
    gain = ticks.gain
    for g in range(true.n_slot.shape[0]):
        P = group(state.sources, g)
        S = group(ticks.S, g)
        update_together(P, whole(ticks.Y), S, gain, h, columns, group(ticks.noise, g))
        cross_g = group(state.cross, g)
        variance = group(state.variance, g)
        seen = whole(ticks.seen_source)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                update_vector_together(cross_g[k], seen, gain, h, columns)
                if true.samples[g, k]:
                    a = group(ticks.a, g)[k]
                    _enter_by_samples(P, cross_g[k], whole(ticks.through), seen, S, a, variance[k, 0], gain)


@jit
def _record(tape, gain, tick):
    if tape.sample_gain.shape[0] > 0:
        for r in range(N_SAMPLE):
            for i in range(gain.shape[1]):
                tape.sample_gain[tick, r, i] = gain[r, i]


@jit
def update_joint_tick(joint, flight, motion, model, vehicle, units, tick):
    """Update every source and the mean with the joint gain by which the filter has processed the samples of a tick.

    Parameters
    ----------
    joint, flight : Joint, NominalFlight
    motion : ImuSampleWork, with P h' and weights of the filter's update
    model, vehicle : FilterModel, VehicleModel
    units : ImuArray; None for one IMU
    tick : index
    """
    state, ticks, true, unit, h = joint.state, flight.ticks, joint.true, flight.unit, motion.h
    mean, gain = state.mean, ticks.gain
    deviations(ticks.deviation, true, unit, units, flight.reference, tick)
    joint_gain(gain, motion.K, motion.weight, h, vehicle.columns, model.n_estimated)
    _record(joint.tape, gain, tick)
    fill_partials(ticks.a, true, units, vehicle, tick, unit.dt)
    _update_sources(state, ticks, true, h, vehicle.columns)
    update_vector_together(mean, ticks.seen, gain, h, vehicle.columns)
    for r in range(N_SAMPLE):
        ticks.seen[r] += ticks.deviation[r]
        for i in range(model.n_state):
            mean[i] -= gain[r, i] * ticks.deviation[r]


@jit
def advance_joint(joint, flight, sums, dt, first):
    """Propagate every source and the mean (Joint, or None) over a tick. first : first motion state."""
    if joint is not None:
        state, true = joint.state, joint.true
        for g in range(true.n_slot.shape[0]):
            advance(group(state.sources, g), whole(flight.ticks.moved_source), sums, dt, first)
            cross_g = group(state.cross, g)
            for k in range(true.n_slot[g]):
                if true.followed[g, k]:
                    advance_vector(cross_g[k], sums, dt, first)
        advance_vector(state.mean, sums, dt, first)


@jit
def finish_ticks(joint):
    """Restore the lower triangles of the covariances of all sources (Joint, or None) at the end of a window."""
    if joint is not None:
        for g in range(joint.true.n_slot.shape[0]):
            mirror(group(joint.state.sources, g))
