"""One epoch of the filter, for both engines: its measurements, their order, Jacobians, variances, delays, mode logic.

Monte Carlo calls it for one run or eight lanes. Linear covariance calls it on the nominal flight, where the error state
stays zero; the joint covariance (Joint, None in a run) follows every update with the gain of the filter
(`follow_update`), and tests see the mean of an innovation (`innovation_of`). `linear_case` in
`covariance/forward_pass.py` has removed the features that linear covariance does not have: gate, direct, iterated and
unscented filter, solver. An open loop is closed there.

The order is defined here. Whether a measurement is processed depends on

- `receiver_row_count` (filter/ekf.py): number of scalar measurements of the receiver at an epoch;
- `is_present` (filter/policies/epoch_differences.py): whether the filter processes a scalar measurement;
- `take_reference` (below): a reference satellite, whose measurements determine the clock;
- `Sensors.is_measuring` and `FilterModel.is_processed`: whether a sensor measures, and whether the filter processes it;
- `channel_gate` (filter/policies/integrity/state.py): exclusion by the fault monitor;
- `process_epoch`: the mode logic, if the filter has one.

`filter/policies/open_loop.py` applies the error state afterwards.
"""

import numpy as np

from lvnav_trade.filter import ekf
from lvnav_trade.filter.decorrelation import decorrelate
from lvnav_trade.filter.ekf import correct, receiver_channel, receiver_row_count
from lvnav_trade.filter.policies.back_propagation import recover_previous_epoch
from lvnav_trade.filter.policies.epoch_differences import (
    clone_covariance,
    correct_previous_epoch,
    is_present,
    reset_states,
    store_estimate,
)
from lvnav_trade.filter.policies.imu_samples import advance_open_loop, correct_tick, mechanise_motion, predict_samples
from lvnav_trade.filter.policies.integrity.assess import assess
from lvnav_trade.filter.policies.integrity.state import channel_gate, clear_innovations
from lvnav_trade.filter.policies.iterated import linearise_receiver, linearise_sensor, store_prediction
from lvnav_trade.filter.policies.linearise import (
    fill_receiver_rows,
    fill_sensor_rows,
    is_receiver_stored,
    is_sensor_stored,
)
from lvnav_trade.filter.policies.mode_logic import MODE, check_measurements, is_running, start_filter, update_mode
from lvnav_trade.filter.policies.open_loop import compare_receiver, store_prior_state
from lvnav_trade.filter.policies.reference_satellite import clear_first_difference, is_reference
from lvnav_trade.filter.updates import noise_variance, update_and_count
from lvnav_trade.kernels.covariance import CLOSED_GATE, update_with_gain
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance, mirror, update_samples
from lvnav_trade.simulation.epoch.joint import follow_clock, follow_update, innovation_of, start_joint
from lvnav_trade.simulation.epoch.joint_ticks import (
    advance_joint,
    begin_tick,
    finish_ticks,
    nominal_tick,
    update_joint_tick,
)


@inline_jit
def _update_scalar(work, sigma_points, case, joint, epoch, row, channel, gate_squared):
    """Update by one scalar measurement, in the filter and in the joint covariance."""
    weight = update_and_count(work, sigma_points, case, epoch, row, channel, gate_squared)
    follow_update(joint, work, case, weight, epoch, row, channel)


@jit
def _predicted_innovation(work, case, epoch, row):
    """Return the innovation that the error state predicts for a scalar measurement, h x."""
    model = case.model
    channel = receiver_channel(model, case.signals, epoch, row)
    h = work.H[row]
    total = number_like(work.x[0], 0.0)
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
    delays = case.options.delay_processing
    for row in range(receiver_row_count(model, signals, epoch)):
        channel = receiver_channel(model, signals, epoch, row)
        mode_state.z[row] = innovation_of(joint, work, delays, epoch, row, channel)
        mode_state.predicted_innovation[row] = _predicted_innovation(work, case, epoch, row)


@jit
def _assess(work, sigma_points, case, joint, monitor, gate_squared, epoch):
    """Test the innovations of an epoch for faults (Monitor, or None), after subtracting their prediction by the error
    state. gate_squared : CLOSED_GATE in the runs whose filter does not run.
    """
    if monitor is not None:
        model = case.model
        signals = case.signals
        delays = case.options.delay_processing
        for row in range(receiver_row_count(model, signals, epoch)):
            channel = receiver_channel(model, signals, epoch, row)
            innovation = innovation_of(joint, work, delays, epoch, row, channel)
            predicted_innovation = _predicted_innovation(work, case, epoch, row)
            monitor.z[row] = innovation - predicted_innovation
            monitor.variance[row] = noise_variance(work, sigma_points, case, epoch, row, channel)
        is_used = number_like(work.x[0], 0.0) + gate_squared >= 0.0
        assess(monitor, work, case, where(is_used, 1.0, 0.0), epoch)


@jit
def take_reference(work, case, joint, monitor, epoch, gate_squared, is_starting):
    """Determine the clock states by the measurements of the reference satellite, without memory of earlier estimates.

    The states are bias, drift and, for differences of two epochs, the bias at the earlier epoch. This is equivalent to
    differencing the other satellites with the reference: the noise that the differences have in common is in the clock
    state, instead of in off-diagonal terms of R (see `filter.policies.reference_satellite`).

    Parameters
    ----------
    work, case, joint, epoch : as in `process_epoch`
    monitor : Monitor, or None. Runs that exclude the reference keep the predicted clock.
    gate_squared : inf, or CLOSED_GATE where no measurement is processed
    is_starting : condition by lane, whether the filter starts at this epoch; None without a mode logic
    """
    model, signals = case.model, case.signals
    for k in range(signals.reference.shape[1]):
        if signals.reference[epoch, k] >= 0 and receiver_row_count(model, signals, epoch) > 0:
            row = model.n_observable * signals.reference[epoch, k] + k
            channel = receiver_channel(model, signals, epoch, row)
            if model.is_processed[channel]:
                clear_first_difference(work.z, is_starting, case.options.differences, model, row)
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
                    number_like(work.x[0], signals.variance[epoch, channel]),
                    channel_gate(monitor, channel, gate_squared),
                    model.n_state,
                )
                follow_clock(joint, work, case, weight, epoch, row, k)


@inline_jit
def _relinearise(work, optional_state, case, epoch):
    """Correct the total state of a direct filter after a scalar measurement, and linearise the others there.

    A solution with a reported covariance is one vector measurement, so it is linearised once.
    """
    model = case.model
    if not model.has_reported_covariance:
        options = case.options
        delays = options.delay_processing
        correct_previous_epoch(work.x, optional_state.previous_epoch, options.differences, model)
        correct(work, optional_state.state_history, delays, model)
        ekf.place_antenna(work, optional_state.state_history, delays, model, case.step, epoch)
        fill_receiver_rows(work, optional_state, case, optional_state.sigma_points, delays, epoch)


@inline_jit
def update_receiver(work, optional_state, case, joint, direct, epoch, gate_squared, is_starting):
    """Update by the receiver's measurements of an epoch, scalar by scalar.

    They are the observables of all satellites in use, or the axes of position and velocity of a solution, if the filter
    processes them and the fault monitor does not exclude them.

    Parameters
    ----------
    work, optional_state, case, joint : as in `process_epoch`
    direct : True in a direct filter, or None
    epoch : index
    gate_squared : gate of the filter, CLOSED_GATE where no measurement is processed
    is_starting : condition by lane, whether the filter starts at this epoch; None without a mode logic
    """
    model = case.model
    signals = case.signals
    differences = case.options.differences
    reference_gate_squared = where(gate_squared >= 0.0, np.inf, gate_squared)
    take_reference(work, case, joint, optional_state.monitor, epoch, reference_gate_squared, is_starting)
    for row in range(receiver_row_count(model, signals, epoch)):
        channel = receiver_channel(model, signals, epoch, row)
        if is_present(differences, model, epoch, channel) and not is_reference(model, signals, epoch, row):
            clear_first_difference(work.z, is_starting, differences, model, row)
            channel_gate_squared = channel_gate(optional_state.monitor, channel, gate_squared)
            _update_scalar(work, optional_state.sigma_points, case, joint, epoch, row, channel, channel_gate_squared)
            if direct is not None:
                _relinearise(work, optional_state, case, epoch)
    if direct is not None:
        correct(work, optional_state.state_history, case.options.delay_processing, model)


@inline_jit
def process_receiver(work, optional_state, case, joint, iteration, epoch, gate_squared, is_starting):
    """Decorrelate the receiver's measurements, test them for faults and update; an iterated filter repeats the update.

    iteration : IterationWork of an iterated filter, which linearises at the result of the last update; None otherwise
    work, optional_state, case, joint, epoch, gate_squared, is_starting : as in `update_receiver`
    """
    options = case.options
    delays = options.delay_processing
    decorrelate(work, optional_state, case, optional_state.receiver, delays, epoch)
    # the tests may inflate the covariance, so every pass starts from the inflated prediction
    _assess(work, optional_state.sigma_points, case, joint, optional_state.monitor, gate_squared, epoch)
    store_prediction(iteration, work, epoch)
    update_receiver(work, optional_state, case, joint, options.direct, epoch, gate_squared, is_starting)
    if iteration is not None:
        repeats = 0 if is_receiver_stored(delays) else options.iteration_settings.repeats
        for _ in range(repeats):
            linearise_receiver(work, optional_state, case, iteration, epoch)
            update_receiver(work, optional_state, case, joint, None, epoch, gate_squared, is_starting)


@inline_jit
def _update_sensor(work, optional_state, case, joint, direct, k, epoch, gate_squared):
    """Update by the scalar measurements of sensor k. A direct filter (True, or None) corrects the total state after
    each of them, and linearises the others there.
    """
    sensors = case.sensors
    sigma_points = optional_state.sigma_points
    delays = case.options.delay_processing
    first_channel = sensors.channel[k]
    first_row = ekf.sensor_row(case.model, work, first_channel)
    for i in range(sensors.scalars[k]):
        row = first_row + i
        channel = first_channel + i
        _update_scalar(work, sigma_points, case, joint, epoch, row, channel, gate_squared)
        if direct is not None:
            correct(work, optional_state.state_history, delays, case.model)
            fill_sensor_rows(work, optional_state, case, sigma_points, delays, k, epoch)


@inline_jit
def _process_sensor(work, optional_state, case, joint, iteration, k, epoch, gate_squared):
    """Update by the measurements of sensor k; an iterated filter (IterationWork, or None) repeats the update."""
    options = case.options
    delays = options.delay_processing
    fill_sensor_rows(work, optional_state, case, optional_state.sigma_points, delays, k, epoch)
    store_prediction(iteration, work, epoch)
    _update_sensor(work, optional_state, case, joint, options.direct, k, epoch, gate_squared)
    if iteration is not None:
        repeats = 0 if is_sensor_stored(delays, k) else options.iteration_settings.repeats
        for _ in range(repeats):
            linearise_sensor(work, optional_state, case, iteration, k, epoch)
            _update_sensor(work, optional_state, case, joint, None, k, epoch, gate_squared)


@inline_jit
def _process_sensors(work, optional_state, case, joint, epoch, gate_squared):
    """Update by the measurements of all sensors other than the receiver at an epoch."""
    sensors = case.sensors
    is_processed = case.model.is_processed
    for k in range(sensors.code.shape[0]):
        channel = sensors.channel[k]
        if sensors.is_measuring[k, epoch] and is_processed[channel]:
            _process_sensor(work, optional_state, case, joint, optional_state.iteration, k, epoch, gate_squared)


@jit
def _set_solution_variance(out, receiver, variance, scale, from_gnss):
    """Set the variances (6,) of the solution from which a filter starts: reported by the receiver (Receiver), or of
    the filter model (None).
    """
    if from_gnss:
        for row in range(6):
            if receiver is None:
                out[row] = number_like(out[0], variance[row])
            else:
                out[row] = receiver.covariance[row, row] * (scale[row] * scale[row])


@inline_jit
def _start(work, optional_state, case, joint, rules, epoch):
    """Start the filter where the mode logic permits, and reset the states that begin at this epoch."""
    mode_state = optional_state.mode_state
    signals = case.signals
    variance = signals.variance[epoch]
    scale = signals.scale[epoch]
    _set_solution_variance(mode_state.predicted_innovation, optional_state.receiver, variance, scale, rules.from_gnss)
    start_filter(work.P, work.x, mode_state, rules, work.z)
    start_joint(joint, work, case, mode_state, rules, epoch)
    reset_states(work.P, work.x, work.extra, case.options.differences, case.model, epoch)
    clear_innovations(optional_state.monitor, mode_state.sample[1])


@inline_jit
def _process_with_mode_logic(work, optional_state, case, joint, open_loop, rules, epoch):
    """Process the receiver's measurements of an epoch if the mode logic permits, then update its mode."""
    model = case.model
    signals = case.signals
    options = case.options
    mode_state = optional_state.mode_state
    n_row = receiver_row_count(model, signals, epoch)
    if rules.is_good[epoch]:
        fill_receiver_rows(work, optional_state, case, optional_state.sigma_points, options.delay_processing, epoch)
        if open_loop is not None:
            compare_receiver(work, optional_state.state_history, case, options.delay_processing, epoch)
        _predict_innovations(work, case, joint, mode_state, epoch)
    check_measurements(mode_state, rules, options.differences, model, signals, epoch, mode_state.z, n_row)
    if rules.is_good[epoch]:
        _start(work, optional_state, case, joint, rules, epoch)
        is_used = mode_state.sample[0] > 0.0
        is_starting = mode_state.sample[1] > 0.0
        gate_squared = where(is_used, model.gate_squared, CLOSED_GATE)
        process_receiver(work, optional_state, case, joint, optional_state.iteration, epoch, gate_squared, is_starting)
        # innovations of a sample that the logic rejects are not results
        for row in range(n_row):
            channel = receiver_channel(model, signals, epoch, row)
            innovation = work.innovation[epoch, channel]
            work.innovation[epoch, channel] = where(is_used, innovation, np.nan)
    update_mode(mode_state, rules, epoch, work.P)


@inline_jit
def process_epoch(work, optional_state, case, joint, open_loop, sensors, rules, epoch):
    """Process the measurements of the receiver and of the other sensors at an epoch.

    With a mode logic, the receiver is processed if the logic permits. The other sensors are processed once the filter
    runs, and at its update epochs only. Feedback and `end_epoch` follow.

    Parameters
    ----------
    work : Work of one run or eight lanes, or Nominal of the nominal flight, with the measurements; updated in place
    optional_state : OptionalState, arrays of the optional features
    case : FilterCase
    joint : Joint, which follows the updates on the nominal flight; None in a run
    open_loop : OpenLoop of the run; None in a closed loop
    sensors : Sensors of the case; None without
    rules : ModeRules of the mode logic; None without
    epoch : index
    """
    options = case.options
    model = case.model
    gate_squared = case.model.gate_squared
    store_prior_state(open_loop, work.x)
    ekf.place_antenna(work, optional_state.state_history, options.delay_processing, model, case.step, epoch)
    # clones are computed and extra states reset before the first update of the epoch
    recover_previous_epoch(work.P, optional_state.previous_epoch, options.differences)
    reset_states(work.P, work.x, work.extra, options.differences, model, epoch)
    if rules is None:
        if receiver_row_count(model, case.signals, epoch) > 0:
            fill_receiver_rows(work, optional_state, case, optional_state.sigma_points, options.delay_processing, epoch)
            if open_loop is not None:
                compare_receiver(work, optional_state.state_history, case, options.delay_processing, epoch)
            process_receiver(work, optional_state, case, joint, optional_state.iteration, epoch, gate_squared, None)
        if sensors is not None:
            _process_sensors(work, optional_state, case, joint, epoch, gate_squared)
    elif (epoch + 1) % model.decimation == 0:
        _process_with_mode_logic(work, optional_state, case, joint, open_loop, rules, epoch)
        if sensors is not None:
            gate_squared = where(is_running(optional_state.mode_state.state[MODE]) > 0.0, gate_squared, CLOSED_GATE)
            _process_sensors(work, optional_state, case, joint, epoch, gate_squared)


@inline_jit
def end_epoch(work, optional_state, case, epoch):
    """Store the estimate for the differences of the next epoch, and clone its error."""
    options = case.options
    differences = options.differences
    previous_epoch = optional_state.previous_epoch
    store_estimate(
        work, previous_epoch, optional_state.state_history, options.delay_processing, differences, case.model, epoch
    )
    clone_covariance(work.P, previous_epoch, differences)


@inline_jit
def _run_tick(run, work, optional_state, case, tick):
    """Correct the estimates of a run (run number, or None) after a tick, and integrate the estimated motion."""
    if run is not None:
        correct_tick(work, optional_state, case)
        mechanise_motion(work, optional_state.motion, case, tick)


@jit
def _joint_tick(joint, flight, work, motion, case, tick):
    """Update the joint covariance (Joint, or None) by the samples of a tick, and set the integrals over the tick."""
    if joint is not None:
        options = case.options
        update_joint_tick(joint, flight, motion, case.model, options.vehicle, options.imu_array, tick)
        nominal_tick(work.sums, flight.reference, tick, case.tick)


@inline_jit
def sample_window(work, optional_state, case, joint, flight, w):
    """Update by the IMU samples of window w, tick by tick, and propagate the estimated motion over each tick.

    Slow effects (gravity gradient, decay, clock) are propagated at the end of the window, see `filter.model`.

    Parameters
    ----------
    work, optional_state, case : as in `process.process_epoch`
    joint, flight : Joint and NominalFlight of linear covariance, where samples are as predicted; None in a run
    w : window
    """
    vehicle = case.options.vehicle
    motion = optional_state.motion
    first = case.schedule.first_tick[w]
    first_motion = vehicle.motion
    for k in range(case.schedule.n_tick[w]):
        tick = first + k
        predict_samples(optional_state.run, work, motion, vehicle, k, case.tick)
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
        _run_tick(optional_state.run, work, optional_state, case, tick)
        _joint_tick(joint, flight, work, motion, case, tick)
        advance(work.P, motion.covariance_scratch, work.sums, case.tick, first_motion)
        advance_open_loop(optional_state.open_loop, work.x, work.sums, case.tick, first_motion)
        advance_joint(joint, flight, work.sums, case.tick, first_motion)
    mirror(work.P)
    finish_ticks(joint)
