"""Results of a run at a history time: errors (truth minus estimate), sigmas, NEES, failure."""

from lvnav_trade.filter.policies.open_loop import apply_correction, remove_correction
from lvnav_trade.filter.receivers.receiver import BIAS as RX_BIAS
from lvnav_trade.filter.receivers.receiver import POS as RX_POS
from lvnav_trade.filter.receivers.receiver import VEL as RX_VEL
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.covariance import normalised_square, variance_along
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, sqrt, where
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.kernels.transition import ATT, CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2, POS, VEL
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.simulation.imu_array import add_relative_biases

N_SAMPLE_OUTPUT = 12
"""Outputs after the states: errors of IMU samples of angular rate and specific force, raw and corrected."""


@jit
def true_parameter(tables, sensor, driver, axis):
    """Return the true value (SI) of a filter's IMU parameter: the sum of all true parameters with the same driver.

    Parameters
    ----------
    tables : (2, N_TABLE) true error tables of gyro and accelerometer, see `processes.gather`
    sensor : GYRO or ACCEL
    driver : driver of the parameter, see `transition.driver`
    axis : 0 to 2, body axis
    """
    table = tables[sensor]
    if driver == CONSTANT:
        return table[processes.BIAS + axis]
    if OWN_0 <= driver and driver <= OWN_2:
        component = (axis + driver - OWN_0) % 3
        return table[processes.OWN + 3 * axis + component]
    if OTHER_0 <= driver and driver <= OTHER_2:
        component = driver - OTHER_0
        return table[processes.OTHER + 3 * axis + component]
    return table[processes.SQUARES + axis]


@jit
def _extra_errors(work, correlated_errors, model):
    """Set the errors of extra states: the true errors that they model, at the last epoch, minus the estimates."""
    for e in range(model.extra_offset.shape[0]):
        work.x[model.extra_offset[e]] = -work.extra[e]
    for p in range(correlated_errors.error_of.shape[0]):
        extra_state = correlated_errors.state_of[p]
        state = model.extra_offset[extra_state]
        error = correlated_errors.error_of[p]
        work.x[state] = work.x[state] + work.correlated_errors[error]


@jit
def _motion_error(x, nav, history, hist):
    """Set the errors (truth minus estimate) of attitude (rad), velocity (m/s) and position (m), frame i.

    Parameters
    ----------
    x : (n,) error state; the first nine entries are set
    nav : (10,) navigation state, frame i
    history : HistoryTruth
    hist : index of the history time
    """
    q = history.q[hist]
    q0 = nav[Q]
    q1 = nav[Q + 1]
    q2 = nav[Q + 2]
    q3 = nav[Q + 3]
    rx, ry, rz = small_rotation(q[0], q[1], q[2], q[3], q0, q1, q2, q3)
    x[ATT] = rx
    x[ATT + 1] = ry
    x[ATT + 2] = rz
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]


@jit
def _navigation_errors(x, work, history, model, hist):
    """Set the errors (truth minus estimate) of attitude, velocity, position and parameters at a history time."""
    _motion_error(x, work.nav, history, hist)
    for b in range(model.par_offset.shape[0]):
        first = model.par_offset[b]
        for i in range(3):
            true = true_parameter(work.true_tables, model.par_sensor[b], model.par_driver[b], i)
            x[first + i] = true - work.par[b, i]


@jit
def _record_vector(err, sigma, output, x, P, state, direction):
    """Write error and sigma of a block of three states along a direction.

    Parameters
    ----------
    err, sigma : (n_out,) outputs at a history time, updated in place
    output : index of the output
    x, P : (n,) and (n, n) error and covariance
    state : first state of the block
    direction : (3,) unit vector, in the axes of the states
    """
    c0, c1, c2 = direction
    err[output] = c0 * x[state] + c1 * x[state + 1] + c2 * x[state + 2]
    sigma[output] = sqrt(variance_along(P, state, c0, c1, c2))


@jit
def _record_motion(err, sigma, first, x, P, history, hist):
    """Write errors and sigmas of attitude (body axes), velocity and position (reporting axes).

    Parameters
    ----------
    err, sigma : (n_out,) outputs at a history time, updated in place
    first : index of the first output
    x, P : (n,) and (n, n) error and covariance, frame i
    history : HistoryTruth
    hist : index of the history time
    """
    q = history.q[hist]
    axes = history.axes[hist]
    c = matrix(q[0], q[1], q[2], q[3])
    for i in range(3):
        body_axis = (c[i], c[3 + i], c[6 + i])
        axis = (axes[i, 0], axes[i, 1], axes[i, 2])
        output = first + i
        _record_vector(err, sigma, output + ATT, x, P, ATT, body_axis)
        for state in (VEL, POS):
            _record_vector(err, sigma, output + state, x, P, state, axis)


@jit
def _record_backup(work, backup, first, history, hist):
    """Write the errors of the backup strapdown (Backup, or None), from output `first` on."""
    if backup is not None:
        err = work.err[hist]
        sigma = work.sigma[hist]
        _motion_error(backup.x, backup.nav, history, hist)
        _record_motion(err, sigma, first, backup.x, backup.P, history, hist)


@jit
def _record_states(work, imu_array_work, history, correlated_errors, imu_array, model, hist):
    """Write errors (truth minus estimate), the filter's sigma and NEES at a history time, in reporting axes.

    Parameters
    ----------
    work : Work, updated in place; the error state is zero afterwards
    imu_array_work, imu_array : ImuArrayWork and ImuArray; None for one IMU
    history, correlated_errors : HistoryTruth, CorrelatedErrors
    model : FilterModel
    hist : index of the history time
    """
    x = work.x
    P = work.P
    err = work.err[hist]
    sigma = work.sigma[hist]
    _navigation_errors(x, work, history, model, hist)
    if model.clock >= 0:
        # the true clock is stepped at epochs; in between its bias changes by its drift
        time_since_epoch = history.time_since_epoch[hist]
        drift = work.clock[1]
        bias = work.clock[0] + time_since_epoch * drift
        x[model.clock] = bias - work.clock_hat[0]
        x[model.clock + 1] = drift - work.clock_hat[1]
    _extra_errors(work, correlated_errors, model)
    add_relative_biases(work, imu_array_work, imu_array)
    _record_motion(err, sigma, 0, x, P, history, hist)
    for i in range(9, model.reported_states.shape[0]):
        state = model.reported_states[i]
        err[i] = x[state]
        sigma[i] = sqrt(P[state, state])
    work.nees[hist] = normalised_square(P, work.X, work.K, x, model.n_assessed)
    _check_failure(work, history, hist)
    for i in range(model.n_state):
        x[i] = number_like(x[i], 0.0)


@jit
def _check_failure(work, history, hist):
    """Set failure code and time of a run when its position error is first not finite (1) or beyond the limit (2)."""
    x = work.x
    failure_code = work.failed[0]
    limit = history.limit * history.limit
    rx = x[POS]
    ry = x[POS + 1]
    rz = x[POS + 2]
    # a covariance that is not a number makes the square not a number: neither within nor beyond the limit
    square = rx * rx + ry * ry + rz * rz + 0.0 * work.P[ATT, ATT]
    code = where(square > limit, 2.0, 1.0)
    first_code = where(failure_code > 0.0, failure_code, code)
    present_code = where(square <= limit, failure_code, first_code)
    is_first_failure = (present_code > 0.0) & (failure_code == 0.0)
    work.t_failed[0] = where(is_first_failure, history.t[hist], work.t_failed[0])
    work.failed[0] = present_code


@jit
def _motion_errors(work, motion, vehicle, tick):
    """Set the errors of the motion states at the tick that ends here (VehicleModel, or None)."""
    if vehicle is not None:
        first_rate = vehicle.motion
        first_force = first_rate + 3
        for i in range(3):
            work.x[first_rate + i] = vehicle.rate[tick, i] - motion.rate[i]
            work.x[first_force + i] = vehicle.force[tick, i] - motion.force[i]


@jit
def _record_samples(work, motion, samples, model, tick, hist):
    """Write the errors of the last IMU sample: raw, and corrected by the estimated bias.

    Parameters
    ----------
    work : Work, updated in place
    motion : ImuSampleWork, with the sample
    samples : ReportedSamples, or None
    model : FilterModel
    tick, hist : tick of the sample, history time
    """
    if samples is not None:
        err = work.err[hist]
        sigma = work.sigma[hist]
        first_raw = model.reported_states.shape[0]
        first_corrected = first_raw + N_SAMPLE
        for i in range(N_SAMPLE):
            axis = i % 3
            true = samples.rate[tick, axis] if i < 3 else samples.force[tick, axis]
            error = true - motion.sample[i]
            variance = number_like(error, samples.raw[i])
            err[first_raw + i] = error
            sigma[first_raw + i] = sqrt(variance)
            state = samples.bias[i]
            if state >= 0:
                block = samples.par[i // 3]
                error = error + work.par[block, axis]
                variance = work.P[state, state] + samples.variance[i]
            err[first_corrected + i] = error
            sigma[first_corrected + i] = sqrt(variance)


@jit
def _record_solution(work, solution_error, report, history, model, hist):
    """Write the error of the receiver's last solution in reporting axes: velocity, position, clock.

    Parameters
    ----------
    work : Work, updated in place
    solution_error : LastSolutionError
    report : ReportedSolution, or None
    history, model : HistoryTruth, FilterModel
    hist : index of the history time
    """
    if report is not None:
        axes = history.axes[hist]
        err = work.err[hist]
        sigma = work.sigma[hist]
        x = solution_error.error
        P = solution_error.covariance
        velocity = report.first_output
        position = velocity + 3
        clock = velocity + 6
        for i in range(3):
            direction = axes[i, 0], axes[i, 1], axes[i, 2]
            _record_vector(err, sigma, velocity + i, x, P, RX_VEL, direction)
            _record_vector(err, sigma, position + i, x, P, RX_POS, direction)
        for k in range(2):
            state = RX_BIAS + k
            err[clock + k] = x[state]
            sigma[clock + k] = sqrt(P[state, state])


@jit
def _record_misses(work, transition_errors, history, model, hist):
    """Write the error of the inertial system, and the error of the filter's transition since the previous history time.

    The error state is then set to the true error, from which the transition propagates it.

    Parameters
    ----------
    work : Work, of which `x` is updated in place
    transition_errors : TransitionErrors, updated in place; None: nothing is written
    history : HistoryTruth
    model : FilterModel
    hist : index of the history time
    """
    if transition_errors is not None:
        errors = transition_errors.error[hist]
        transition_error = transition_errors.transition_error[hist]
        _navigation_errors(errors, work, history, model, hist)
        for i in range(model.n_state):
            error = errors[i]
            transition_error[i] = error - work.x[i] if hist > 0 else number_like(error, 0.0)
            work.x[i] = error


@inline_jit
def _record_errors(work, optional_state, case, open_loop, history, tick, hist):
    """Record the errors of all outputs; those of an open loop (OpenLoop, or None) with its correction applied."""
    model = case.model
    options = case.options
    if open_loop is not None:
        apply_correction(work, open_loop, optional_state.mode_state, model)
    _motion_errors(work, optional_state.motion, options.vehicle, tick)
    _record_states(work, optional_state.units, history, case.signals.correlated_errors, options.imu_array, model, hist)
    if open_loop is not None:
        remove_correction(work, open_loop, model)
    _record_samples(work, optional_state.motion, options.reported_samples, model, tick, hist)
    _record_solution(work, optional_state.solution_error, options.reported_solution, history, model, hist)
    _record_backup(work, optional_state.backup, options.backup, history, hist)


@inline_jit
def record(work, optional_state, case, transition_errors, history, tick, hist):
    """Record the errors of a run at a history time, or those of the filter's transition.

    Parameters
    ----------
    work, optional_state, case : Work, OptionalState, FilterCase
    transition_errors : TransitionErrors, which gets the errors of the transition; None to record estimation errors
    history : HistoryTruth, true motion at the history times
    tick : last tick before the history time
    hist : history time
    """
    if transition_errors is not None:
        _record_misses(work, transition_errors, history, case.model, hist)
    else:
        _record_errors(work, optional_state, case, optional_state.open_loop, history, tick, hist)
