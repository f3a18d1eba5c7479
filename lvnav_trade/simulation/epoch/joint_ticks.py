"""Samples of the IMU in the joint covariance: how its errors enter them, update and propagation of a tick."""

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, group_view, number_like
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
def unit_input(frames, c, driver, own_input, other_input):
    """Return the driver of an error parameter of sensing axis c.

    Parameters
    ----------
    frames : (3, 3, 3) direction and misalignment directions of each axis, body axes
    c : sensing axis
    driver : as in `kernels.transition`
    own_input, other_input : (3,) inputs of the sensor itself and of the other sensor, body axes
    """
    if driver < 0 or driver == CONSTANT:
        return 1.0
    k = 0
    sensor_input = own_input
    if OWN_0 <= driver and driver <= OWN_2:
        k = driver - OWN_0
    elif OTHER_0 <= driver and driver <= OTHER_2:
        k = (driver - OTHER_0 - c) % 3
        sensor_input = other_input
    direction = frames[c, k]
    value = direction[0] * sensor_input[0] + direction[1] * sensor_input[1] + direction[2] * sensor_input[2]
    return value * value if driver == SQUARE else value


@jit
def _fill_array_partials(a, components, units, tick, dt):
    """Set the partial derivatives of a sample of the combined triad with respect to the components of all IMUs."""
    for j in range(components.sensor.shape[0]):
        if components.block_enters_samples[j] and components.profile[j] < 0:
            sensor = components.sensor[j]
            triad = components.triad[j]
            component = components.first[j]
            source = components.source[component]
            g = components.group[source]
            lane = components.lane[source]
            slot = components.slot[component]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, components.driver[j], tick, dt)
                for i in range(3):
                    share = lasting_share(units, tick, triad, sensor, i, c)
                    sample = 3 * sensor + i
                    a[g, slot + c, sample, lane] = share * u


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
    weight = units.axis_weights[stage, triad, sensor, i, c]
    lasting_factor = units.error_factors[stage, sensor, 0, i]
    return weight * lasting_factor


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
    rate = (a[0] / dt, a[1] / dt, a[2] / dt)
    force = (f[0] / dt, f[1] / dt, f[2] / dt)
    frames = units.frames[triad]
    if sensor == GYRO:
        return unit_input(frames, c, driver, rate, force)
    return unit_input(frames, c, driver, force, rate)


@jit
def _add_array_profiles(z, components, unit, units, tick, t):
    """Add the deterministic errors (profiles) of all IMUs of an array to the deviation of a sample.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, updated in place
    components, unit, units : Components, ImuTruth, ImuArray
    tick : index
    t : s since lift-off, at the middle of the tick
    """
    stage = units.stage[tick]
    for j in range(components.sensor.shape[0]):
        profile = components.profile[j]
        if profile >= 0:
            sensor = components.sensor[j]
            triad = components.triad[j]
            axis_weights = units.axis_weights[stage, triad, sensor]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, components.driver[j], tick, unit.dt)
                parameter = profile_value(unit, profile, c, t)
                value = u * parameter
                for i in range(3):
                    z[3 * sensor + i] += axis_weights[i, c] * value


@jit
def fill_partials(a, components, units, vehicle, tick, dt):
    """Set the partial derivatives of the samples of a tick with respect to components that no filter state models.

    Parameters
    ----------
    a : (n_group, n_slot, 6) in lanes, set here
    components : Components
    units : ImuArray; None for one IMU
    vehicle : VehicleModel
    tick, dt : index; s
    """
    if units is None:
        _fill_partials(a, components, vehicle, tick)
    else:
        _fill_array_partials(a, components, units, tick, dt)


@jit
def _fill_partials(a, components, vehicle, tick):
    """Set the partial derivatives as `fill_partials` does, for one IMU."""
    rate = vehicle.rate[tick]
    force = vehicle.force[tick]
    for j in range(components.sensor.shape[0]):
        if components.block_enters_samples[j] and components.profile[j] < 0:
            sensor = components.sensor[j]
            component = components.first[j]
            source = components.source[component]
            slot = components.slot[component]
            g = components.group[source]
            lane = components.lane[source]
            u = sensed_driver(sensor, components.driver[j], rate, force)
            for axis in range(3):
                sample = 3 * sensor + axis
                a[g, slot + axis, sample, lane] = u[axis]


@jit
def _add_profiles(z, components, unit, reference, tick, t):
    """Add the deterministic errors (profiles) of one IMU to the deviation of a sample.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, updated in place
    components, unit : Components, ImuTruth
    reference : Reference, true motion
    tick : index
    t : s since lift-off, at the middle of the tick
    """
    for j in range(components.sensor.shape[0]):
        profile = components.profile[j]
        if profile >= 0 and components.block_enters_samples[j]:
            sensor = components.sensor[j]
            increment = reference.dtheta[tick] if sensor == GYRO else reference.dvel[tick]
            driver = components.driver[j]
            first = 3 * sensor
            for axis in range(3):
                u = 1.0 if driver == CONSTANT else increment[axis] / unit.dt
                parameter = profile_value(unit, profile, axis, t)
                z[first + axis] += u * parameter


@jit
def deviations(z, components, unit, units, reference, tick):
    """Set the deterministic errors of the samples of a tick: bandwidth, unsensed axes, and profiles without a state.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, set here
    components, unit : Components, ImuTruth
    units : ImuArray; None for one IMU
    reference : Reference, true motion
    tick : index
    """
    dt = unit.dt
    sensed_angle = unit.dtheta[tick]
    sensed_velocity = unit.dvel[tick]
    true_angle = reference.dtheta[tick]
    true_velocity = reference.dvel[tick]
    for i in range(3):
        z[i] = (sensed_angle[i] - true_angle[i]) / dt
        z[3 + i] = (sensed_velocity[i] - true_velocity[i]) / dt
    t = unit.start + unit.dt * (tick + 0.5)
    if units is None:
        _add_profiles(z, components, unit, reference, tick, t)
    else:
        _add_array_profiles(z, components, unit, units, tick, t)


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
    fx = f[0]
    fy = f[1]
    fz = f[2]
    # velocity gained in the axes at the start of the tick: f + a x f / 2
    rx, ry, rz = cross(a[0], a[1], a[2], fx, fy, fz)
    gx = fx + 0.5 * rx
    gy = fy + 0.5 * ry
    gz = fz + 0.5 * rz
    half_tick = 0.5 * dt
    for i in range(3):
        row = 3 * i
        for j in range(3):
            entry = row + j
            sums[entry] = half_tick * (c[entry] + c_end[entry])
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
            previous = tick - 1
            for i in range(3):
                rate_change = rate[tick, i] - rate[previous, i]
                force_change = force[tick, i] - force[previous, i]
                mean[first + i] += rate_change
                mean[first + 3 + i] += force_change
        fill_samples(motion.h, vehicle.blocks, rate[tick], force[tick])


@jit
def _enter_component(P, y, state_effect, component_covariance, S, a, variance, gain):
    """Add the effect of components c, one per lane, on the update by the samples of a tick.

    Parameters
    ----------
    P : (n, n) upper triangle, updated in place
    y : (n,) Cov(x, c) after the update by H, updated in place
    state_effect, component_covariance : (n,) scratch; (6,) H Cov(x, c) before the update
    S : (6, 6) innovation covariance, updated in place
    a : (6,) partial derivatives of the samples
    variance, gain : variance of c; (6, n) joint gain
    """
    n = P.shape[0]
    for i in range(n):
        total = number_like(y[0], 0.0)
        for r in range(N_SAMPLE):
            total = total + gain[r, i] * a[r]
        state_effect[i] = total
    half = 0.5 * variance
    for i in range(n):
        t = state_effect[i]
        u = y[i] - half * t
        for j in range(i, n):
            t_j = state_effect[j]
            u_j = y[j] - half * t_j
            reduction = t * u_j + u * t_j
            P[i, j] = P[i, j] - reduction
    for i in range(n):
        y[i] = y[i] - state_effect[i] * variance
    for r in range(N_SAMPLE):
        a_r = a[r]
        covariance_r = component_covariance[r]
        for q in range(N_SAMPLE):
            a_q = a[q]
            S[r, q] = S[r, q] + a_r * component_covariance[q] + covariance_r * a_q + a_r * a_q * variance


@jit
def _update_sources(state, ticks, components, h, columns):
    """Update the covariance of every source, and its cross covariances, by the samples of a tick with `ticks.gain`."""
    gain = ticks.gain
    for g in range(components.n_slot.shape[0]):
        P = group(state.sources, g)
        S = group(ticks.S, g)
        update_together(P, group_view(ticks.Y), S, gain, h, columns, group(ticks.noise, g))
        cross_g = group(state.cross, g)
        variance = group(state.variance, g)
        partials = group(ticks.a, g)
        component_covariance = group_view(ticks.innovation_covariance)
        state_effect = group_view(ticks.state_effect)
        for k in range(components.n_slot[g]):
            if components.has_cross[g, k]:
                cross_k = cross_g[k]
                update_vector_together(cross_k, component_covariance, gain, h, columns)
                if components.enters_samples[g, k]:
                    _enter_component(
                        P, cross_k, state_effect, component_covariance, S, partials[k], variance[k, 0], gain
                    )


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
    state = joint.state
    ticks = flight.ticks
    components = joint.components
    h = motion.h
    columns = vehicle.columns
    mean = state.mean
    gain = ticks.gain
    deviation = ticks.deviation
    deviations(deviation, components, flight.unit, units, flight.reference, tick)
    joint_gain(gain, motion.K, motion.weight, h, columns, model.n_estimated)
    _record(joint.tape, gain, tick)
    fill_partials(ticks.a, components, units, vehicle, tick, flight.unit.dt)
    _update_sources(state, ticks, components, h, columns)
    update_vector_together(mean, ticks.innovation_mean, gain, h, columns)
    for r in range(N_SAMPLE):
        sample_deviation = deviation[r]
        ticks.innovation_mean[r] += sample_deviation
        for i in range(model.n_state):
            mean[i] -= gain[r, i] * sample_deviation


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
        state = joint.state
        components = joint.components
        for g in range(components.n_slot.shape[0]):
            P = group(state.sources, g)
            covariance_change = group_view(flight.ticks.covariance_change)
            advance(P, covariance_change, sums, dt, first)
            cross_g = group(state.cross, g)
            for k in range(components.n_slot[g]):
                if components.has_cross[g, k]:
                    advance_vector(cross_g[k], sums, dt, first)
        advance_vector(state.mean, sums, dt, first)


@jit
def finish_ticks(joint):
    """Restore the lower triangles of the covariances of all sources (Joint, or None) at the end of a window."""
    if joint is not None:
        for g in range(joint.components.n_slot.shape[0]):
            mirror(group(joint.state.sources, g))
