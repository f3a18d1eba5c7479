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
    k = 0
    sensed = own
    if OWN_0 <= driver and driver <= OWN_2:
        k = driver - OWN_0
    elif OTHER_0 <= driver and driver <= OTHER_2:
        k = (driver - OTHER_0 - c) % 3
        sensed = other
    direction = frames[c, k]
    value = direction[0] * sensed[0] + direction[1] * sensed[1] + direction[2] * sensed[2]
    return value * value if driver == SQUARE else value


@jit
def _fill_array_partials(a, true, units, tick, dt):
    """Set the partial derivatives of a sample of the combined triad with respect to the components of all IMUs."""
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            sensor = true.sensor[j]
            triad = true.triad[j]
            component = true.first[j]
            source = true.source[component]
            g = true.group[source]
            lane = true.lane[source]
            slot = true.slot[component]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, true.driver[j], tick, dt)
                for i in range(3):
                    share = lasting_share(units, tick, triad, sensor, i, c)
                    a[g, slot + c, 3 * sensor + i, lane] = share * u


@jit
def lasting_share(units, tick, triad, sensor, i, c):
    """Return the weight by which a lasting error of a sensing axis enters an axis of the combined triad at a tick.

    Parameters
    ----------
    units : ImuArray
    tick : index
    triad, sensor : triad; GYRO or ACCEL
    i, c : axis of the combined triad, sensing axis of the triad
    """
    stage = units.stage[tick]
    return units.solved[stage, triad, sensor, i, c] * units.noisy[stage, sensor, 0, i]


@jit
def tick_input(units, triad, sensor, c, driver, tick, dt):
    """Return the driver of an error parameter of a sensing axis in the sample of a tick.

    Parameters
    ----------
    units : ImuArray
    triad, sensor : triad; GYRO or ACCEL
    c : sensing axis
    driver : as in `kernels.transition`
    tick : index
    dt : s, of a tick
    """
    a = units.dtheta[triad, tick]
    f = units.dvel[triad, tick]
    angle = (a[0] / dt, a[1] / dt, a[2] / dt)
    force = (f[0] / dt, f[1] / dt, f[2] / dt)
    if sensor == GYRO:
        return unit_input(units.frames[triad], c, driver, angle, force)
    return unit_input(units.frames[triad], c, driver, force, angle)


@jit
def _add_array_profiles(z, true, unit, units, tick, t):
    """Add the deterministic errors (profiles) of all IMUs of an array to the deviation of a sample.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, updated in place
    true, unit, units : Components, ImuTruth, ImuArray
    tick : index
    t : s since lift-off, at the middle of the tick
    """
    stage = units.stage[tick]
    for j in range(true.sensor.shape[0]):
        profile = true.profile[j]
        if profile >= 0:
            sensor = true.sensor[j]
            triad = true.triad[j]
            solved = units.solved[stage, triad, sensor]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, true.driver[j], tick, unit.dt)
                value = u * profile_value(unit, profile, c, t)
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
        _fill_array_partials(a, true, units, tick, dt)


@jit
def _fill_partials(a, true, vehicle, tick):
    """Set the partial derivatives as `fill_partials` does, for one IMU."""
    rate = vehicle.rate[tick]
    force = vehicle.force[tick]
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            sensor = true.sensor[j]
            component = true.first[j]
            source = true.source[component]
            slot = true.slot[component]
            u = sensed_driver(sensor, true.driver[j], rate, force)
            for axis in range(3):
                a[true.group[source], slot + axis, 3 * sensor + axis, true.lane[source]] = u[axis]


@jit
def _add_profiles(z, true, unit, reference, tick, t):
    """Add the deterministic errors (profiles) of one IMU to the deviation of a sample.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, updated in place
    true, unit : Components, ImuTruth
    reference : Reference, true motion
    tick : index
    t : s since lift-off, at the middle of the tick
    """
    for j in range(true.sensor.shape[0]):
        profile = true.profile[j]
        if profile >= 0 and true.sampled[j]:
            sensor = true.sensor[j]
            increment = reference.dtheta[tick] if sensor == GYRO else reference.dvel[tick]
            for axis in range(3):
                u = 1.0 if true.driver[j] == CONSTANT else increment[axis] / unit.dt
                z[3 * sensor + axis] += u * profile_value(unit, profile, axis, t)


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
        _add_array_profiles(z, true, unit, units, tick, t)


@jit
def nominal_tick(sums, reference, tick, dt):
    """Set the integrals over a tick of the nominal flight.

    Parameters
    ----------
    sums : (12,) or longer; set to C_b_i (9, s) by the trapezoidal rule and velocity gained (3, m/s, frame i)
    reference : Reference, true motion
    tick : index
    dt : s, of a tick
    """
    q = reference.q_b_i[tick]
    q_end = reference.q_b_i[tick + 1]
    a = reference.dtheta[tick]
    f = reference.dvel[tick]
    c = matrix(q[0], q[1], q[2], q[3])
    c_end = matrix(q_end[0], q_end[1], q_end[2], q_end[3])
    # velocity gained in the axes at the start of the tick: f + a x f / 2
    rx, ry, rz = cross(a[0], a[1], a[2], f[0], f[1], f[2])
    gx = f[0] + 0.5 * rx
    gy = f[1] + 0.5 * ry
    gz = f[2] + 0.5 * rz
    for i in range(3):
        row = 3 * i
        for j in range(3):
            sums[row + j] = 0.5 * dt * (c[row + j] + c_end[row + j])
        sums[9 + i] = c[row] * gx + c[row + 1] * gy + c[row + 2] * gz


@jit
def begin_tick(joint, motion, vehicle, tick):
    """Set the estimated motion of a tick to the true motion, and the Jacobian of its samples (Joint, or None).

    The filter predicts the motion of the tick before, so the change of motion since then enters the mean error.
    """
    if joint is not None:
        rate = vehicle.rate
        force = vehicle.force
        mean = joint.state.mean
        first = vehicle.motion
        if tick > 0:
            for i in range(3):
                mean[first + i] += rate[tick, i] - rate[tick - 1, i]
                mean[first + 3 + i] += force[tick, i] - force[tick - 1, i]
        fill_samples(motion.h, vehicle.blocks, rate[tick], force[tick])


@jit
def _enter_component(P, y, through, seen, S, a, variance, gain):
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
        partials = group(ticks.a, g)
        seen = whole(ticks.seen_source)
        through = whole(ticks.through)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                update_vector_together(cross_g[k], seen, gain, h, columns)
                if true.samples[g, k]:
                    _enter_component(P, cross_g[k], through, seen, S, partials[k], variance[k, 0], gain)


@jit
def _record(tape, gain, tick):
    """Record the gain of a tick on the tape, if a backward pass is requested."""
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
    state, ticks, true = joint.state, flight.ticks, joint.true
    h = motion.h
    columns = vehicle.columns
    mean = state.mean
    gain = ticks.gain
    deviation = ticks.deviation
    deviations(deviation, true, flight.unit, units, flight.reference, tick)
    joint_gain(gain, motion.K, motion.weight, h, columns, model.n_estimated)
    _record(joint.tape, gain, tick)
    fill_partials(ticks.a, true, units, vehicle, tick, flight.unit.dt)
    _update_sources(state, ticks, true, h, columns)
    update_vector_together(mean, ticks.seen, gain, h, columns)
    for r in range(N_SAMPLE):
        ticks.seen[r] += deviation[r]
        for i in range(model.n_state):
            mean[i] -= gain[r, i] * deviation[r]


@jit
def advance_joint(joint, flight, sums, dt, first):
    """Propagate every source and the mean over a tick.

    Parameters
    ----------
    joint, flight : Joint, updated in place, or None; NominalFlight
    sums : (18,) integrals of the strapdown over the tick
    dt : s, of the tick
    first : first motion state
    """
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
