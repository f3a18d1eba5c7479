"""Filter side of a run, window by window and epoch by epoch, without access to the truth.

`flight_loop.fly` calls these steps after increments have been sensed and after measurements have been taken.
"""

from lvnav_trade.filter.ekf import clear_epoch
from lvnav_trade.filter.policies.back_propagation import accumulate_transition, begin_transition
from lvnav_trade.filter.policies.backup import advance_backup, begin_backup, predict_backup
from lvnav_trade.filter.policies.delay import store_state
from lvnav_trade.filter.policies.epoch_differences import clone_open_loop
from lvnav_trade.filter.policies.imu_samples import begin_motion, correct_vehicle, store_last_sample
from lvnav_trade.filter.policies.integrity.state import begin_monitor
from lvnav_trade.filter.policies.linearise import propagate_estimate
from lvnav_trade.filter.policies.mode_logic import begin_mode_logic, hold_correction
from lvnav_trade.filter.policies.open_loop import apply_feedback, propagate_held_correction, propagate_open_loop
from lvnav_trade.filter.policies.unscented import store_window_start
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.transition import linearise, linearised_sums
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.simulation.epoch.process import end_epoch, process_epoch, sample_window
from lvnav_trade.simulation.exclusion_covariance import inform


@inline_jit
def begin_filter(work, optional_state, options):
    """Reset the arrays of a filter's optional features; its estimate is already that of the start.

    Parameters
    ----------
    work, optional_state : Work, OptionalState; updated in place
    options : Options
    """
    begin_mode_logic(optional_state.mode_state)
    begin_monitor(optional_state.monitor)
    begin_backup(optional_state.backup, work)
    begin_motion(optional_state.motion, options.reported_samples)
    begin_transition(optional_state.previous_epoch, options.differences)


@inline_jit
def _advance(work, optional_state, case, vehicle, w):
    """Propagate the navigation state over a window: by compensated increments, or by motion states.

    Parameters
    ----------
    work, optional_state, case : Work, OptionalState, FilterCase
    vehicle : VehicleModel of a filter that processes every IMU sample as a measurement, or None
    w : index of the window
    """
    n_tick = case.schedule.n_tick[w]
    model = case.model
    start = case.tick * case.schedule.first_tick[w]
    store_last_sample(work, optional_state.motion, case.options.reported_samples, n_tick, case.tick)
    if vehicle is not None:
        sample_window(work, optional_state, case, None, None, w)
    else:
        gyro = work.tables[0]
        accel = work.tables[1]
        processes.compensate(work.increments, n_tick, gyro, accel, model.biases_only, case.tick)
        algorithm = model.strapdown
        n_step = n_tick // algorithm.subsamples
        mechanise(work.nav, work.sums, work.previous, work.increments, n_step, case.step, algorithm, start)


@inline_jit
def propagate(work, optional_state, case, w):
    """Propagate the filter over a window by the increments of the IMU.

    The backup strapdown and the sigma points use the increments first, before the estimated errors are removed.

    Parameters
    ----------
    work, optional_state : Work, OptionalState; updated in place
    case : FilterCase
    w : index of the window
    """
    schedule = case.schedule
    model = case.model
    options = case.options
    previous_epoch = optional_state.previous_epoch
    sigma_points = optional_state.sigma_points
    open_loop = optional_state.open_loop
    gravity = model.strapdown.gravity
    length_index = schedule.length_index[w]
    injection = schedule.injection[w]
    linearisation = schedule.linearisation[w]
    n_tick = schedule.n_tick[w]
    start = case.tick * schedule.first_tick[w]
    seconds = model.seconds[length_index]
    linearise(work.rates, work.nav, linearisation)  # at the state before the window
    advance_backup(optional_state.backup, work, model, n_tick, case.step, start)
    store_window_start(sigma_points, work, n_tick)
    _advance(work, optional_state, case, options.vehicle, w)  # compensates the increments in place
    linearised_sums(work.rates, work.sums, seconds, linearisation)
    propagate_estimate(work, case, sigma_points, open_loop, w)  # fills the transition that the others use
    inform(work.P, optional_state.units, options.imu_array, model, seconds)
    accumulate_transition(previous_epoch, options.differences, work.D, work.sums, model, length_index, injection)
    predict_backup(optional_state.backup, work, model, length_index, injection)
    propagate_open_loop(work, sigma_points, open_loop, model, length_index, linearisation)
    propagate_held_correction(work, optional_state.mode_state, options.rules, model, length_index)
    store_state(
        optional_state.state_history, work.nav, work.previous, work.x, options.delay_processing, w, case.step, gravity
    )


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
            normalised_residual = motion.residual[i] * sqrt(motion.weight[i])
            square = normalised_residual * normalised_residual
            work.innovation[epoch, first_channel + i] = normalised_residual
            work.nis[epoch] = work.nis[epoch] + square
            work.n_row[epoch] = work.n_row[epoch] + 1.0


@inline_jit
def begin_epoch(work, optional_state, case, epoch):
    """Reset the counts and innovations of an epoch."""
    clear_epoch(work, epoch)
    _count_samples(work, optional_state.motion, case.options.vehicle, case.model, epoch)


@inline_jit
def update(work, optional_state, case, epoch):
    """Update the filter by the measurements of an epoch, feed the error state back, and store or clone the estimate.

    Parameters
    ----------
    work, optional_state : Work, OptionalState; updated in place
    case : FilterCase
    epoch : index
    """
    options = case.options
    open_loop = optional_state.open_loop
    state_history = optional_state.state_history
    hold_correction(optional_state.mode_state, options.rules, work.x)
    process_epoch(work, optional_state, case, None, open_loop, case.sensors, options.rules, epoch)
    correct_vehicle(work, optional_state.motion, case.model, options.vehicle)
    apply_feedback(work, state_history, open_loop, options.delay_processing, case.model)
    end_epoch(work, optional_state, case, epoch)
    clone_open_loop(work.x, state_history, open_loop, options.delay_processing, options.differences, epoch)
