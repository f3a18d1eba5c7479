"""One epoch of the filter, for both engines: its measurements, their order, Jacobians, variances, delays, mode logic.

Monte Carlo calls it for one run or eight lanes. Linear covariance calls it on the nominal flight, where the error state
stays zero; the joint covariance (Joint, None in a run) follows every update with the gain of the filter
(`follow_update`), and tests see the mean of an innovation (`innovation_of`). `linear_case` in
`covariance/forward_pass.py` has removed the features that linear covariance does not have: gate, direct, iterated and
unscented filter, solver. An open loop is closed there.

The order is defined here. Whether a measurement is processed depends on

- `n_measured` (filter/ekf.py): number of scalar measurements of the receiver at an epoch;
- `is_present` (filter/policies/epoch_differences.py): whether the filter processes a scalar measurement;
- `take_reference` (below): a reference satellite, whose measurements determine the clock;
- `Sensors.on` and `FilterModel.measured`: whether a sensor measures, and whether the filter processes it;
- `permitted` (filter/policies/integrity/state.py): exclusion by the fault monitor;
- `process_epoch`: the mode logic, if the filter has one.

`filter/policies/open_loop.py` applies the error state afterwards.
"""

import numpy as np

from lvnav_trade.filter import ekf
from lvnav_trade.filter.decorrelation import decorrelate
from lvnav_trade.filter.ekf import channel_of, correct, n_measured
from lvnav_trade.filter.policies.back_propagation import recover_previous_epoch
from lvnav_trade.filter.policies.epoch_differences import (
    clone_formal,
    correct_previous_epoch,
    is_present,
    renew,
    store_estimate,
)
from lvnav_trade.filter.policies.imu_samples import advance_open_loop, correct_tick, mechanise_motion, predict_samples
from lvnav_trade.filter.policies.integrity.assess import assess
from lvnav_trade.filter.policies.integrity.state import clear_innovations, permitted
from lvnav_trade.filter.policies.iterated import linearise_receiver, linearise_sensor, store_prediction
from lvnav_trade.filter.policies.linearise import (
    fill_receiver_rows,
    fill_sensor_rows,
    is_receiver_stored,
    is_sensor_stored,
)
from lvnav_trade.filter.policies.mode_logic import MODE, check_measurements, is_running, start_filter, update_mode
from lvnav_trade.filter.policies.open_loop import begin_sum, compare_receiver
from lvnav_trade.filter.policies.reference_satellite import is_reference, leave_out
from lvnav_trade.filter.updates import noise_variance, update_and_count
from lvnav_trade.kernels.covariance import NOT_USED, update_with_gain
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance, mirror, update_samples
from lvnav_trade.simulation.epoch.joint import follow_clock, follow_update, innovation_of, start_joint
from lvnav_trade.simulation.epoch.joint_ticks import (
    advance_joint,
    begin_tick,
    finish_ticks,
    nominal_tick,
    update_joint_tick,
)


@inlined
def _update_scalar(work, sigma_points, case, joint, epoch, row, channel, gate):
    """Update by one scalar measurement, in the filter and in the joint covariance."""
    weight = update_and_count(work, sigma_points, case, epoch, row, channel, gate)
    follow_update(joint, work, case, weight, epoch, row, channel)


@jit
def _predicted_innovation(work, case, epoch, row):
    """Return the innovation that the error state predicts for a scalar measurement, h x."""
    model = case.model
    channel = channel_of(model, case.signals, epoch, row)
    h = work.H[row]
    total = like(work.x[0], 0.0)
    for c in range(model.n_entry[channel]):
        entry = model.entry[channel, c]
        state = model.column[channel, c]
        total = total + h[entry] * work.x[state]
    return total


@jit
def _predict_innovations(work, case, joint, mode_state, epoch):
    """Set the inputs of the mode logic: measured minus predicted, and its prediction by the error state."""
    model = case.model
    signals = case.signals
    late = case.options.late
    for row in range(n_measured(model, signals, epoch)):
        channel = channel_of(model, signals, epoch, row)
        mode_state.z[row] = innovation_of(joint, work, late, epoch, row, channel)
        mode_state.predicted[row] = _predicted_innovation(work, case, epoch, row)


@jit
def _assess(work, sigma_points, case, joint, monitor, gate, epoch):
    """Test the innovations of an epoch for faults (Monitor, or None), after subtracting their prediction by the error
    state. gate : NOT_USED in the runs whose filter does not run.
    """
    if monitor is not None:
        model = case.model
        signals = case.signals
        late = case.options.late
        for row in range(n_measured(model, signals, epoch)):
            channel = channel_of(model, signals, epoch, row)
            innovation = innovation_of(joint, work, late, epoch, row, channel)
            predicted = _predicted_innovation(work, case, epoch, row)
            monitor.z[row] = innovation - predicted
            monitor.variance[row] = noise_variance(work, sigma_points, case, epoch, row, channel)
        is_used = like(work.x[0], 0.0) + gate >= 0.0
        assess(monitor, work, case, where(is_used, 1.0, 0.0), epoch)


@jit
def take_reference(work, case, joint, monitor, epoch, limit, starts):
    """Determine the clock states by the measurements of the reference satellite, without memory of earlier estimates.

    The states are bias, drift and, for differences of two epochs, the bias at the earlier epoch. This is equivalent to
    differencing the other satellites with the reference: the noise that the differences have in common is in the clock
    state, instead of in off-diagonal terms of R (see `filter.policies.reference_satellite`).

    Parameters
    ----------
    work, case, joint, epoch : as in `process_epoch`
    monitor : Monitor, or None. Runs that exclude the reference keep the predicted clock.
    limit : inf, or NOT_USED where no measurement is processed
    starts : condition by lane, whether the filter starts at this epoch; None without a mode logic
    """
    model, signals = case.model, case.signals
    for k in range(signals.reference.shape[1]):
        if signals.reference[epoch, k] >= 0 and n_measured(model, signals, epoch) > 0:
            row = model.n_kind * signals.reference[epoch, k] + k
            channel = channel_of(model, signals, epoch, row)
            if model.measured[channel]:
                leave_out(work.z, starts, case.options.delayed, model, row)
                n = model.n_entry[channel]
                _, weight = update_with_gain(
                    work.P,
                    work.x,
                    work.K,
                    work.H[row],
                    model.entry[channel, :n],
                    model.column[channel, :n],
                    model.clock_gain[k],
                    work.z[row],
                    like(work.x[0], signals.variance[epoch, channel]),
                    permitted(monitor, channel, limit),
                    model.n_state,
                )
                follow_clock(joint, work, case, weight, epoch, row, k)


@inlined
def _relinearise(work, parts, case, epoch):
    """Correct the total state of a direct filter after a scalar measurement, and linearise the others there.

    A solution with a reported covariance is one vector measurement, so it is linearised once.
    """
    model = case.model
    if not model.has_covariance:
        options = case.options
        late = options.late
        correct_previous_epoch(work.x, parts.previous_epoch, options.delayed, model)
        correct(work, parts.state_history, late, model)
        ekf.place_antenna(work, parts.state_history, late, model, case.step, epoch)
        fill_receiver_rows(work, parts, case, parts.sigma_points, late, epoch)


@inlined
def update_receiver(work, parts, case, joint, direct, epoch, gate_squared, starts):
    """Update by the receiver's measurements of an epoch, scalar by scalar.

    They are the observables of all satellites in use, or the axes of position and velocity of a solution, if the filter
    processes them and the fault monitor does not exclude them.

    Parameters
    ----------
    work, parts, case, joint : as in `process_epoch`
    direct : True in a direct filter, or None
    epoch : index
    gate_squared : gate of the filter, NOT_USED where no measurement is processed
    starts : condition by lane, whether the filter starts at this epoch; None without a mode logic
    """
    model = case.model
    signals = case.signals
    delayed = case.options.delayed
    limit = where(gate_squared >= 0.0, np.inf, gate_squared)
    take_reference(work, case, joint, parts.monitor, epoch, limit, starts)
    for row in range(n_measured(model, signals, epoch)):
        channel = channel_of(model, signals, epoch, row)
        if is_present(delayed, model, epoch, channel) and not is_reference(model, signals, epoch, row):
            leave_out(work.z, starts, delayed, model, row)
            gate = permitted(parts.monitor, channel, gate_squared)
            _update_scalar(work, parts.sigma_points, case, joint, epoch, row, channel, gate)
            if direct is not None:
                _relinearise(work, parts, case, epoch)
    if direct is not None:
        correct(work, parts.state_history, case.options.late, model)


@inlined
def process_receiver(work, parts, case, joint, iteration, epoch, gate_squared, starts):
    """Decorrelate the receiver's measurements, test them for faults and update; an iterated filter repeats the update.

    iteration : IterationWork of an iterated filter, which linearises at the result of the last update; None otherwise
    work, parts, case, joint, epoch, gate_squared, starts : as in `update_receiver`
    """
    options = case.options
    late = options.late
    decorrelate(work, parts, case, parts.receiver, late, epoch)
    _assess(work, parts.sigma_points, case, joint, parts.monitor, gate_squared, epoch)  # may inflate the covariance
    store_prediction(iteration, work, epoch)  # so every pass starts from the inflated prediction
    update_receiver(work, parts, case, joint, options.direct, epoch, gate_squared, starts)
    if iteration is not None:
        repeats = 0 if is_receiver_stored(late) else options.iterated.repeats
        for _ in range(repeats):
            linearise_receiver(work, parts, case, iteration, epoch)
            update_receiver(work, parts, case, joint, None, epoch, gate_squared, starts)


@inlined
def _update_sensor(work, parts, case, joint, direct, k, epoch, gate_squared):
    """Update by the scalar measurements of sensor k. A direct filter (True, or None) corrects the total state after
    each of them, and linearises the others there.
    """
    sensors = case.sensors
    sigma_points = parts.sigma_points
    late = case.options.late
    first_channel = sensors.channel[k]
    first_row = ekf.row_of(case.model, work, first_channel)
    for i in range(sensors.scalars[k]):
        row = first_row + i
        channel = first_channel + i
        _update_scalar(work, sigma_points, case, joint, epoch, row, channel, gate_squared)
        if direct is not None:
            correct(work, parts.state_history, late, case.model)
            fill_sensor_rows(work, parts, case, sigma_points, late, k, epoch)


@inlined
def _process_sensor(work, parts, case, joint, iteration, k, epoch, gate_squared):
    """Update by the measurements of sensor k; an iterated filter (IterationWork, or None) repeats the update."""
    options = case.options
    late = options.late
    fill_sensor_rows(work, parts, case, parts.sigma_points, late, k, epoch)
    store_prediction(iteration, work, epoch)
    _update_sensor(work, parts, case, joint, options.direct, k, epoch, gate_squared)
    if iteration is not None:
        repeats = 0 if is_sensor_stored(late, k) else options.iterated.repeats
        for _ in range(repeats):
            linearise_sensor(work, parts, case, iteration, k, epoch)
            _update_sensor(work, parts, case, joint, None, k, epoch, gate_squared)


@inlined
def _process_sensors(work, parts, case, joint, epoch, gate_squared):
    """Update by the measurements of all sensors other than the receiver at an epoch."""
    sensors = case.sensors
    measured = case.model.measured
    for k in range(sensors.code.shape[0]):
        channel = sensors.channel[k]
        if sensors.on[k, epoch] and measured[channel]:
            _process_sensor(work, parts, case, joint, parts.iteration, k, epoch, gate_squared)


@jit
def _sample_variance(out, receiver, variance, scale, from_gnss):
    """Set the variances (6,) of the solution from which a filter starts: reported by the receiver (Receiver), or of
    the filter model (None).
    """
    if from_gnss:
        for row in range(6):
            if receiver is None:
                out[row] = like(out[0], variance[row])
            else:
                out[row] = receiver.covariance[row, row] * (scale[row] * scale[row])


@inlined
def _start(work, parts, case, joint, rules, epoch):
    """Start the filter where the mode logic permits, and reset the states that begin at this epoch."""
    mode_state = parts.mode_state
    signals = case.signals
    variance = signals.variance[epoch]
    scale = signals.scale[epoch]
    _sample_variance(mode_state.predicted, parts.receiver, variance, scale, rules.from_gnss)
    start_filter(work.P, work.x, mode_state, rules, work.z)
    start_joint(joint, work, case, mode_state, rules, epoch)
    renew(work.P, work.x, work.extra, case.options.delayed, case.model, epoch)
    clear_innovations(parts.monitor, mode_state.sample[1])


@inlined
def _process_permitted(work, parts, case, joint, open_loop, rules, epoch):
    """Process the receiver's measurements of an epoch if the mode logic permits, then update its mode."""
    model = case.model
    signals = case.signals
    options = case.options
    mode_state = parts.mode_state
    n_row = n_measured(model, signals, epoch)
    if rules.good[epoch]:
        fill_receiver_rows(work, parts, case, parts.sigma_points, options.late, epoch)
        if open_loop is not None:
            compare_receiver(work, parts.state_history, case, options.late, epoch)
        _predict_innovations(work, case, joint, mode_state, epoch)
    check_measurements(mode_state, rules, options.delayed, model, signals, epoch, mode_state.z, n_row)
    if rules.good[epoch]:
        _start(work, parts, case, joint, rules, epoch)
        is_used = mode_state.sample[0] > 0.0
        starts = mode_state.sample[1] > 0.0
        gate_squared = where(is_used, model.gate_squared, NOT_USED)
        process_receiver(work, parts, case, joint, parts.iteration, epoch, gate_squared, starts)
        # innovations of a sample that the logic rejects are not results
        for row in range(n_row):
            channel = channel_of(model, signals, epoch, row)
            innovation = work.innovation[epoch, channel]
            work.innovation[epoch, channel] = where(is_used, innovation, np.nan)
    update_mode(mode_state, rules, epoch, work.P)


@inlined
def process_epoch(work, parts, case, joint, open_loop, sensors, rules, epoch):
    """Process the measurements of the receiver and of the other sensors at an epoch.

    With a mode logic, the receiver is processed if the logic permits. The other sensors are processed once the filter
    runs, and at its update epochs only. Feedback and `end_epoch` follow.

    Parameters
    ----------
    work : Work of one run or eight lanes, or Nominal of the nominal flight, with the measurements; updated in place
    parts : OptionalState, arrays of the optional features
    case : FilterCase
    joint : Joint, which follows the updates on the nominal flight; None in a run
    open_loop : OpenLoop of the run; None in a closed loop
    sensors : Sensors of the case; None without
    rules : ModeRules of the mode logic; None without
    epoch : index
    """
    options = case.options
    model = case.model
    gate = case.model.gate_squared
    begin_sum(open_loop, work.x)
    ekf.place_antenna(work, parts.state_history, options.late, model, case.step, epoch)
    # clones are computed and extra states reset before the first update of the epoch
    recover_previous_epoch(work.P, parts.previous_epoch, options.delayed)
    renew(work.P, work.x, work.extra, options.delayed, model, epoch)
    if rules is None:
        if n_measured(model, case.signals, epoch) > 0:
            fill_receiver_rows(work, parts, case, parts.sigma_points, options.late, epoch)
            if open_loop is not None:
                compare_receiver(work, parts.state_history, case, options.late, epoch)
            process_receiver(work, parts, case, joint, parts.iteration, epoch, gate, None)
        if sensors is not None:
            _process_sensors(work, parts, case, joint, epoch, gate)
    elif (epoch + 1) % model.every == 0:
        _process_permitted(work, parts, case, joint, open_loop, rules, epoch)
        if sensors is not None:
            gate = where(is_running(parts.mode_state.state[MODE]) > 0.0, gate, NOT_USED)
            _process_sensors(work, parts, case, joint, epoch, gate)


@inlined
def end_epoch(work, parts, case, epoch):
    """Store the estimate for the differences of the next epoch, and clone its error."""
    options = case.options
    delayed = options.delayed
    previous_epoch = parts.previous_epoch
    store_estimate(work, previous_epoch, parts.state_history, options.late, delayed, case.model, epoch)
    clone_formal(work.P, previous_epoch, delayed)


@inlined
def _run_tick(run, work, parts, case, tick):
    """Correct the estimates of a run (run number, or None) after a tick, and integrate the estimated motion."""
    if run is not None:
        correct_tick(work, parts, case)
        mechanise_motion(work, parts.motion, case, tick)


@jit
def _joint_tick(joint, flight, work, motion, case, tick):
    """Update the joint covariance (Joint, or None) by the samples of a tick, and set the integrals over the tick."""
    if joint is not None:
        options = case.options
        update_joint_tick(joint, flight, motion, case.model, options.vehicle, options.units, tick)
        nominal_tick(work.sums, flight.reference, tick, case.tick)


@inlined
def sample_window(work, parts, case, joint, flight, w):
    """Update by the IMU samples of window w, tick by tick, and propagate the estimated motion over each tick.

    Slow effects (gravity gradient, decay, clock) are propagated at the end of the window, see `filter.model`.

    Parameters
    ----------
    work, parts, case : as in `process.process_epoch`
    joint, flight : Joint and NominalFlight of linear covariance, where samples are as predicted; None in a run
    w : window
    """
    vehicle = case.options.vehicle
    motion = parts.motion
    first = case.schedule.first_tick[w]
    first_motion = vehicle.motion
    for k in range(case.schedule.n_tick[w]):
        tick = first + k
        predict_samples(parts.run, work, motion, vehicle, k, case.tick)
        begin_tick(joint, motion, vehicle, tick)
        for i in range(N_SAMPLE):
            state = first_motion + i
            work.P[state, state] = work.P[state, state] + vehicle.walk[tick, i]
        update_samples(
            work.P,
            work.x,
            motion.K,
            motion.weight,
            motion.residual,
            motion.z,
            vehicle.variance,
            motion.h,
            vehicle.columns,
            case.model.n_estimated,
        )
        _run_tick(parts.run, work, parts, case, tick)
        _joint_tick(joint, flight, work, motion, case, tick)
        advance(work.P, motion.moved, work.sums, case.tick, first_motion)
        advance_open_loop(parts.open_loop, work.x, work.sums, case.tick, first_motion)
        advance_joint(joint, flight, work.sums, case.tick, first_motion)
    mirror(work.P)
    finish_ticks(joint)
