"""The filter's steps: propagate a window, process an epoch's measurements, correct the navigation state."""

import numpy as np

from lvnav_trade.filter.policies.delay import LAST, correct_stored_states, ring_index
from lvnav_trade.filter.policies.epoch_differences import subtract_extra
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.covariance import add_axis_noise, grow, inflate, predict
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.quantities.line_of_sight import antenna, line_of_sight
from lvnav_trade.sensors import receiver_solution
from lvnav_trade.sensors.family import fill
from lvnav_trade.sensors.jacobian_row import N_ENTRY
from lvnav_trade.sensors.ranges import range_row, rate_row, subtract_earlier


@jit
def apply_robustness(P, model, length_index):
    """Let the covariance grow over one window, whose length has index `length_index`: by fading memory, and by what an
    H-infinity filter allows for.
    """
    if model.inflation[length_index] != 1.0:
        inflate(P, model.inflation[length_index], model.n_estimated)
    grow(P, model.h_infinity_weight[length_index])


@jit
def inject(P, model, injection):
    """Add the variances of a change of operating region.

    Parameters
    ----------
    P : (n_state, n_state) covariance, updated in place
    model : FilterModel
    injection : row of `model.injected_variance`; -1 adds nothing
    """
    if injection >= 0:
        for i in range(P.shape[0]):
            P[i, i] = P[i, i] + model.injected_variance[injection, i]


@inline_jit
def predict_covariance(P, D, sums, model, length_index, injection):
    """Propagate a covariance over one window: P <- Phi P Phi' + Q.

    Parameters
    ----------
    P : (n_state, n_state) covariance, updated in place
    D : (n_block, 9) blocks of the transition, of `fill_transition`
    sums : (18,) integrals of the strapdown over the window, from which the blocks were computed
    model : FilterModel
    length_index : index of the window length in `model.seconds`
    injection : change of operating region at the end of the window, a row of `model.injected_variance`; -1 none
    """
    apply_robustness(P, model, length_index)
    # half of the noise of unequal axes enters before the transition, half after, as `predict` does with the rest
    add_axis_noise(P, model.excess_density, sums, model.seconds[length_index])
    predict(
        P,
        D,
        model.block_rows,
        model.block_columns,
        model.decay[length_index],
        model.noise[length_index],
        model.clock,
        model.seconds[length_index],
    )
    add_axis_noise(P, model.excess_density, sums, model.seconds[length_index])
    inject(P, model, injection)


@jit
def fill_transition(work, model, length_index):
    """Set `work.D`, the blocks of the transition over one window, whose length has index `length_index`."""
    transition.fill(
        work.D,
        model.block_kinds,
        model.block_drivers,
        work.sums,
        work.nav[R],
        work.nav[R + 1],
        work.nav[R + 2],
        model.seconds[length_index],
    )


@jit
def propagate_estimates(work, model, length_index):
    """Propagate the estimates of clock, IMU parameters and extra states over one window.

    The clock bias grows by drift times time; a Gauss-Markov estimate decays by its factor.
    """
    if model.clock >= 0:
        clock_hat = work.clock_hat
        clock_hat[0] = clock_hat[0] + model.seconds[length_index] * clock_hat[1]
    if model.has_decay:
        for b in range(model.par_offset.shape[0]):
            for i in range(3):
                parameter_decay = model.decay[length_index, model.par_offset[b] + i]
                work.par[b, i] = parameter_decay * work.par[b, i]
        for e in range(model.extra_offset.shape[0]):
            extra_decay = model.decay[length_index, model.extra_offset[e]]
            work.extra[e] = extra_decay * work.extra[e]
        processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)


@inline_jit
def predict_window(work, model, length_index, injection):
    """Propagate covariance and estimates over one window by its transition; arguments as in `predict_covariance`."""
    fill_transition(work, model, length_index)
    predict_covariance(work.P, work.D, work.sums, model, length_index, injection)
    propagate_estimates(work, model, length_index)


@jit
def _set_antenna_states(work, model, nav, increments, first, dt):
    """Set the state of every antenna from a navigation state and the increments of one strapdown step.

    Parameters
    ----------
    nav : (10,) navigation state, frame i
    increments : array with the angle increments (rad, body axes) of the step at `first`, `first` + 1, `first` + 2
    dt : s, of a strapdown step
    """
    for i in range(3):
        work.rate[i] = increments[first + i] / dt
    for a in range(model.lever_arms.shape[0]):
        antenna(
            work.antenna[a],
            nav,
            work.rate,
            model.lever_arms[a],
            model.rate_sign,
        )


@jit
def place_antenna(work, state_history, delays, model, dt, epoch):
    """Set the estimated state of every antenna from the navigation state and the rate of the last step.

    Parameters
    ----------
    state_history : stored states of `delay.store_state`. With a buffered receiver the antenna is placed at the time of
        validity.
    delays : DelayProcessing, or None
    dt : s, of a strapdown step
    """
    _set_antenna_states(work, model, work.nav, work.previous, 0, dt)
    if delays is not None and not delays.is_extrapolated and delays.receiver_line >= 0:
        stored_state = state_history[ring_index(delays, delays.receiver_line, epoch)]
        _set_antenna_states(work, model, stored_state, stored_state, LAST, dt)


@jit
def _add_extra(work, model, signals, epoch, row, channel):
    """Set the Jacobian entries of the extra states; return their contribution to the predicted measurement."""
    h = work.H[row]
    total = number_like(work.x[0], 0.0)
    for family in range(model.extra_member.shape[0]):
        state = model.extra_member[family, channel]
        if state >= 0:
            partial = number_like(work.x[0], signals.partial[family, epoch, channel])
            # decorrelation mixes the rows of all axes, so there every extra state needs an entry to itself
            entry = state if model.has_reported_covariance else family
            h[N_ENTRY + entry] = partial
            total = total + partial * work.extra[state]
    return total


@jit
def _fill_previous_range(work, previous_epoch, differences, model, signals, epoch, row, channel):
    """Set the Jacobian entries of the earlier epoch of a difference; return the range (m) predicted for that epoch."""
    s = channel // model.n_observable
    antenna_state = previous_epoch.antenna[signals.antenna[epoch - 1, s]]
    ux, uy, uz, distance = line_of_sight(signals.satellite_position[epoch - 1, s], antenna_state)
    return subtract_earlier(
        work.H[row],
        differences.previous_entry,
        antenna_state,
        ux,
        uy,
        uz,
        distance,
        previous_epoch.clock[0],
    )


@jit
def _fill_further_rows(work, previous_epoch, differences, model, signals, epoch):
    """Set the rows of the further observables: carrier phase and differences of two epochs."""
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        antenna_state = work.antenna[signals.antenna[epoch, s]]
        for observable in range(2, model.n_observable):
            row = model.n_observable * slot + observable
            channel = model.n_observable * s + observable
            if not differences.is_present[epoch, channel]:
                continue
            ux, uy, uz, distance = line_of_sight(signals.satellite_position[epoch, s], antenna_state)
            prediction = range_row(work.H[row], antenna_state, ux, uy, uz, distance, work.clock_hat[0])
            extra_part = _add_extra(work, model, signals, epoch, row, channel)
            prediction = prediction + extra_part
            if differences.is_difference[observable]:
                earlier_range = _fill_previous_range(
                    work, previous_epoch, differences, model, signals, epoch, row, channel
                )
                earlier_extra = subtract_extra(work, previous_epoch, differences, model, signals, epoch, row, channel)
                prediction = prediction - earlier_range
                prediction = prediction - earlier_extra
            work.z[row] = work.ranges[slot, observable] - prediction


@jit
def fill_tight(work, previous_epoch, differences, model, signals, epoch):
    """Set Jacobian rows `work.H` and innovations `work.z` (measured minus predicted) of all satellites in use.

    Each satellite has `model.n_observable` rows: pseudorange (m), range rate (m/s), then the further observables.

    Parameters
    ----------
    previous_epoch, differences : PreviousEpoch and DifferenceProcessing of differences of two epochs; None without
        further observables
    model, signals : FilterModel, Signals
    epoch : index
    """
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        antenna_state = work.antenna[signals.antenna[epoch, s]]
        satellite_velocity = signals.satellite_velocity[epoch, s]
        ux, uy, uz, distance = line_of_sight(signals.satellite_position[epoch, s], antenna_state)
        row = model.n_observable * slot
        channel = model.n_observable * s
        clock_bias = work.clock_hat[0]
        prediction = range_row(work.H[row], antenna_state, ux, uy, uz, distance, clock_bias)
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        prediction = prediction + extra_part
        work.z[row] = work.ranges[slot, 0] - prediction
        row = row + 1
        channel = channel + 1
        clock_drift = work.clock_hat[1]
        prediction = rate_row(work.H[row], antenna_state, satellite_velocity, ux, uy, uz, distance, clock_drift)
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        prediction = prediction + extra_part
        work.z[row] = work.ranges[slot, 1] - prediction
    if differences is not None:
        _fill_further_rows(work, previous_epoch, differences, model, signals, epoch)


@jit
def fill_loose(work, model, signals, epoch):
    """Set Jacobian rows and innovations (measured minus predicted) of a solution: position (m), velocity (m/s)."""
    for row in range(6):
        if model.has_reported_covariance:  # decorrelation combines whole rows, so unused entries must be zero
            for e in range(model.extra_offset.shape[0]):
                work.H[row, N_ENTRY + e] = number_like(work.x[0], 0.0)
        prediction = receiver_solution.row(work.H[row], work.antenna[0], row)
        extra_part = _add_extra(work, model, signals, epoch, row, row)
        prediction = prediction + extra_part
        work.z[row] = work.solution[row] - prediction


@jit
def sensor_row(model, work, channel):
    """Return the row of a sensor channel in `work.H` and `work.z`: sensors have the last rows."""
    return work.z.shape[0] - model.n_entry.shape[0] + channel


@jit
def fill_sensor(work, state_history, delays, model, signals, sensors, k, epoch):
    """Set Jacobian rows and innovations (measured minus predicted) of sensor k.

    Parameters
    ----------
    state_history : stored states. With delay compensation the prediction is that of the time of validity.
    delays : DelayProcessing, or None
    model, signals, sensors : FilterModel, Signals, Sensors
    k, epoch : indices
    """
    first = sensor_row(model, work, sensors.channel[k])
    code = sensors.code[k]
    theta = sensors.theta[k, epoch]
    parameters = sensors.filter_parameters[k, epoch]
    if delays is not None and delays.sensor_line[k] >= 0:
        stored_state = state_history[ring_index(delays, delays.sensor_line[k], epoch)]
        fill(work.H, work.z, first, code, work.sensor_measurements[k], stored_state, theta, parameters)
    else:
        fill(work.H, work.z, first, code, work.sensor_measurements[k], work.nav, theta, parameters)
    for i in range(sensors.scalars[k]):
        row = first + i
        channel = sensors.channel[k] + i
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        work.z[row] = work.z[row] - extra_part


@jit
def receiver_row_count(model, signals, epoch):
    """Return the number of receiver rows that the filter processes at an epoch.

    A simulated solution needs four satellites. A receiver that solves for position itself has six rows at every epoch;
    innovations without a solution are not-a-number.
    """
    if (epoch + 1) % model.decimation != 0 or model.n_receiver == 0:
        return 0
    if model.tight:
        return model.n_observable * signals.n_used[epoch]
    return 6 if model.has_solver or signals.n_used[epoch] >= 4 else 0


@jit
def receiver_channel(model, signals, epoch, row):
    """Return the channel of a receiver row at an epoch."""
    if model.tight:
        slot = row // model.n_observable
        observable = row % model.n_observable
        return model.n_observable * signals.satellite_by_slot[epoch, slot] + observable
    return row


@jit
def clear_epoch(work, epoch):
    """Set the counts of an epoch to zero and its innovations to not-a-number, which means: no measurement."""
    zero = number_like(work.x[0], 0.0)
    work.nis[epoch] = zero
    work.n_row[epoch] = zero
    work.n_reject[epoch] = zero
    for channel in range(work.innovation.shape[1]):
        work.innovation[epoch, channel] = number_like(zero, np.nan)


@inline_jit
def fill_receiver(work, previous_epoch, differences, model, signals, epoch):
    """Set the rows of all receiver measurements of an epoch, linearised at the same state."""
    if model.tight:
        fill_tight(work, previous_epoch, differences, model, signals, epoch)
    else:
        fill_loose(work, model, signals, epoch)


@jit
def correct_parameters(work, model):
    """Add the error state to the estimated parameters of the IMU."""
    for b in range(model.par_offset.shape[0]):
        for i in range(3):
            state = model.par_offset[b] + i
            work.par[b, i] = work.par[b, i] + work.x[state]


@jit
def correct_receiver(work, model):
    """Add the error state to the estimates of the receiver's clock and of the extra states."""
    if model.clock >= 0:
        for i in range(2):
            work.clock_hat[i] = work.clock_hat[i] + work.x[model.clock + i]
    for e in range(model.extra_offset.shape[0]):
        state = model.extra_offset[e]
        work.extra[e] = work.extra[e] + work.x[state]


@jit
def correct(work, state_history, delays, model):
    """Feed the error state back to all estimates and set it to zero (closed loop).

    Corrected are navigation state, stored states of delayed measurements, IMU parameters, clock and extra states.
    """
    x = work.x
    correct_motion(work.nav, x)
    correct_stored_states(state_history, delays, x)  # delayed measurements are compared with corrected states
    correct_parameters(work, model)
    correct_receiver(work, model)
    processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)
    for i in range(model.n_state):
        x[i] = number_like(x[i], 0.0)
