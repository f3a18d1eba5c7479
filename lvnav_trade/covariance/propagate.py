"""Propagation of the joint covariance over a window of the nominal flight, source by source."""

import numpy as np

from lvnav_trade.covariance.components import GRAVITY
from lvnav_trade.covariance.imu_array_errors import REMAINDER, WHITE, unit_input_matrix
from lvnav_trade.filter.ekf import predict_covariance
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import cross, matrix, rotate, small_rotation
from lvnav_trade.kernels.covariance import apply_phi, enter, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import group
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.strapdown import J4, Q, R, V, gravity, place
from lvnav_trade.kernels.transition import (
    ATT,
    ATT_GYRO,
    CONSTANT,
    EVERY_WINDOW,
    GYRO,
    POS,
    VEL,
    VEL_ACCEL,
    VEL_GYRO,
    linearise,
    linearised_sums,
    parameter_block,
)

N_NAV = 9


@jit
def nominal_window(nominal, reference, unit, first, n_tick, algorithm, sensed, linearised=EVERY_WINDOW):
    """Integrate the strapdown over a window from the true state, to get the integrals that the transition needs.

    Parameters
    ----------
    nominal : Nominal; its state, increments and integrals are set
    reference, unit : Reference, ImuTruth
    first, n_tick : first tick, number of ticks
    algorithm : Strapdown
    sensed : whether the increments are those that the IMU outputs (bandwidth), if the error of the strapdown algorithm
        is included; otherwise they are true increments
    linearised : code of `transition.linearise`
    """
    place(nominal.nav, reference, first)
    linearise(nominal.rates, nominal.nav, linearised)
    for k in range(n_tick):
        tick = first + k
        for axis in range(3):
            angle = reference.dtheta[tick, axis]
            velocity = reference.dvel[tick, axis]
            if sensed and algorithm.counted:
                angle = unit.dtheta[tick, axis]
                velocity = unit.dvel[tick, axis]
            nominal.increments[k, axis] = angle
            nominal.increments[k, 3 + axis] = velocity
    n_step = n_tick // algorithm.subsamples
    step, seconds = unit.dt * algorithm.subsamples, unit.dt * first
    mechanise(nominal.nav, nominal.sums, nominal.previous, nominal.increments, n_step, step, algorithm, seconds)


@jit
def input_matrix(b, block, j, true, sums, seconds):
    """Set the sensitivity of attitude, velocity and position to the components of a block over a window.

    Parameters
    ----------
    b : (9, 3) set here, SI per unit of each component
    block : (9,) scratch
    j : block
    true : Components
    sums : (18,) integrals of the strapdown over the window
    seconds : s, length of the window
    """
    for i in range(N_NAV):
        for axis in range(3):
            b[i, axis] = 0.0
    sensor, driven_by = true.sensor[j], true.driver[j]
    first_state = ATT if sensor == GYRO else VEL
    if driven_by == GRAVITY:
        for axis in range(3):
            b[VEL + axis, axis] = seconds
            b[POS + axis, axis] = 0.5 * seconds * seconds
    elif driven_by == REMAINDER:
        if seconds > 0.0:
            for axis in range(3):
                for i in range(3):
                    b[first_state + i, axis] = sums[3 * i + axis] / seconds
    elif seconds > 0.0:
        first, last = (ATT_GYRO, VEL_GYRO) if sensor == GYRO else (VEL_ACCEL, VEL_ACCEL)
        is_white = driven_by == WHITE  # PSD: acts like a bias of variance PSD / seconds over the window
        size = 1.0 / np.sqrt(seconds) if is_white else 1.0
        for block_kind in range(first, last + 1):
            parameter_block(block, block_kind, CONSTANT if is_white else driven_by, sums, seconds)
            for i in range(3):
                for axis in range(3):
                    b[first_state + i, axis] = size * block[3 * i + axis]
            first_state = VEL
        for axis in range(3):
            for i in range(3):
                b[POS + i, axis] = 0.5 * seconds * b[VEL + i, axis]


@jit
def _block_input(scratch, j, true, units, sums, seconds, first, n_tick):
    """Set `scratch.input` to the sensitivity to block j over a window, for one IMU or an array (ImuArray)."""
    if units is None or true.driver[j] == GRAVITY:
        input_matrix(scratch.input, scratch.block, j, true, sums, seconds)
    else:
        unit_input_matrix(scratch, j, true, units, sums, seconds, first, n_tick)


@jit
def fill_inputs(scratch, true, units, sums, seconds, first, n_tick):
    """Set `scratch.b`, the sensitivity of attitude, velocity and position to each component over a window."""
    for j in range(true.sensor.shape[0]):
        if true.profile[j] < 0 and true.moving[j]:
            _block_input(scratch, j, true, units, sums, seconds, first, n_tick)
            source, k = true.source[true.first[j]], true.slot[true.first[j]]
            g, lane = true.group[source], true.lane[source]
            for axis in range(3):
                for i in range(N_NAV):
                    scratch.b[g, k + axis, i, lane] = scratch.input[i, axis]


@jit
def _enter_over_window(P, y, b, variance, echo):
    """Add the effect of components c, one per lane, over a window: x += b c, before c decays.

    Parameters
    ----------
    P, y : (N, N) covariance of x, and (N,) Cov(x, c); both updated in place
    b, variance : (9,) sensitivity of attitude, velocity and position to c, and variance of c
    echo : variance of the driving noise of c that also enters the states, with the opposite sign of b
    """
    # P + b y' + y b' + (variance + echo) b b'; the last term is shared between the two loops over i and j
    n = P.shape[0]
    half = 0.5 * (variance + echo)
    for i in range(N_NAV):
        bi = b[i]
        for j in range(N_NAV):
            value = bi * (y[j] + half * b[j])
            P[i, j] += value
            P[j, i] += value
        for j in range(N_NAV, n):
            value = bi * y[j]
            P[i, j] += value
            P[j, i] += value
    for i in range(N_NAV):
        y[i] += b[i] * variance


@jit
def _advance_components(joint, scratch, true, length, g):
    """Add the effect of the components of a group over a window, then propagate the components themselves."""
    factors, noises = group(true.factor[length], g), group(true.noise[length], g)
    echoes, variances = group(true.echo[length], g), group(joint.variance, g)
    cross_covariances = group(joint.cross, g)
    b = group(scratch.b, g)
    P = group(joint.sources, g)
    for k in range(true.n_slot[g]):
        factor = factors[k, 0]
        y = cross_covariances[k]
        if true.followed[g, k]:
            if true.moves[g, k]:
                _enter_over_window(P, y, b[k], variances[k, 0], echoes[k, 0])
            for i in range(y.shape[0]):
                y[i] = factor * y[i]
            if true.moves[g, k]:
                # the new remainder enters the states with the sign opposite to that of the component
                for i in range(N_NAV):
                    y[i] -= echoes[k, 0] * b[k, i]
        variances[k, 0] = factor * factor * variances[k, 0] + noises[k, 0]  # c+ = f c + w


@jit
def _enter_states(joint, true, b, decay, length):
    """Add to the error of modelled states the difference between true and modelled decay times the component.

    The error of such a state is component minus estimate, and the filter compensates its estimate by the same blocks,
    so propagating the error of the state covers all other effects. b (1,) is scratch.
    """
    for c in range(true.source.shape[0]):
        for p in range(true.state_from[c], true.state_from[c + 1]):
            source, k, state = true.source[c], true.slot[c], true.states[p]
            g, lane = true.group[source], true.lane[source]
            b[0] = true.factor[length, g, k, 0, lane] - decay[state]
            P = joint.sources[g, ..., lane]
            y = joint.cross[g, ..., lane]
            enter(P, y[k], joint.variance[g, k, 0, lane], b, state)


@jit
def _drive_states(joint, true, length):
    """Add the driving noise of components to the error of the states that model them."""
    for c in range(true.source.shape[0]):
        source, k = true.source[c], true.slot[c]
        first, last = true.state_from[c], true.state_from[c + 1]
        g, lane = true.group[source], true.lane[source]
        noise = true.noise[length, g, k, 0, lane]
        # all states that model the component get the same noise, so their errors are fully correlated by it
        for p in range(first, last):
            for q in range(first, last):
                joint.sources[g, true.states[p], true.states[q], lane] += noise
            if true.followed[g, k]:
                joint.cross[g, k, true.states[p], lane] += noise


@jit
def propagate_sources(joint, scratch, true, units, model, sums, schedule, w):
    """Propagate the true covariance by source and the mean over window w, with the transition in `scratch.D_true`.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    scratch, true : Scratch, Components
    units : ImuArray; None for one IMU
    model, schedule : FilterModel, Schedule
    sums : (18,) integrals of the strapdown over the window
    w : window
    """
    length, first, n_tick = schedule.length[w], schedule.first_tick[w], schedule.n_tick[w]
    seconds, decay = model.seconds[length], true.decay[length]
    D = scratch.D_true
    rows, columns = true.nav_rows, true.nav_columns
    fill_inputs(scratch, true, units, sums, seconds, first, n_tick)
    for g in range(true.n_slot.shape[0]):
        predict(group(joint.sources, g), D, rows, columns, decay, group(true.white[length], g), model.clock, seconds)
        cross = group(joint.cross, g)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                apply_phi(cross[k], D, rows, columns, decay, model.clock, seconds)
    _enter_states(joint, true, scratch.shift[:1], decay, length)
    for g in range(true.n_slot.shape[0]):
        _advance_components(joint, scratch, true, length, g)
    _drive_states(joint, true, length)
    apply_phi(joint.mean, D, rows, columns, decay, model.clock, seconds)


@jit
def _advance_profiles(joint, unit, units, model, sums, schedule, w):
    """Add the effect of deterministic profiles over window w to the mean.

    If a filter state models the bias, only the change of the profile acts. If IMU samples are measurements and no state
    models the bias, it enters by the samples.
    """
    state, scratch, true = joint.state, joint.scratch, joint.true
    length, first, n_tick = schedule.length[w], schedule.first_tick[w], schedule.n_tick[w]
    seconds, decay = model.seconds[length], true.decay[length]
    g = scratch.shift
    middle = unit.start + unit.dt * (first + 0.5 * n_tick)
    for j in range(true.sensor.shape[0]):
        profile, matched = true.profile[j], true.matched[j]
        if profile < 0:
            continue
        if true.moving[j]:
            _block_input(scratch, j, true, units, sums, seconds, first, n_tick)
        for axis in range(3):
            value = profile_value(unit, profile, axis, middle)
            change = value - state.profile[profile, axis]
            state.profile[profile, axis] = value
            if matched >= 0:
                for i in range(g.shape[0]):
                    g[i] = 0.0
                g[matched + axis] = 1.0
                # the value is the mean over the window, so a change acts from the start of the window
                apply_phi(g, scratch.D_true, true.nav_rows, true.nav_columns, decay, model.clock, seconds)
                extra = 1.0 - decay[matched + axis]  # the filter's state decays, the profile does not
                for i in range(g.shape[0]):
                    state.mean[i] += g[i] * change
                state.mean[matched + axis] += extra * value
            elif true.moving[j]:
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
    unit, reference : Unit with sensed increments, Reference with true increments
    nav, model : (10,) navigation state; FilterModel
    first, n_tick : first tick, number of ticks
    """
    for i in range(12):
        deviation[i] = 0.0
    d, dt = deviation, unit.dt
    for k in range(first, first + n_tick):
        a, f, q = reference.dtheta[k], reference.dvel[k], reference.q_b_i[k]
        sensed_a, sensed_f = unit.dtheta[k], unit.dvel[k]
        c = matrix(q[0], q[1], q[2], q[3])
        turned = _rotate_mid_tick(c, a, sensed_a[0] - a[0], sensed_a[1] - a[1], sensed_a[2] - a[2])
        gained = _rotate_mid_tick(c, a, sensed_f[0] - f[0], sensed_f[1] - f[1], sensed_f[2] - f[2])
        x, y, z = _rotate_mid_tick(c, a, f[0], f[1], f[2])
        tilted = cross(d[0] + 0.5 * turned[0], d[1] + 0.5 * turned[1], d[2] + 0.5 * turned[2], x, y, z)
        for i in range(3):
            step = gained[i] + tilted[i]
            d[POS + i] += dt * (d[VEL + i] + 0.5 * step)
            d[VEL + i] += step
            d[ATT + i] += turned[i]
    if not model.strapdown.counted:  # otherwise the error of the strapdown includes that of the gravity model
        x, y, z = nav[R], nav[R + 1], nav[R + 2]
        true_x, true_y, true_z = gravity(J4, x, y, z)
        model_x, model_y, model_z = gravity(model.strapdown.gravity, x, y, z)
        d[9] = true_x - model_x
        d[10] = true_y - model_y
        d[11] = true_z - model_z


@inlined
def _rotate_mid_tick(c, a, x, y, z):
    """Return a body vector x, y, z in frame i, with the attitude at the middle of a tick: C (v + a x v / 2).

    c : (9,) rotation matrix at the start of the tick; a : (3,) rad, rotation over the tick
    """
    turned_x, turned_y, turned_z = cross(a[0], a[1], a[2], x, y, z)
    return rotate(c, x + 0.5 * turned_x, y + 0.5 * turned_y, z + 0.5 * turned_z)


@jit
def _add_deviation(mean, deviation, seconds, sensed):
    """Add deterministic errors to the mean: of sensed increments if these are propagated, and of the gravity model."""
    if sensed:
        for i in range(N_NAV):
            mean[i] -= deviation[i]
    for i in range(3):
        mean[VEL + i] += deviation[9 + i] * seconds
        mean[POS + i] += 0.5 * seconds * deviation[9 + i] * seconds


@jit
def _add_strapdown_error(mean, nav, reference, tick):
    """Add to the mean the error of the strapdown over a window that it began at the true state."""
    q = reference.q_b_i[tick]
    x, y, z = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    mean[ATT] += x
    mean[ATT + 1] += y
    mean[ATT + 2] += z
    for i in range(3):
        mean[VEL + i] += reference.v_i[tick, i] - nav[V + i]
        mean[POS + i] += reference.r_i[tick, i] - nav[R + i]


@jit
def _propagate_formal(work, D, model, schedule, w):
    """Propagate the formal covariance over window w as `filter.ekf.predict_window` does; D is set to its blocks."""
    length = schedule.length[w]
    seconds = model.seconds[length]
    for i in range(work.sums.shape[0]):
        work.held[i] = work.sums[i]
    linearised_sums(work.rates, work.held, seconds, schedule.linearised[w])
    x, y, z = work.nav[R], work.nav[R + 1], work.nav[R + 2]
    transition.fill(D, model.block_kinds, model.block_drivers, work.held, x, y, z, seconds)
    predict_covariance(work.P, D, work.held, model, length, schedule.injection[w])


@jit
def _add_deviations(nav, joint, flight, model, schedule, w):
    """Add the deterministic errors of window w to the mean."""
    first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
    deviation = joint.scratch.deviation
    set_deviation(deviation, flight.unit, nav, model, first, n_tick, flight.reference)
    # the error of the strapdown over the window includes that of the sensed increments
    sensed = not (joint.true.by_samples or model.strapdown.counted)
    _add_deviation(joint.state.mean, deviation, model.seconds[schedule.length[w]], sensed)
    if model.strapdown.counted:
        _add_strapdown_error(joint.state.mean, nav, flight.reference, first + n_tick)


@jit
def propagate(work, case, joint, flight, units, w):
    """Propagate formal and true covariance over window w: the former by the filter model, the latter by the truth.

    If IMU samples are measurements, motion has already been propagated tick by tick; the remaining effects follow here.

    Parameters
    ----------
    work, case, joint, flight : as in `forward.forward`
    units : ImuArray; None for one IMU
    w : window
    """
    model, schedule = case.model, case.schedule
    scratch, true = joint.scratch, joint.true
    x, y, z = work.nav[R], work.nav[R + 1], work.nav[R + 2]
    _propagate_formal(work, scratch.D, model, schedule, w)
    seconds = model.seconds[schedule.length[w]]
    transition.fill(scratch.D_true, true.nav_kinds, true.nav_drivers, work.sums, x, y, z, seconds)
    propagate_sources(joint.state, scratch, true, units, model, work.sums, schedule, w)
    _advance_profiles(joint, flight.unit, units, model, work.sums, schedule, w)
    _add_deviations(work.nav, joint, flight, model, schedule, w)
