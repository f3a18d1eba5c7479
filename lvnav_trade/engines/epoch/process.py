"""One epoch of the filter, for both engines: what enters, in what order, with which Jacobian, variance, delay and mode.

Monte Carlo calls it for a run, or for eight at once; linear covariance calls it on the nominal flight, where the error
state stays zero. There the joint covariance (Joint, None in a run) follows every update with the filter's gain
(`follow_update`), and tests see the mean of an innovation (`innovation_of`). `lincov/history._case` has taken out what
is none of linear covariance before: gate, direct, iterated and unscented filter, solver. An open loop is closed there.

The order is decided here. Whether something enters is decided by

- `n_measured` (filters/ekf.py): whether the receiver has rows at an epoch, and how many;
- `is_present` (filters/delayed.py): whether the filter takes a row;
- `take_reference` (below): a reference satellite, whose rows determine the clock;
- `Sensors.on` and `FilterModel.measured`: whether a sensor measures, and whether the filter takes it;
- `permitted` (filters/integrity/state.py): what tests for faults exclude;
- `process_epoch`: what a mode logic, if there is one, lets in.

Where the error state goes afterwards: filters/feedforward.py.
"""

import numpy as np

from lvnav_trade.engines.epoch.joint import follow_clock, follow_update, innovation_of, start_joint
from lvnav_trade.filters import ekf
from lvnav_trade.filters.delayed import clone_formal, correct_earlier, find_earlier, is_present, renew, store_estimate
from lvnav_trade.filters.differenced import is_reference, leave_out
from lvnav_trade.filters.ekf import channel_of, correct, n_measured
from lvnav_trade.filters.feedforward import begin_sum, compare_receiver
from lvnav_trade.filters.integrity.assess import assess
from lvnav_trade.filters.integrity.state import clear_innovations, permitted
from lvnav_trade.filters.iterated import hold, linearise_receiver, linearise_sensor
from lvnav_trade.filters.linearise import fill_receiver_rows, fill_sensor_rows, is_receiver_stored, is_sensor_stored
from lvnav_trade.filters.monitor import MODE, check_measurements, is_running, start_filter, update_mode
from lvnav_trade.filters.updates import noise_variance, update_and_count
from lvnav_trade.kernels.covariance import NOT_USED, update_with_gain
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where


@inlined
def _update_by_row(work, points, case, joint, epoch, row, channel, gate):
    """Update by one filled row of a channel."""
    weight = update_and_count(work, points, case, epoch, row, channel, gate)
    follow_update(joint, work, case, weight, epoch, row, channel)


@jit
def _predicted(work, case, epoch, row):
    """Return what the error state predicts of a row's measured minus predicted."""
    channel, total = channel_of(case.model, case.signals, epoch, row), like(work.x[0], 0.0)
    for c in range(case.model.n_entry[channel]):
        total = total + work.H[row, case.model.entry[channel, c]] * work.x[case.model.column[channel, c]]
    return total


@jit
def _expect_rows(work, case, joint, watch, epoch):
    """Set what the mode logic looks at: measured minus predicted, and what the error state predicts of it."""
    for row in range(n_measured(case.model, case.signals, epoch)):
        channel = channel_of(case.model, case.signals, epoch, row)
        watch.z[row] = innovation_of(joint, work, case.options.late, epoch, row, channel)
        watch.predicted[row] = _predicted(work, case, epoch, row)


@jit
def _assess(work, points, case, joint, monitor, gate, epoch):
    """Test an epoch's rows for faults (Monitor, or None), less what the error state says of them; gate: NOT_USED in the
    runs whose filter does not run.
    """
    if monitor is not None:
        for row in range(n_measured(case.model, case.signals, epoch)):
            channel = channel_of(case.model, case.signals, epoch, row)
            innovation = innovation_of(joint, work, case.options.late, epoch, row, channel)
            monitor.z[row] = innovation - _predicted(work, case, epoch, row)
            monitor.variance[row] = noise_variance(work, points, case, epoch, row, channel)
        assess(monitor, work, case, where(like(work.x[0], 0.0) + gate >= 0.0, 1.0, 0.0), epoch)


@jit
def take_reference(work, case, joint, monitor, epoch, limit, starts):
    """Make bias and drift of the clock, and its bias at the earlier epoch of differences, what measurements of a
    reference satellite say, and forget what was known of them.

    The other rows less the reference's follow: their clock is the reference's error, which all of them share. This is
    the difference of measurements, with the noise that differences have in common in the clock's state in place of
    off-diagonal terms to be whitened. limit: NOT_USED where nothing is taken. Runs that exclude the reference
    (Monitor, or None) keep what the clock's model predicts.
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
    """In a direct filter correct the total state by a row, and linearise the rows that are left at it. A solution with
    a covariance of its own is one measurement: it is linearised once.
    """
    if not case.model.has_covariance:
        options = case.options
        correct_earlier(work.x, parts.earlier, options.delayed, case.model)
        correct(work, parts.past, options.late, case.model)
        ekf.place_antenna(work, parts.past, options.late, case.model, case.step, epoch)
        fill_receiver_rows(work, parts, case, parts.points, options.late, epoch)


@inlined
def update_receiver(work, parts, case, joint, direct, epoch, gate_squared, starts):
    """Update by what the receiver measures at an epoch: the observables of every satellite in use, or position and
    velocity of a solution axis by axis, as far as they are among the filter's measurements and not excluded.

    direct : True in a direct filter, or None; gate_squared : NOT_USED where nothing is; starts : where the
    filter starts at this epoch (lanes), or None
    """
    model, signals, delayed = case.model, case.signals, case.options.delayed
    limit = where(gate_squared >= 0.0, np.inf, gate_squared)
    take_reference(work, case, joint, parts.monitor, epoch, limit, starts)
    for row in range(n_measured(model, signals, epoch)):
        channel = channel_of(model, signals, epoch, row)
        if is_present(delayed, model, epoch, channel) and not is_reference(model, signals, epoch, row):
            leave_out(work.z, starts, delayed, model, row)
            gate = permitted(parts.monitor, channel, gate_squared)
            _update_by_row(work, parts.points, case, joint, epoch, row, channel, gate)
            if direct is not None:
                _relinearise(work, parts, case, epoch)
    if direct is not None:
        correct(work, parts.past, case.options.late, model)


@inlined
def process_receiver(work, parts, case, joint, again, epoch, gate_squared, starts):
    """Test the filled rows of what the receiver measures for faults, and update by what is left; repeat the update with
    rows linearised at what it has found (Again, or None).

    gate_squared, starts : as of `update_receiver`
    """
    options = case.options
    ekf.decorrelate(work, parts, case, parts.rx, options.late, epoch)
    _assess(work, parts.points, case, joint, parts.monitor, gate_squared, epoch)
    hold(again, work, epoch)
    update_receiver(work, parts, case, joint, options.direct, epoch, gate_squared, starts)
    if again is not None:
        for _ in range(0 if is_receiver_stored(options.late) else options.iterated.repeats):
            linearise_receiver(work, parts, case, again, epoch)
            update_receiver(work, parts, case, joint, None, epoch, gate_squared, starts)


@inlined
def _update_sensor(work, parts, case, joint, direct, k, epoch, gate_squared):
    """Update by the filled rows of sensor k; in a direct filter (True, or None) correct the total state by each, and
    linearise those that are left at it.
    """
    first, sensors = ekf.row_of(case.model, work, case.sensors.channel[k]), case.sensors
    for i in range(sensors.scalars[k]):
        _update_by_row(work, parts.points, case, joint, epoch, first + i, sensors.channel[k] + i, gate_squared)
        if direct is not None:
            correct(work, parts.past, case.options.late, case.model)
            fill_sensor_rows(work, parts, case, parts.points, case.options.late, k, epoch)


@inlined
def _process_sensor(work, parts, case, joint, again, k, epoch, gate_squared):
    """Update by what sensor k measures, and repeat that with rows linearised at what it has found (Again, or None)."""
    late = case.options.late
    fill_sensor_rows(work, parts, case, parts.points, late, k, epoch)
    hold(again, work, epoch)
    _update_sensor(work, parts, case, joint, case.options.direct, k, epoch, gate_squared)
    if again is not None:
        for _ in range(0 if is_sensor_stored(late, k) else case.options.iterated.repeats):
            linearise_sensor(work, parts, case, again, k, epoch)
            _update_sensor(work, parts, case, joint, None, k, epoch, gate_squared)


@inlined
def _process_sensors(work, parts, case, joint, epoch, gate_squared):
    """Update by what the sensors beside the receiver measure at an epoch."""
    sensors = case.sensors
    for k in range(sensors.code.shape[0]):
        if sensors.on[k, epoch] and case.model.measured[sensors.channel[k]]:
            _process_sensor(work, parts, case, joint, parts.again, k, epoch, gate_squared)


@jit
def _sample_variance(out, rx, variance, scale, from_gnss):
    """Set the variances (6,) of a solution that a filter starts from: the receiver's, or what the filter assumes."""
    if from_gnss:
        for row in range(6):
            if rx is None:
                out[row] = like(out[0], variance[row])
            else:
                out[row] = rx.covariance[row, row] * (scale[row] * scale[row])


@inlined
def _start(work, parts, case, joint, rules, epoch):
    """Start the filter where the mode logic lets it, and let states begin anew of those that have started."""
    watch, signals = parts.watch, case.signals
    variance, scale = signals.variance[epoch], signals.scale[epoch]
    _sample_variance(watch.predicted, parts.rx, variance, scale, rules.from_gnss)
    start_filter(work.P, work.x, watch, rules, work.z)
    start_joint(joint, work, case, watch, rules, epoch)
    renew(work.P, work.x, work.extra, case.options.delayed, case.model, epoch)
    clear_innovations(parts.monitor, watch.sample[1])


@inlined
def _process_permitted(work, parts, case, joint, open_loop, rules, epoch):
    """Process the receiver's measurements at an epoch if the mode logic permits, and make its transitions."""
    model, signals, watch = case.model, case.signals, parts.watch
    n_row = n_measured(model, signals, epoch)
    if rules.good[epoch]:
        fill_receiver_rows(work, parts, case, parts.points, case.options.late, epoch)
        if open_loop is not None:
            compare_receiver(work, parts.past, case, case.options.late, epoch)
        _expect_rows(work, case, joint, watch, epoch)
    check_measurements(watch, rules, case.options.delayed, model, signals, epoch, watch.z, n_row)
    if rules.good[epoch]:
        _start(work, parts, case, joint, rules, epoch)
        used, starts = watch.sample[0] > 0.0, watch.sample[1] > 0.0
        process_receiver(
            work, parts, case, joint, parts.again, epoch, where(used, model.gate_squared, NOT_USED), starts
        )
        for row in range(n_row):
            channel = channel_of(model, signals, epoch, row)
            work.innovation[epoch, channel] = where(used, work.innovation[epoch, channel], np.nan)
    update_mode(watch, rules, epoch, work.P)


@inlined
def process_epoch(work, parts, case, joint, open_loop, sensors, rules, epoch):
    """Process what the receiver and the other sensors measure at an epoch.

    With a mode logic the receiver enters where it permits, and the sensors wait too: until the filter runs, and for the
    epochs at which it updates. What is fed back of it, and what is stored for the next epoch, follows.

    Parameters
    ----------
    work : Work of a run, or of eight in lanes, or Nominal of the nominal flight, with what is measured; updated
    parts : Parts; case : FilterCase
    joint : Joint, which follows the updates on the nominal flight; None in a run
    open_loop, sensors, rules : OpenLoop of the run, Sensors and Rules of the case; or None
    """
    options, model, gate = case.options, case.model, case.model.gate_squared
    begin_sum(open_loop, work.x)
    ekf.place_antenna(work, parts.past, options.late, model, case.step, epoch)
    find_earlier(work.P, parts.earlier, options.delayed)
    renew(work.P, work.x, work.extra, options.delayed, model, epoch)
    if rules is None:
        if n_measured(model, case.signals, epoch) > 0:
            fill_receiver_rows(work, parts, case, parts.points, options.late, epoch)
            if open_loop is not None:
                compare_receiver(work, parts.past, case, options.late, epoch)
            process_receiver(work, parts, case, joint, parts.again, epoch, gate, None)
        if sensors is not None:
            _process_sensors(work, parts, case, joint, epoch, gate)
    elif (epoch + 1) % model.every == 0:
        _process_permitted(work, parts, case, joint, open_loop, rules, epoch)
        if sensors is not None:
            gate = where(is_running(parts.watch.state[MODE]) > 0.0, gate, NOT_USED)
            _process_sensors(work, parts, case, joint, epoch, gate)


@inlined
def end_epoch(work, parts, case, epoch):
    """Store the estimate for the differences of the next epoch, and clone its error."""
    options = case.options
    store_estimate(work, parts.earlier, parts.past, options.late, options.delayed, case.model, epoch)
    clone_formal(work.P, parts.earlier, options.delayed)
