"""The forward pass of linear covariance: the filter's covariance by its own model, the true one by source."""

from lvnav_trade.engines.lincov.propagate import nominal_window, propagate
from lvnav_trade.engines.lincov.receiver_error import (
    advance_solution,
    clone_error,
    complete_rows,
    decorrelate,
    extrapolate,
)
from lvnav_trade.engines.lincov.recording import hold_solution, write, write_samples, write_solution
from lvnav_trade.engines.lincov.samples import expected_of_samples, sample_window
from lvnav_trade.engines.lincov.successive import begin_epoch, end_epoch, measure_further
from lvnav_trade.engines.lincov.units import add_sums, inform_nominal
from lvnav_trade.engines.lincov.update import is_left_out, replace_state, take_reference, update_joint
from lvnav_trade.filters.delayed import begin_transition, follow, is_present, renew
from lvnav_trade.filters.differenced import is_reference
from lvnav_trade.filters.ekf import (
    channel_of,
    fill_loose,
    fill_sensor,
    fill_tight,
    n_measured,
    place_antenna,
    row_of,
)
from lvnav_trade.filters.integrity.assess import assess
from lvnav_trade.filters.integrity.state import begin_monitor, forget, permitted
from lvnav_trade.filters.late import keep, place_of_channel
from lvnav_trade.filters.monitor import MODE, begin_watch, check_measurements, is_running, start_filter, update_mode
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import place
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.observables.sensors import measure


@jit
def record_window(tape, w, nominal):
    """Record the sums of a window and the position that its blocks were filled at."""
    for i in range(nominal.sums.shape[0]):
        tape.sums[w, i] = nominal.sums[i]
    for i in range(3):
        tape.position[w, i] = nominal.nav[7 + i]


@jit
def _measure(nominal, further, signals, sensors, differences, tight, epoch):
    """Set what is measured on the nominal flight at an epoch."""
    if tight:
        for slot in range(signals.n_used[epoch]):
            s = signals.used[epoch, slot]
            nominal.ranges[slot, 0], nominal.ranges[slot, 1] = signals.range[epoch, s], signals.rate[epoch, s]
        measure_further(nominal, further, signals, epoch)
    else:
        for axis in range(3):
            nominal.solution[axis] = signals.position[epoch, axis]
            nominal.solution[3 + axis] = signals.velocity[epoch, axis]
    if sensors is not None:
        for k in range(sensors.code.shape[0]):
            measure(nominal.observed[k], sensors.code[k], sensors.truth[k, epoch], 0.0, 0.0, 0.0)
            p = differences.pair_of[k]
            if p >= 0:
                for i in range(3):
                    nominal.observed[k, i] = differences.nominal[p, epoch, i]


@jit
def _fill(nominal, earlier, delayed, signals, model, chain, late, epoch):
    """Fill what the filter compares the receiver's measurements with."""
    if model.tight:
        fill_tight(nominal, earlier, delayed, model, signals, epoch)
    else:
        if chain is not None:
            for i in range(6):
                nominal.solution[i] = chain.point[epoch, i]
        fill_loose(nominal, model, signals, epoch)
        if chain is not None:
            complete_rows(nominal, chain, late, epoch)


@jit
def _weight(nominal, formal, model, chain, late, gains, epoch):
    """Decorrelate the rows of a solution that comes with a covariance; with stored gains they stay as they are."""
    if chain is not None:
        extrapolate(nominal, formal, late, epoch)
        if gains is None:
            decorrelate(nominal, model)


@jit
def _update(
    out, joint, scratch, tape, nominal, signals, true, model, late, gains, row, channel, variance, whitened, epoch
):
    """Update by a row of a channel, and count it."""
    square = update_joint(
        joint, scratch, tape, late, gains, nominal.H[row], nominal.z[row], epoch, channel, variance, whitened, signals,
        true, model,
    )  # fmt: skip
    out.expected_nis[epoch] += square
    out.worst_ratio[epoch] = max(out.worst_ratio[epoch], square)
    out.n_row[epoch] += 1


@jit
def _noise_variance(nominal, signals, chain, gains, row, channel, epoch):
    """Return the variance of a row's noise as the filter assumes it; see `filters.updates.noise_variance`."""
    if chain is None:
        return signals.variance[epoch, channel]
    return 1.0 if gains is None else nominal.reported[row, row]


@jit
def _update_receiver(
    out, joint, scratch, tape, nominal, signals, true, model, chain, late, delayed, monitor, gains, epoch, starts
):
    """Update by what the receiver measures at an epoch, less what is excluded (Monitor, or None); starts: whether the
    filter starts at it.
    """
    whitened, n_row = chain is not None, n_measured(model, signals, epoch)
    take_reference(joint, scratch, tape, nominal, signals, true, model, late, delayed, monitor, epoch, n_row, starts)
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        left_out = is_reference(model, signals, epoch, row) or is_left_out(starts, delayed, model, row)
        kept = permitted(monitor, channel, 1.0) > 0.0
        if kept and is_present(delayed, model, epoch, channel) and not left_out:
            variance = _noise_variance(nominal, signals, chain, gains, row, channel, epoch)
            _update(
                out, joint, scratch, tape, nominal, signals, true, model, late, gains, row, channel, variance, whitened,
                epoch,
            )  # fmt: skip


@jit
def _update_sensors(out, joint, scratch, tape, nominal, sensors, signals, true, model, late, gains, epoch):
    """Update by what the other sensors measure at an epoch."""
    if sensors is not None:
        for k in range(sensors.code.shape[0]):
            if sensors.on[k, epoch] and model.measured[sensors.channel[k]]:
                at = row_of(model, nominal, sensors.channel[k])
                fill_sensor(nominal, nominal.past, None, late, model, signals, sensors, k, at, epoch)
                for i in range(sensors.scalars[k]):
                    channel = sensors.channel[k] + i
                    _update(
                        out, joint, scratch, tape, nominal, signals, true, model, late, gains, at + i, channel,
                        signals.variance[epoch, channel], False, epoch,
                    )  # fmt: skip


@jit
def _start(joint, scratch, tape, nominal, watch, rules, signals, true, model, chain, late, epoch):
    """Start the filter on the nominal flight: its covariance as the mode logic sets it, and the error that it starts
    with, that of the sample if it starts from one.
    """
    if watch.sample[1] > 0.0:
        for row in range(6):
            watch.predicted[row] = signals.variance[epoch, row]
            if chain is not None:
                watch.predicted[row] = nominal.reported[row, row]
        start_filter(joint.formal, scratch.x, watch, rules, nominal.z)
        for i in range(model.n_state):
            scratch.x[i] = 0.0
        if rules.from_gnss:
            for row in range(6):
                at = POS + row if row < 3 else VEL + row - 3
                replace_state(
                    joint, scratch, tape, late, at, nominal.H[row], nominal.z[row], epoch, row, chain is not None,
                    signals, true,
                )  # fmt: skip


@jit
def _mean_innovation(joint, nominal, true, signals, late, row, channel, epoch):
    """Return the mean of an innovation of the receiver: that of a run without noise."""
    place, total = 0, nominal.z[row]
    if late is not None:
        place = place_of_channel(late, channel, epoch)
    for k in range(true.n_entry[channel]):
        total += nominal.H[row, true.entry[place, channel, k]] * joint.mean[true.column[place, channel, k]]
    return total


@jit
def _assess(joint, nominal, true, model, signals, chain, late, delayed, monitor, tests, running, gains, epoch):
    """Test the mean of the rows for faults (Monitor and Tests, or None), as the filter does its innovations."""
    if monitor is not None:
        for row in range(n_measured(model, signals, epoch)):
            channel = channel_of(model, signals, epoch, row)
            monitor.z[row] = _mean_innovation(joint, nominal, true, signals, late, row, channel, epoch)
            monitor.variance[row] = _noise_variance(nominal, signals, chain, gains, row, channel, epoch)
        assess(monitor, tests, joint.formal, nominal.H, monitor.z, running, delayed, model, signals, epoch)


@jit
def _expect(joint, nominal, true, model, signals, late, watch, epoch):
    """Set the mean of every innovation of the receiver: what the mode logic sees in a run without noise."""
    for row in range(n_measured(model, signals, epoch)):
        channel = channel_of(model, signals, epoch, row)
        nominal.expected[row] = _mean_innovation(joint, nominal, true, signals, late, row, channel, epoch)
        watch.predicted[row] = 0.0


@jit
def _process_permitted(
    out, joint, scratch, tape, nominal, earlier, signals, true, model, chain, late, delayed, gains, rules, watch,
    monitor, tests, epoch,
):  # fmt: skip
    """Update by what the receiver measures if the mode logic permits on the nominal flight; make its transitions."""
    solved = chain is None or chain.solved[epoch]
    good = rules.good[epoch] and solved
    if good:
        _fill(nominal, earlier, delayed, signals, model, chain, late, epoch)
        _expect(joint, nominal, true, model, signals, late, watch, epoch)
    check_measurements(
        watch, rules, delayed, model, signals, epoch, nominal.expected, n_measured(model, signals, epoch)
    )
    if good:
        _start(joint, scratch, tape, nominal, watch, rules, signals, true, model, chain, late, epoch)
        renew(joint.formal, scratch.x, nominal.extra, delayed, model, epoch)
        _weight(nominal, joint.formal, model, chain, late, gains, epoch)
        forget(monitor, watch.sample[1])
        running = watch.sample[0]
        _assess(joint, nominal, true, model, signals, chain, late, delayed, monitor, tests, running, gains, epoch)
        if watch.sample[0] > 0.0:
            _update_receiver(
                out, joint, scratch, tape, nominal, signals, true, model, chain, late, delayed, monitor, gains, epoch,
                watch.sample[1] > 0.0,
            )  # fmt: skip
    update_mode(watch, rules, epoch, joint.formal)


@jit
def _epoch(out, joint, scratch, work, tape, nominal, earlier, signals, sensors, further, true, model, dt, chain, late,
           delayed, successive, gains, rules, watch, monitor, tests, vehicle, epoch):  # fmt: skip
    """Update by what the filter would process at an epoch."""
    if vehicle is not None:
        out.expected_nis[epoch] += expected_of_samples(work, true, vehicle)
        out.n_row[epoch] += N_SAMPLE
    if model.clock >= 0:
        joint.mean[model.clock] += signals.clock_jump[epoch, 0]
        joint.mean[model.clock + 1] += signals.clock_jump[epoch, 1]
    if chain is not None:
        advance_solution(joint, scratch, chain, true, epoch)
    begin_epoch(joint, scratch, nominal, earlier, delayed, successive, true, model, epoch)
    place_antenna(nominal, nominal.past, late, model, dt, epoch)
    _measure(nominal, further, signals, sensors, true.differences, model.tight, epoch)
    if rules is None:
        solved = chain is None or chain.solved[epoch]
        if n_measured(model, signals, epoch) > 0 and solved:
            _fill(nominal, earlier, delayed, signals, model, chain, late, epoch)
            _weight(nominal, joint.formal, model, chain, late, gains, epoch)
            _assess(joint, nominal, true, model, signals, chain, late, delayed, monitor, tests, 1.0, gains, epoch)
            _update_receiver(
                out,
                joint,
                scratch,
                tape,
                nominal,
                signals,
                true,
                model,
                chain,
                late,
                delayed,
                monitor,
                gains,
                epoch,
                False,
            )
        _update_sensors(out, joint, scratch, tape, nominal, sensors, signals, true, model, late, gains, epoch)
    elif (epoch + 1) % model.every == 0:
        _process_permitted(
            out, joint, scratch, tape, nominal, earlier, signals, true, model, chain, late, delayed, gains, rules,
            watch, monitor, tests, epoch,
        )  # fmt: skip
        if is_running(watch.state[MODE]) > 0.0:
            _update_sensors(out, joint, scratch, tape, nominal, sensors, signals, true, model, late, gains, epoch)
    end_epoch(joint, nominal, earlier, late, delayed, true, model, epoch)


@jit
def _clone(joint, nominal, true, model, reference, tick, dt, late, window):
    """Store the state and clone its error, for a measurement that is on its way."""
    if late is not None:
        place(nominal.nav, reference, tick)
        keep(nominal.past, nominal.nav, nominal.previous, nominal.x, late, window, dt, model.strapdown.gravity)
        clone_error(joint, true, late, window)


@jit
def forward(
    out, joint, scratch, work, tape, nominal, earlier, schedule, unit, signals, sensors, further, record, axes_att,
    model, true, reference, chain, late, delayed, successive, gains, rules, watch, monitor, tests, vehicle, samples,
    report, units,
):  # fmt: skip
    """Propagate and update the filter's covariance and the true one, by source, over the nominal flight; fill `out`.

    Parameters
    ----------
    out : Recorded, joint : JointCovariance at the start, scratch : Scratch, work : SampleScratch, tape : Tape,
    nominal : Nominal, earlier : Earlier, or None; all updated
    schedule : Schedule, unit : Unit, signals : Signals, sensors : Sensors, record : Record, model : FilterModel,
    true : Components, axes_att : (n_hist, 3, 3) from frame i to body axes at the history times
    reference : Reference, the true motion; further : Further, chain : Chain, late : Late, delayed : Delayed, successive
    : Successive, gains : Gains, rules : Rules, watch : Watch of the nominal flight, monitor : Monitor and
    tests : Tests of the same, vehicle : VehicleModel, samples :
    Samples, report : Report, units : Units; or None
    """
    begin_watch(watch)
    begin_monitor(monitor)
    begin_transition(earlier, delayed)
    step = unit.dt * model.strapdown.subsamples
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            if vehicle is not None:
                sample_window(joint, scratch, work, tape, true, unit, units, model, vehicle, reference, first, n_tick)
            sensed, how = not true.by_samples, model.strapdown
            nominal_window(nominal, reference, unit, first, n_tick, how, sensed, schedule.linearised[w])
            propagate(joint, scratch, nominal, true, unit, units, model, schedule, w, reference)
            inform_nominal(joint.formal, units, model, first, n_tick, model.seconds[schedule.length[w]])
            follow(earlier, delayed, scratch.D, model, schedule.length[w], schedule.injection[w])
            if tape.channel.shape[0] > 0:
                record_window(tape, w, nominal)
            _clone(joint, nominal, true, model, reference, first + n_tick, step, late, w)
        epoch, hist = schedule.epoch[w], schedule.hist[w]
        if epoch >= 0 and model.aided:
            place(nominal.nav, reference, first + n_tick)
            _epoch(
                out, joint, scratch, work, tape, nominal, earlier, signals, sensors, further, true, model, step,
                chain, late, delayed, successive, gains, rules, watch, monitor, tests, vehicle, epoch,
            )  # fmt: skip
            if report is not None and chain.solved[epoch]:
                hold_solution(out, joint, true)
        if tape.channel.shape[0] > 0:
            tape.first[w + 1] = tape.used[0]
        if hist >= 0:
            write(out, hist, joint, scratch, true, axes_att[hist], record.axes[hist])
            add_sums(out, hist, joint, true, units, max(0, first + n_tick - 1))
            if samples is not None:
                write_samples(out, hist, joint, true, units, samples, max(0, first + n_tick - 1), unit.dt)
            if report is not None:
                write_solution(out, hist)
