"""The filter's steps: propagate a window, process an epoch's measurements, correct the navigation state."""

import numpy as np

from lvnav_trade.filter.policies.delay import LAST, correct_stored, place_of
from lvnav_trade.filter.policies.epoch_differences import subtract_extra
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.covariance import add_turned, grow, inflate, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.quantities.line_of_sight import antenna, line_of_sight
from lvnav_trade.sensors import receiver_solution
from lvnav_trade.sensors.family import fill
from lvnav_trade.sensors.jacobian_row import N_ENTRY
from lvnav_trade.sensors.ranges import range_row, rate_row, subtract_earlier


@jit
def apply_robustness(P, model, length):
    """Let the covariance grow over one window, whose length has index `length`: by fading memory, and by what an
    H-infinity filter allows for.
    """
    if model.inflation[length] != 1.0:
        inflate(P, model.inflation[length], model.n_estimated)
    grow(P, model.growth[length])


@jit
def inject(P, model, injection):
    """Add the variances of a change of operating region.

    Parameters
    ----------
    P : (n_state, n_state) covariance, updated in place
    model : FilterModel
    injection : row of `model.injected`; -1 adds nothing
    """
    if injection >= 0:
        for i in range(P.shape[0]):
            P[i, i] = P[i, i] + model.injected[injection, i]


@inlined
def predict_covariance(P, D, sums, model, length, injection):
    """Propagate a covariance over one window: P <- Phi P Phi' + Q.

    Parameters
    ----------
    P : (n_state, n_state) covariance, updated in place
    D : (n_block, 9) blocks of the transition, of `fill_transition`
    sums : (18,) integrals of the strapdown over the window, from which the blocks were computed
    model : FilterModel
    length : index of the window length in `model.seconds`
    injection : change of operating region at the end of the window, a row of `model.injected`; -1 none
    """
    apply_robustness(P, model, length)
    # half of the noise of unequal axes enters before the transition, half after, as `predict` does with the rest
    add_turned(P, model.uneven, sums, model.seconds[length])
    predict(
        P,
        D,
        model.block_rows,
        model.block_columns,
        model.decay[length],
        model.noise[length],
        model.clock,
        model.seconds[length],
    )
    add_turned(P, model.uneven, sums, model.seconds[length])
    inject(P, model, injection)


@jit
def fill_transition(work, model, length):
    """Set `work.D`, the blocks of the transition over one window, whose length has index `length`."""
    transition.fill(
        work.D,
        model.block_kinds,
        model.block_drivers,
        work.sums,
        work.nav[R],
        work.nav[R + 1],
        work.nav[R + 2],
        model.seconds[length],
    )


@jit
def propagate_estimates(work, model, length):
    """Propagate the estimates of clock, IMU parameters and extra states over one window.

    The clock bias grows by drift times time; a Gauss-Markov estimate decays by its factor.
    """
    if model.clock >= 0:
        clock_hat = work.clock_hat
        clock_hat[0] = clock_hat[0] + model.seconds[length] * clock_hat[1]
    if model.fading:
        for b in range(model.par_offset.shape[0]):
            for i in range(3):
                parameter_decay = model.decay[length, model.par_offset[b] + i]
                work.par[b, i] = parameter_decay * work.par[b, i]
        for e in range(model.extra_offset.shape[0]):
            extra_decay = model.decay[length, model.extra_offset[e]]
            work.extra[e] = extra_decay * work.extra[e]
        processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)


@inlined
def predict_window(work, model, length, injection):
    """Propagate covariance and estimates over one window by its transition; arguments as in `predict_covariance`."""
    fill_transition(work, model, length)
    predict_covariance(work.P, work.D, work.sums, model, length, injection)
    propagate_estimates(work, model, length)


@jit
def _place_at(work, model, nav, increments, first, dt):
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
def place_antenna(work, state_history, late, model, dt, epoch):
    """Set the estimated state of every antenna from the navigation state and the rate of the last step.

    Parameters
    ----------
    state_history : stored states of `delay.keep`. With a buffered receiver the antenna is placed at the time of
        validity.
    late : DelayProcessing, or None
    dt : s, of a strapdown step
    """
    _place_at(work, model, work.nav, work.previous, 0, dt)
    if late is not None and not late.extrapolated and late.receiver >= 0:
        stored = state_history[place_of(late, late.receiver, epoch)]
        _place_at(work, model, stored, stored, LAST, dt)


@jit
def _add_extra(work, model, signals, epoch, row, channel):
    """Set the Jacobian entries of the extra states; return their contribution to the predicted measurement."""
    h = work.H[row]
    total = like(work.x[0], 0.0)
    for family in range(model.extra_member.shape[0]):
        state = model.extra_member[family, channel]
        if state >= 0:
            partial = like(work.x[0], signals.partial[family, epoch, channel])
            # decorrelation mixes the rows of all axes, so there every extra state needs an entry to itself
            entry = state if model.has_covariance else family
            h[N_ENTRY + entry] = partial
            total = total + partial * work.extra[state]
    return total


@jit
def _fill_previous_range(work, previous_epoch, delayed, model, signals, epoch, row, channel):
    """Set the Jacobian entries of the earlier epoch of a difference; return the range (m) predicted for that epoch."""
    s = channel // model.n_kind
    antenna_state = previous_epoch.antenna[signals.antenna[epoch - 1, s]]
    ux, uy, uz, distance = line_of_sight(signals.satellite[epoch - 1, s], antenna_state)
    return subtract_earlier(
        work.H[row],
        delayed.previous_entry,
        antenna_state,
        ux,
        uy,
        uz,
        distance,
        previous_epoch.clock[0],
    )


@jit
def _fill_further(work, previous_epoch, delayed, model, signals, epoch):
    """Set the rows of the further observables: carrier phase and differences of two epochs."""
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        antenna_state = work.antenna[signals.antenna[epoch, s]]
        for kind in range(2, model.n_kind):
            row = model.n_kind * slot + kind
            channel = model.n_kind * s + kind
            if not delayed.present[epoch, channel]:
                continue
            ux, uy, uz, distance = line_of_sight(signals.satellite[epoch, s], antenna_state)
            predicted = range_row(work.H[row], antenna_state, ux, uy, uz, distance, work.clock_hat[0])
            extra_part = _add_extra(work, model, signals, epoch, row, channel)
            predicted = predicted + extra_part
            if delayed.difference[kind]:
                earlier_range = _fill_previous_range(work, previous_epoch, delayed, model, signals, epoch, row, channel)
                earlier_extra = subtract_extra(work, previous_epoch, delayed, model, signals, epoch, row, channel)
                predicted = predicted - earlier_range
                predicted = predicted - earlier_extra
            work.z[row] = work.ranges[slot, kind] - predicted


@jit
def fill_tight(work, previous_epoch, delayed, model, signals, epoch):
    """Set Jacobian rows `work.H` and innovations `work.z` (measured minus predicted) of all satellites in use.

    Each satellite has `model.n_kind` rows: pseudorange (m), range rate (m/s), then the further observables.

    Parameters
    ----------
    previous_epoch, delayed : PreviousEpoch and DifferenceProcessing of differences of two epochs; None without further
        observables
    model, signals : FilterModel, Signals
    epoch : index
    """
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        antenna_state = work.antenna[signals.antenna[epoch, s]]
        satellite_velocity = signals.satellite_velocity[epoch, s]
        ux, uy, uz, distance = line_of_sight(signals.satellite[epoch, s], antenna_state)
        row = model.n_kind * slot
        channel = model.n_kind * s
        clock_bias = work.clock_hat[0]
        predicted = range_row(work.H[row], antenna_state, ux, uy, uz, distance, clock_bias)
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        predicted = predicted + extra_part
        work.z[row] = work.ranges[slot, 0] - predicted
        row = row + 1
        channel = channel + 1
        clock_drift = work.clock_hat[1]
        predicted = rate_row(work.H[row], antenna_state, satellite_velocity, ux, uy, uz, distance, clock_drift)
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        predicted = predicted + extra_part
        work.z[row] = work.ranges[slot, 1] - predicted
    if delayed is not None:
        _fill_further(work, previous_epoch, delayed, model, signals, epoch)


@jit
def fill_loose(work, model, signals, epoch):
    """Set Jacobian rows and innovations (measured minus predicted) of a solution: position (m), velocity (m/s)."""
    for row in range(6):
        if model.has_covariance:  # decorrelation combines whole rows, so unused entries must be zero
            for e in range(model.extra_offset.shape[0]):
                work.H[row, N_ENTRY + e] = like(work.x[0], 0.0)
        predicted = receiver_solution.row(work.H[row], work.antenna[0], row)
        extra_part = _add_extra(work, model, signals, epoch, row, row)
        predicted = predicted + extra_part
        work.z[row] = work.solution[row] - predicted


@jit
def row_of(model, work, channel):
    """Return the row of a sensor channel in `work.H` and `work.z`: sensors have the last rows."""
    return work.z.shape[0] - model.n_entry.shape[0] + channel


@jit
def fill_sensor(work, state_history, late, model, signals, sensors, k, epoch):
    """Set Jacobian rows and innovations (measured minus predicted) of sensor k.

    Parameters
    ----------
    state_history : stored states. With delay compensation the prediction is that of the time of validity.
    late : DelayProcessing, or None
    model, signals, sensors : FilterModel, Signals, Sensors
    k, epoch : indices
    """
    first = row_of(model, work, sensors.channel[k])
    code = sensors.code[k]
    theta = sensors.theta[k, epoch]
    parameters = sensors.known[k, epoch]
    if late is not None and late.of_sensor[k] >= 0:
        stored = state_history[place_of(late, late.of_sensor[k], epoch)]
        fill(work.H, work.z, first, code, work.observed[k], stored, theta, parameters)
    else:
        fill(work.H, work.z, first, code, work.observed[k], work.nav, theta, parameters)
    for i in range(sensors.scalars[k]):
        row = first + i
        channel = sensors.channel[k] + i
        extra_part = _add_extra(work, model, signals, epoch, row, channel)
        work.z[row] = work.z[row] - extra_part


@jit
def n_measured(model, signals, epoch):
    """Return the number of receiver rows that the filter processes at an epoch.

    A simulated solution needs four satellites. A receiver that solves for position itself has six rows at every epoch;
    innovations without a solution are not-a-number.
    """
    if (epoch + 1) % model.every != 0 or model.n_receiver == 0:
        return 0
    if model.tight:
        return model.n_kind * signals.n_used[epoch]
    return 6 if model.solves or signals.n_used[epoch] >= 4 else 0


@jit
def channel_of(model, signals, epoch, row):
    """Return the channel of a receiver row at an epoch."""
    if model.tight:
        slot = row // model.n_kind
        observable = row % model.n_kind
        return model.n_kind * signals.used[epoch, slot] + observable
    return row


@jit
def clear_epoch(work, epoch):
    """Set the counts of an epoch to zero and its innovations to not-a-number, which means: no measurement."""
    zero = like(work.x[0], 0.0)
    work.nis[epoch] = zero
    work.n_row[epoch] = zero
    work.n_reject[epoch] = zero
    for channel in range(work.innovation.shape[1]):
        work.innovation[epoch, channel] = like(zero, np.nan)


@inlined
def fill_receiver(work, previous_epoch, delayed, model, signals, epoch):
    """Set the rows of all receiver measurements of an epoch, linearised at the same state."""
    if model.tight:
        fill_tight(work, previous_epoch, delayed, model, signals, epoch)
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
def correct(work, state_history, late, model):
    """Feed the error state back to all estimates and set it to zero (closed loop).

    Corrected are navigation state, stored states of delayed measurements, IMU parameters, clock and extra states.
    """
    x = work.x
    correct_motion(work.nav, x)
    correct_stored(state_history, late, x)  # delayed measurements are compared with corrected states
    correct_parameters(work, model)
    correct_receiver(work, model)
    processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)
    for i in range(model.n_state):
        x[i] = like(x[i], 0.0)
