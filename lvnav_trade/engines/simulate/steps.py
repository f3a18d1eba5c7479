"""Filter side of a run, window by window and epoch by epoch, without access to the truth.

The flight of a run calls these steps between what is sensed and what is measured.
"""

from lvnav_trade.engines.epoch.process import end_epoch, process_epoch
from lvnav_trade.engines.epoch.ticks import sample_window
from lvnav_trade.engines.simulate.redundancy import inform
from lvnav_trade.filters.backup import advance_backup, begin_backup, predict_backup
from lvnav_trade.filters.delayed import accumulate_transition, begin_transition, clone_open_loop
from lvnav_trade.filters.ekf import clear_epoch
from lvnav_trade.filters.feedforward import apply_feedback, propagate_open_loop
from lvnav_trade.filters.integrity.state import begin_monitor
from lvnav_trade.filters.late import keep
from lvnav_trade.filters.linearise import propagate_estimate
from lvnav_trade.filters.monitor import begin_watch
from lvnav_trade.filters.samples import begin_motion, correct_vehicle, last_sample
from lvnav_trade.filters.unscented import hold_window
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.mechanisation import mechanise
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
def _advance(work, parts, case, vehicle, w):
    """Let the filter propagate its motion over window w: by the compensated increments, or by its model of the vehicle
    (VehicleModel) with every sample as a measurement.
    """
    n_tick, model, start = case.schedule.n_tick[w], case.model, case.tick * case.schedule.first_tick[w]
    last_sample(work, parts.motion, case.options.samples, n_tick, case.tick)
    if vehicle is not None:
        sample_window(work, parts, case, None, None, w)
    else:
        processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], model.biases_only, case.tick)
        how = model.strapdown
        mechanise(work.nav, work.sums, work.previous, work.increments, n_tick // how.subsamples, case.step, how, start)


@inlined
def propagate(work, parts, case, w):
    """Propagate the filter over window w by the increments that the unit has put out in it."""
    schedule, model, options = case.schedule, case.model, case.options
    length, injection, linearised = schedule.length[w], schedule.injection[w], schedule.linearised[w]
    n_tick, start, seconds = schedule.n_tick[w], case.tick * schedule.first_tick[w], model.seconds[length]
    linearise(work.rates, work.nav, linearised)
    advance_backup(parts.backup, work, model, n_tick, case.step, start)
    hold_window(parts.points, work, n_tick)
    _advance(work, parts, case, options.vehicle, w)
    linearised_sums(work.rates, work.sums, seconds, linearised)
    propagate_estimate(work, case, parts.points, parts.open_loop, w)
    inform(work.P, parts.units, options.units, model, seconds)
    accumulate_transition(parts.earlier, options.delayed, work.D, work.sums, model, length, injection)
    predict_backup(parts.backup, work, model, length, injection)
    propagate_open_loop(work, parts.points, parts.open_loop, model, length, linearised)
    keep(parts.past, work.nav, work.previous, work.x, options.late, w, case.step, model.strapdown.gravity)


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
def begin_epoch(work, parts, case, epoch):
    """Begin what is counted at an epoch."""
    clear_epoch(work, epoch)
    _count_samples(work, parts.motion, case.options.vehicle, case.model, epoch)


@inlined
def update(work, parts, case, epoch):
    """Update the filter by what is measured at an epoch, and feed back what it estimates."""
    options = case.options
    process_epoch(work, parts, case, None, parts.open_loop, case.sensors, options.rules, epoch)
    correct_vehicle(work, parts.motion, case.model, options.vehicle)
    apply_feedback(work, parts.past, parts.open_loop, options.late, case.model)
    end_epoch(work, parts, case, epoch)
    clone_open_loop(work.x, parts.past, parts.open_loop, options.late, options.delayed, epoch)
