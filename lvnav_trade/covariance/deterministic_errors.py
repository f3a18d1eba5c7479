"""Deterministic errors of a window in the mean of the joint states: profiles, sensed increments, gravity, strapdown."""

from lvnav_trade.covariance.component_inputs import N_NAV, block_input
from lvnav_trade.kernels.attitude import cross, matrix, rotate, small_rotation
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.strapdown import J4, Q, R, V, gravity
from lvnav_trade.kernels.transition import ATT, POS, VEL


@jit
def advance_profiles(joint, unit, units, model, sums, schedule, w):
    """Add the effect of deterministic profiles over window w to the mean.

    If a filter state models the bias, only the change of the profile acts. If IMU samples are measurements and no state
    models the bias, it enters by the samples.
    """
    state = joint.state
    scratch = joint.scratch
    components = joint.components
    length_index = schedule.length_index[w]
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[length_index]
    decay = components.state_decay[length_index]
    g = scratch.state_effect
    middle = unit.start + unit.dt * (first + 0.5 * n_tick)
    for j in range(components.sensor.shape[0]):
        profile = components.profile[j]
        filter_state = components.filter_state[j]
        if profile < 0:
            continue
        if components.block_drives_motion[j]:
            block_input(scratch, j, components, units, sums, seconds, first, n_tick)
        for axis in range(3):
            value = profile_value(unit, profile, axis, middle)
            change = value - state.profile[profile, axis]
            state.profile[profile, axis] = value
            if filter_state >= 0:
                bias_state = filter_state + axis
                for i in range(g.shape[0]):
                    g[i] = 0.0
                g[bias_state] = 1.0
                # the value is the mean over the window, so a change acts from the start of the window
                apply_phi(g, scratch.D_true, components.nav_rows, components.nav_columns, decay, model.clock, seconds)
                extra = 1.0 - decay[bias_state]  # the filter's state decays, the profile does not
                for i in range(g.shape[0]):
                    state.mean[i] += g[i] * change
                state.mean[bias_state] += extra * value
            elif components.block_drives_motion[j]:
                for i in range(N_NAV):
                    state.mean[i] += scratch.input[i, axis] * value


@jit
def set_deviation(deviation, unit, nav, model, first, n_tick, reference):
    """Set the deterministic errors of a window: effect of sensed minus true increments, and error of the gravity model.

    Increments are rotated one by one, because a spinning or vibrating vehicle rotates far within a window. In a tick,
    att+ = att + C da, vel+ = vel + C df + (att + C da / 2) x C f, with sensed minus true increments da and df.

    Parameters
    ----------
    deviation : (12,) set here: error in attitude, velocity and position (9), frame i; true minus modelled gravitation
        (3) m/s^2
    unit, reference : ImuTruth with sensed increments, Reference with true increments
    nav, model : (10,) navigation state; FilterModel
    first, n_tick : first tick, number of ticks
    """
    for i in range(12):
        deviation[i] = 0.0
    d = deviation
    dt = unit.dt
    for k in range(first, first + n_tick):
        angle = reference.dtheta[k]
        velocity = reference.dvel[k]
        q = reference.q_b_i[k]
        sensed_angle = unit.dtheta[k]
        sensed_velocity = unit.dvel[k]
        c = matrix(q[0], q[1], q[2], q[3])
        # sensed minus true increments da and df, rotated to frame i
        x = sensed_angle[0] - angle[0]
        y = sensed_angle[1] - angle[1]
        z = sensed_angle[2] - angle[2]
        attitude_step = _rotate_mid_tick(c, angle, x, y, z)
        x = sensed_velocity[0] - velocity[0]
        y = sensed_velocity[1] - velocity[1]
        z = sensed_velocity[2] - velocity[2]
        sensed_step = _rotate_mid_tick(c, angle, x, y, z)
        # the velocity increment C f, tilted by the attitude error at the middle of the tick
        x, y, z = _rotate_mid_tick(c, angle, velocity[0], velocity[1], velocity[2])
        tilt_x = d[0] + 0.5 * attitude_step[0]
        tilt_y = d[1] + 0.5 * attitude_step[1]
        tilt_z = d[2] + 0.5 * attitude_step[2]
        tilted_step = cross(tilt_x, tilt_y, tilt_z, x, y, z)
        for i in range(3):
            step = sensed_step[i] + tilted_step[i]
            d[POS + i] += dt * (d[VEL + i] + 0.5 * step)
            d[VEL + i] += step
            d[ATT + i] += attitude_step[i]
    if not model.strapdown.is_error_included:  # otherwise the error of the strapdown includes that of the gravity model
        x = nav[R]
        y = nav[R + 1]
        z = nav[R + 2]
        true_x, true_y, true_z = gravity(J4, x, y, z)
        model_x, model_y, model_z = gravity(model.strapdown.gravity, x, y, z)
        d[9] = true_x - model_x
        d[10] = true_y - model_y
        d[11] = true_z - model_z


@inline_jit
def _rotate_mid_tick(c, a, x, y, z):
    """Return a body vector x, y, z in frame i, with the attitude at the middle of a tick: C (v + a x v / 2).

    c : (9,) rotation matrix at the start of the tick; a : (3,) rad, rotation over the tick
    """
    turned_x, turned_y, turned_z = cross(a[0], a[1], a[2], x, y, z)
    middle_x = x + 0.5 * turned_x
    middle_y = y + 0.5 * turned_y
    middle_z = z + 0.5 * turned_z
    return rotate(c, middle_x, middle_y, middle_z)


@jit
def _add_deviation(mean, deviation, seconds, has_sensing_errors):
    """Add deterministic errors to the mean: of sensed increments if these are propagated, and of the gravity model."""
    if has_sensing_errors:
        for i in range(N_NAV):
            mean[i] -= deviation[i]
    for i in range(3):
        gravity_error = deviation[9 + i]
        mean[VEL + i] += gravity_error * seconds
        mean[POS + i] += 0.5 * seconds * gravity_error * seconds


@jit
def _add_strapdown_error(mean, nav, reference, tick):
    """Add to the mean the error of the strapdown over a window that it began at the true state."""
    q = reference.q_b_i[tick]
    v = reference.v_i[tick]
    r = reference.r_i[tick]
    w = nav[Q]
    x = nav[Q + 1]
    y = nav[Q + 2]
    z = nav[Q + 3]
    tilt_x, tilt_y, tilt_z = small_rotation(q[0], q[1], q[2], q[3], w, x, y, z)
    mean[ATT] += tilt_x
    mean[ATT + 1] += tilt_y
    mean[ATT + 2] += tilt_z
    for i in range(3):
        velocity_error = v[i] - nav[V + i]
        position_error = r[i] - nav[R + i]
        mean[VEL + i] += velocity_error
        mean[POS + i] += position_error


@jit
def add_deviations(nav, joint, flight, model, schedule, w):
    """Add the deterministic errors of window w to the mean."""
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[schedule.length_index[w]]
    mean = joint.state.mean
    deviation = joint.scratch.deviation
    set_deviation(deviation, flight.unit, nav, model, first, n_tick, flight.reference)
    # the error of the strapdown over the window includes that of the sensed increments
    has_sensing_errors = not (joint.components.has_sample_updates or model.strapdown.is_error_included)
    _add_deviation(mean, deviation, seconds, has_sensing_errors)
    if model.strapdown.is_error_included:
        _add_strapdown_error(mean, nav, flight.reference, first + n_tick)
