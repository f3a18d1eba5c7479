"""Filter side of a run, window by window and epoch by epoch, without access to the truth.

`flight_loop.fly` calls these steps after increments have been sensed and after measurements have been taken.
"""

from lvnav_trade.filter.ekf import clear_epoch
from lvnav_trade.filter.policies.back_propagation import accumulate_transition, begin_transition
from lvnav_trade.filter.policies.backup import advance_backup, begin_backup, predict_backup
from lvnav_trade.filter.policies.delay import keep
from lvnav_trade.filter.policies.epoch_differences import clone_open_loop
from lvnav_trade.filter.policies.imu_samples import begin_motion, correct_vehicle, last_sample
from lvnav_trade.filter.policies.integrity.state import begin_monitor
from lvnav_trade.filter.policies.linearise import propagate_estimate
from lvnav_trade.filter.policies.mode_logic import begin_mode_logic, hold_correction
from lvnav_trade.filter.policies.open_loop import apply_feedback, propagate_held, propagate_open_loop
from lvnav_trade.filter.policies.unscented import hold_window
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.transition import linearise, linearised_sums
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.simulation.epoch.process import end_epoch, process_epoch, sample_window
from lvnav_trade.simulation.exclusion_covariance import inform


@inlined
def begin_filter(work, parts, options):
    """Reset the arrays of a filter's optional features; its estimate is already that of the start.

    Parameters
    ----------
    work, parts : Work, OptionalState; updated in place
    options : Options
    """
    begin_mode_logic(parts.mode_state)
    begin_monitor(parts.monitor)
    begin_backup(parts.backup, work)
    begin_motion(parts.motion, options.samples)
    begin_transition(parts.previous_epoch, options.delayed)


@inlined
def _advance(work, parts, case, vehicle, w):
    """Propagate the navigation state over a window: by compensated increments, or by motion states.

    Parameters
    ----------
    work, parts, case : Work, OptionalState, FilterCase
    vehicle : VehicleModel of a filter that processes every IMU sample as a measurement, or None
    w : index of the window
    """
    n_tick = case.schedule.n_tick[w]
    model = case.model
    start = case.tick * case.schedule.first_tick[w]
    last_sample(work, parts.motion, case.options.samples, n_tick, case.tick)
    if vehicle is not None:
        sample_window(work, parts, case, None, None, w)
    else:
        gyro = work.tables[0]
        accel = work.tables[1]
        processes.compensate(work.increments, n_tick, gyro, accel, model.biases_only, case.tick)
        algorithm = model.strapdown
        n_step = n_tick // algorithm.subsamples
        mechanise(work.nav, work.sums, work.previous, work.increments, n_step, case.step, algorithm, start)


@inlined
def propagate(work, parts, case, w):
    """Propagate the filter over a window by the increments of the IMU.

    The backup strapdown and the sigma points use the increments first, before the estimated errors are removed.

    Parameters
    ----------
    work, parts : Work, OptionalState; updated in place
    case : FilterCase
    w : index of the window
    """
    schedule = case.schedule
    model = case.model
    options = case.options
    previous_epoch = parts.previous_epoch
    sigma_points = parts.sigma_points
    open_loop = parts.open_loop
    gravity = model.strapdown.gravity
    length = schedule.length[w]
    injection = schedule.injection[w]
    linearised = schedule.linearised[w]
    n_tick = schedule.n_tick[w]
    start = case.tick * schedule.first_tick[w]
    seconds = model.seconds[length]
    linearise(work.rates, work.nav, linearised)  # at the state before the window
    advance_backup(parts.backup, work, model, n_tick, case.step, start)
    hold_window(sigma_points, work, n_tick)
    _advance(work, parts, case, options.vehicle, w)  # compensates the increments in place
    linearised_sums(work.rates, work.sums, seconds, linearised)
    propagate_estimate(work, case, sigma_points, open_loop, w)  # fills the transition that the others use
    inform(work.P, parts.units, options.units, model, seconds)
    accumulate_transition(previous_epoch, options.delayed, work.D, work.sums, model, length, injection)
    predict_backup(parts.backup, work, model, length, injection)
    propagate_open_loop(work, sigma_points, open_loop, model, length, linearised)
    propagate_held(work, parts.mode_state, options.rules, model, length)
    keep(parts.state_history, work.nav, work.previous, work.x, options.late, w, case.step, gravity)


@jit
def _count_samples(work, motion, vehicle, model, epoch):
    """Add the samples of the last tick before an epoch to its innovations, after the channels of the sensors.

    Parameters
    ----------
    work : Work, updated in place
    motion : ImuSampleWork, with the residuals of the last tick
    vehicle : VehicleModel, or None
    model : FilterModel
    epoch : index
    """
    if vehicle is not None:
        first_channel = model.n_entry.shape[0]
        for i in range(N_SAMPLE):
            normalised = motion.residual[i] * sqrt(motion.weight[i])
            square = normalised * normalised
            work.innovation[epoch, first_channel + i] = normalised
            work.nis[epoch] = work.nis[epoch] + square
            work.n_row[epoch] = work.n_row[epoch] + 1.0


@inlined
def begin_epoch(work, parts, case, epoch):
    """Reset the counts and innovations of an epoch."""
    clear_epoch(work, epoch)
    _count_samples(work, parts.motion, case.options.vehicle, case.model, epoch)


@inlined
def update(work, parts, case, epoch):
    """Update the filter by the measurements of an epoch, feed the error state back, and store or clone the estimate.

    Parameters
    ----------
    work, parts : Work, OptionalState; updated in place
    case : FilterCase
    epoch : index
    """
    options = case.options
    open_loop = parts.open_loop
    state_history = parts.state_history
    hold_correction(parts.mode_state, options.rules, work.x)
    process_epoch(work, parts, case, None, open_loop, case.sensors, options.rules, epoch)
    correct_vehicle(work, parts.motion, case.model, options.vehicle)
    apply_feedback(work, state_history, open_loop, options.late, case.model)
    end_epoch(work, parts, case, epoch)
    clone_open_loop(work.x, state_history, open_loop, options.late, options.delayed, epoch)
