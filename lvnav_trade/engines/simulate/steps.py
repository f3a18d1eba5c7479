"""What a filter does in a flight, window by window and epoch by epoch: nothing here knows of the truth.

The flight of a run calls these steps between what is sensed and measured; so does the code that is made of a filter.
"""

from lvnav_trade.engines.simulate.redundancy import inform
from lvnav_trade.filters.backup import advance_backup, begin_backup, predict_backup
from lvnav_trade.filters.delayed import begin_transition, clone_formal, clone_open_loop, follow, store_estimate
from lvnav_trade.filters.ekf import clear_epoch
from lvnav_trade.filters.feedforward import apply_feedback, process_measurements, propagate_open_loop
from lvnav_trade.filters.integrity.state import begin_monitor
from lvnav_trade.filters.late import keep
from lvnav_trade.filters.monitor import begin_watch
from lvnav_trade.filters.samples import begin_motion, correct_vehicle, last_sample, sample_window
from lvnav_trade.filters.unscented import hold_window, predict
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.strapdown import mechanise
from lvnav_trade.kernels.transition import linearise, linearised_sums
from lvnav_trade.kernels.vehicle import N_SAMPLE


@inlined
def begin_filter(work, parts, options):
    """Begin what a filter stores beside its states; its estimate stands at the start."""
    begin_watch(parts.watch)
    begin_monitor(parts.monitor)
    begin_backup(parts.backup, work)
    begin_motion(parts.motion, options.samples)
    begin_transition(parts.earlier, options.delayed)


@inlined
def _advance(work, motion, earlier, open_loop, delayed, unit, model, vehicle, samples, first, n_tick, dt):
    """Let the filter propagate its motion over a window: by the compensated increments, or by its model of the vehicle
    with every sample as a measurement.
    """
    last_sample(work, motion, samples, n_tick, unit.dt)
    if vehicle is not None:
        sample_window(work, motion, earlier, open_loop, delayed, unit, model, vehicle, first, n_tick)
    else:
        processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], model.biases_only, unit.dt)
        how = model.strapdown
        mechanise(
            work.nav, work.sums, work.previous, work.increments, n_tick // how.subsamples, dt, how, unit.dt * first
        )


@inlined
def propagate(work, parts, schedule, unit, model, options, w):
    """Propagate the filter over window w by the increments that the unit has put out in it."""
    first, n_tick, dt = schedule.first_tick[w], schedule.n_tick[w], unit.dt * model.strapdown.subsamples
    linearise(work.rates, work.nav, schedule.linearised[w])
    advance_backup(parts.backup, work, model, n_tick, dt, unit.dt * first)
    hold_window(parts.points, work, n_tick)
    _advance(
        work, parts.motion, parts.earlier, parts.open_loop, options.delayed, unit, model, options.vehicle,
        options.samples, first, n_tick, dt,
    )  # fmt: skip
    linearised_sums(work.rates, work.sums, model.seconds[schedule.length[w]], schedule.linearised[w])
    predict(work, parts.points, parts.open_loop, model, unit, schedule, w, dt)
    inform(work.P, parts.units, options.units, model, model.seconds[schedule.length[w]])
    follow(parts.earlier, options.delayed, work.D, model, schedule.length[w], schedule.injection[w])
    predict_backup(parts.backup, work, model, schedule.length[w], schedule.injection[w])
    propagate_open_loop(work, parts.points, parts.open_loop, model, schedule.length[w], schedule.linearised[w])
    keep(parts.past, work.nav, work.previous, work.x, options.late, w, dt, model.strapdown.gravity)


@jit
def _count_samples(work, motion, vehicle, model, epoch):
    """Count the samples of the last tick before an epoch among its innovations, behind the channels of sensors."""
    if vehicle is not None:
        at = model.n_entry.shape[0]
        for i in range(N_SAMPLE):
            normalised = motion.residual[i] * sqrt(motion.weight[i])
            work.innovation[epoch, at + i] = normalised
            work.nis[epoch] = work.nis[epoch] + normalised * normalised
            work.n_row[epoch] = work.n_row[epoch] + 1.0


@inlined
def begin_epoch(work, parts, model, options, epoch):
    """Begin what is counted at an epoch."""
    clear_epoch(work, epoch)
    _count_samples(work, parts.motion, options.vehicle, model, epoch)


@inlined
def update(work, parts, unit, sensors, signals, model, options, epoch):
    """Update the filter by what is measured at an epoch."""
    process_measurements(
        work, parts.points, parts.again, parts.rx, parts.past, parts.earlier, parts.watch, parts.monitor,
        parts.open_loop, options.direct, options.iterated, options.rules, options.integrity, options.late,
        options.delayed, options.gains, sensors, model, signals, epoch, unit.dt * model.strapdown.subsamples,
    )  # fmt: skip
    correct_vehicle(work, parts.motion, model, options.vehicle)
    apply_feedback(work, parts.past, parts.open_loop, options.late, model)
    store_estimate(work, parts.earlier, parts.past, options.late, options.delayed, model, epoch)
    clone_formal(work.P, parts.earlier, options.delayed)
    clone_open_loop(work.x, parts.past, parts.open_loop, options.late, options.delayed, epoch)
