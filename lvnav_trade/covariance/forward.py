"""The forward pass of linear covariance: the filter's covariance, the true one by source, and their record."""

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.covariance.difference_errors import begin_successive_errors, clone_joint, measure_further_observables
from lvnav_trade.covariance.forward_samples import expected_sample_nis, write_samples
from lvnav_trade.covariance.imu_array_errors import add_sums, inflate_nominal
from lvnav_trade.covariance.propagate import nominal_window, propagate
from lvnav_trade.covariance.receiver_error import advance_solution, clone_error, complete_rows
from lvnav_trade.filter.policies.back_propagation import accumulate_transition, begin_transition
from lvnav_trade.filter.policies.delay import store_state
from lvnav_trade.filter.policies.integrity.state import begin_monitor
from lvnav_trade.filter.policies.mode_logic import begin_mode_logic
from lvnav_trade.kernels.covariance import variance_along
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import group, group_view, lane_total
from lvnav_trade.kernels.strapdown import R, set_to_truth
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.records import Floats
from lvnav_trade.sensors.family import measure
from lvnav_trade.simulation.epoch.filter_case import hold_solution
from lvnav_trade.simulation.epoch.process import end_epoch, process_epoch, sample_window


def expected_nees(formal: Floats, total: Floats) -> Floats:
    """Return the expected NEES tr(formal^-1 total) at each history time, (n_hist,).

    It is NaN where a formal variance is zero. Both covariances are normalised by the formal sigmas first, because
    states differ by ten orders of magnitude.

    Parameters
    ----------
    formal
        (n_hist, m, m) SI squared. Covariance of the filter.
    total
        (n_hist, m, m) SI squared. Second moment of the true error.
    """
    sigma = np.sqrt(np.diagonal(formal, axis1=1, axis2=2))
    has_nees = np.all(sigma > 0.0, axis=1)
    positive_sigma = sigma[has_nees]
    # E[e' P^-1 e] = tr(P^-1 E[e e']); the scaling of both matrices does not change the trace
    scale = positive_sigma[:, :, None] * positive_sigma[:, None, :]
    scaled_formal = formal[has_nees] / scale
    scaled_total = total[has_nees] / scale
    ratio = np.linalg.solve(scaled_formal, scaled_total)
    nees = np.full(len(formal), np.nan)
    nees[has_nees] = np.trace(ratio, axis1=1, axis2=2)
    return nees


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the largest probability, over the measurements of each epoch, that the gate rejects a valid measurement.

    A normalised innovation is normal, with the expected square `ratio` (n_epoch, n_row); in a matched filter it is 1.
    """
    largest_ratio = ratio.max(axis=1, initial=1e-300)
    if not np.isfinite(gate_squared):
        return np.zeros_like(largest_ratio)
    limit = gate_squared / largest_ratio
    return chdtrc(1, limit)  # of a chi-square distribution with one degree of freedom


@jit
def write(results, hist, formal, state, scratch, components, body_axes, reporting_axes):
    """Write covariances, mean and error budget at a history time.

    Parameters
    ----------
    results : PassResults, updated in place
    hist : history time
    formal : (n, n) covariance of the filter
    state, scratch, components : JointCovariance, Scratch, Components
    body_axes, reporting_axes : (3, 3) rotations from frame i to body axes and to the reporting axes, for the budget
    """
    n = formal.shape[0]
    lane_sums = group_view(scratch.innovation_variance)
    for i in range(n):
        results.mean[hist, i] = state.mean[i]
        for j in range(i, n):
            results.formal[hist, i, j] = formal[i, j]
            results.formal[hist, j, i] = formal[i, j]
            # the true covariance is the sum over all sources: over groups by lane, then over lanes
            first_sources = group(state.sources, 0)
            lane_sums[0] = first_sources[i, j]
            for g in range(1, components.n_slot.shape[0]):
                further_sources = group(state.sources, g)
                lane_sums[0] += further_sources[i, j]
            total = lane_total(scratch.innovation_variance)
            results.true[hist, i, j] = total
            results.true[hist, j, i] = total
    _write_budget(results, hist, state, scratch, components, body_axes, reporting_axes)


@jit
def _write_budget(results, hist, state, scratch, components, body_axes, reporting_axes):
    """Write the variance of each filter state by source at a history time; the parameters are those of `write`."""
    n = results.budget.shape[2]
    for g in range(components.n_slot.shape[0]):
        P = group(state.sources, g)
        budget = group(scratch.budget, g)
        for i in range(3):
            axis = reporting_axes[i]
            body_axis = body_axes[i]
            budget[ATT + i, 0] = variance_along(P, ATT, body_axis[0], body_axis[1], body_axis[2])
            budget[VEL + i, 0] = variance_along(P, VEL, axis[0], axis[1], axis[2])
            budget[POS + i, 0] = variance_along(P, POS, axis[0], axis[1], axis[2])
        for i in range(9, n):
            budget[i, 0] = P[i, i]
    for source in range(components.group.shape[0]):
        g = components.group[source]
        lane = components.lane[source]
        for i in range(n):
            variance = scratch.budget[g, i, 0, lane]
            results.budget[hist, source, i] = variance


@jit
def write_solution(results, hist):
    """Write mean and covariance of the receiver's last solution at a history time."""
    n = results.solution_mean.shape[0]
    for i in range(n):
        results.receiver_mean[hist, i] = results.solution_mean[i]
        for j in range(n):
            for source in range(results.solution_covariance.shape[0]):
                results.receiver[hist, source, i, j] = results.solution_covariance[source, i, j]


@jit
def _record_window(tape, w, work):
    """Record the integrals of a window, and the position at which its transition was linearised."""
    if tape.channel.shape[0] > 0:
        for i in range(work.sums.shape[0]):
            tape.sums[w, i] = work.sums[i]
        for i in range(3):
            tape.position[w, i] = work.nav[R + i]


@jit
def _measure_receiver(work, further_observables, signals, tight, epoch):
    """Set the receiver's measurements on the nominal flight at an epoch.

    Parameters
    ----------
    work : Nominal, updated in place
    further_observables : FurtherObservables, or None
    signals : Signals
    tight : whether ranges of satellites are processed; otherwise the receiver's solution
    epoch : index
    """
    if tight:
        for slot in range(signals.n_used[epoch]):
            satellite = signals.satellite_by_slot[epoch, slot]
            work.ranges[slot, 0] = signals.range[epoch, satellite]
            work.ranges[slot, 1] = signals.rate[epoch, satellite]
        measure_further_observables(work, further_observables, signals, epoch)
    else:
        for axis in range(3):
            work.solution[axis] = signals.position[epoch, axis]
            work.solution[3 + axis] = signals.velocity[epoch, axis]


@jit
def _measure_sensors(work, sensors, differences, epoch):
    """Set the measurements of the other sensors (Sensors, or None) on the nominal flight at an epoch."""
    if sensors is not None:
        for k in range(sensors.code.shape[0]):
            measurement = work.sensor_measurements[k]
            measure(measurement, sensors.code[k], sensors.truth[k, epoch], 0.0, 0.0, 0.0)
            pair = differences.pair_index[k]
            if pair >= 0:
                for i in range(3):
                    measurement[i] = differences.nominal[pair, epoch, i]


@jit
def _solve(work, chain, delays, epoch):
    """Set the solution of a receiver that reports a covariance, not-a-number without a solution, and complete its
    Jacobian rows by the receiver-error states.
    """
    is_solved = chain.has_solution[epoch]
    for i in range(6):
        work.solution[i] = chain.point[epoch, i] if is_solved else np.nan
    complete_rows(work.H, delays, epoch)


@jit
def _report(receiver, chain, signals, epoch):
    """Set the covariance that the receiver reports on the nominal flight (NominalReport, or None), without the factor
    of the filter's tuning.
    """
    if receiver is not None:
        scale = signals.scale[epoch]
        reported_covariance = chain.reported_covariance[epoch]
        for i in range(6):
            for j in range(6):
                factor = scale[i] * scale[j]
                receiver.covariance[i, j] = reported_covariance[i, j] / factor


@jit
def _jump(mean, clock, jumps):
    """Add jumps of clock bias and drift (2,) to the mean error."""
    if clock >= 0:
        mean[clock] += jumps[0]
        mean[clock + 1] += jumps[1]


@inline_jit
def _measure(work, receiver, case, joint, chain, epoch):
    """Propagate the receiver errors to an epoch, and set the measurements of the nominal flight.

    chain : SolutionErrorModel of a receiver that reports a covariance with its solution, or None
    """
    options = case.options
    signals = case.signals
    model = case.model
    state = joint.state
    components = joint.components
    # receiver errors advance first, because the measurements of this epoch contain them
    _jump(state.mean, model.clock, signals.clock_jump[epoch])
    if chain is not None:
        advance_solution(state, joint.scratch, chain, components, epoch)
    begin_successive_errors(joint, components.successive_errors, model, epoch)
    _measure_receiver(work, options.further_observables, signals, model.tight, epoch)
    _measure_sensors(work, case.sensors, components.imu_differences, epoch)
    if chain is not None:
        _solve(work, chain, options.delay_processing, epoch)
        _report(receiver, chain, signals, epoch)


@inline_jit
def _propagate(work, optional_state, case, joint, flight, vehicle, delays, w):
    """Propagate all covariances over window w.

    Parameters
    ----------
    work, optional_state, case, joint, flight : as in `forward`
    vehicle : VehicleModel of a filter that processes IMU samples as measurements, or None
    delays : DelayProcessing, for which the navigation error is cloned at times of validity, or None
    w : window
    """
    schedule = case.schedule
    model = case.model
    options = case.options
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    length_index = schedule.length_index[w]
    seconds = model.seconds[length_index]
    injection = schedule.injection[w]
    algorithm = model.strapdown
    has_sensed_increments = not joint.components.has_sample_updates
    if vehicle is not None:
        sample_window(work, optional_state, case, joint, flight, w)
    nominal_window(
        work, flight.reference, flight.unit, first, n_tick, algorithm, has_sensed_increments, schedule.linearisation[w]
    )
    propagate(work, case, joint, flight, options.imu_array, w)
    inflate_nominal(work.P, options.imu_array, model, first, n_tick, seconds)
    D = joint.scratch.D
    accumulate_transition(
        optional_state.previous_epoch, options.differences, D, work.filter_sums, model, length_index, injection
    )
    _record_window(joint.tape, w, work)
    if delays is not None:
        set_to_truth(work.nav, flight.reference, first + n_tick)
        store_state(
            optional_state.state_history, work.nav, work.previous, work.x, delays, w, case.step, algorithm.gravity
        )
        clone_error(joint.state, joint.components, delays, w)


@inline_jit
def _count_samples(joint, ticks, motion, vehicle, epoch):
    """Count the IMU samples of the last tick before an epoch as measurements of the epoch.

    Parameters
    ----------
    joint : Joint, whose `results` gets count and expected square of the normalised innovations
    ticks : SampleScratch of the nominal flight
    motion : ImuSampleWork
    vehicle : VehicleModel, or None
    epoch : index
    """
    if vehicle is not None:
        results = joint.results
        results.expected_nis[epoch] += expected_sample_nis(joint.components, ticks, motion, vehicle)
        results.n_row[epoch] += N_SAMPLE


@inline_jit
def _update(work, optional_state, case, joint, flight, report, epoch):
    """Process the measurements of an epoch; report as in `_write`."""
    options = case.options
    _measure(work, optional_state.receiver, case, joint, flight.chain, epoch)
    if report is not None:
        hold_solution(work, optional_state, joint, flight.chain.has_solution, None, report, epoch)
    process_epoch(work, optional_state, case, joint, optional_state.open_loop, case.sensors, options.rules, epoch)
    end_epoch(work, optional_state, case, epoch)
    clone_joint(joint, options.delay_processing, options.differences, epoch)


@inline_jit
def _write(work, case, joint, rotations, samples, report, hist, tick):
    """Write the results at a history time, which follows a tick.

    samples : ReportedSamples, if errors of IMU samples are reported, or None
    report : ReportedSolution, if errors of the receiver's solution are reported, or None
    """
    results = joint.results
    state = joint.state
    components = joint.components
    units = case.options.imu_array
    body_axes = rotations.attitude[hist]
    reporting_axes = rotations.axes[hist]
    write(results, hist, work.P, state, joint.scratch, components, body_axes, reporting_axes)
    add_sums(results, hist, state, components, units, tick)
    if samples is not None:
        write_samples(results, hist, state, components, units, samples, tick, case.tick)
    if report is not None:
        write_solution(results, hist)


@jit
def forward(work, optional_state, case, joint, flight, rotations):
    """Propagate and update the formal covariance and the true covariance by source over the nominal flight.

    Parameters
    ----------
    work : Nominal, at the start of the flight; updated in place
    optional_state : OptionalState, arrays of the optional features; updated in place
    case : FilterCase
    joint : Joint, whose `results` gets the results and whose `tape` the record for a backward pass
    flight : NominalFlight
    rotations : HistoryRotations, axes of the results
    """
    schedule = case.schedule
    options = case.options
    tape = joint.tape
    begin_mode_logic(optional_state.mode_state)
    begin_monitor(optional_state.monitor)
    begin_transition(optional_state.previous_epoch, options.differences)
    for w in range(schedule.n_tick.shape[0]):
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        epoch = schedule.epoch[w]
        hist = schedule.hist[w]
        if n_tick > 0:
            _propagate(work, optional_state, case, joint, flight, options.vehicle, options.delay_processing, w)
        if epoch >= 0:
            _count_samples(joint, flight.ticks, optional_state.motion, options.vehicle, epoch)
        if epoch >= 0 and case.model.has_epochs:
            # measurements are linearised at the true state, not at the end of the strapdown's integration
            set_to_truth(work.nav, flight.reference, first + n_tick)
            _update(work, optional_state, case, joint, flight, options.reported_solution, epoch)
        if tape.channel.shape[0] > 0:
            tape.first[w + 1] = tape.n_recorded[0]
        if hist >= 0:
            tick = max(0, first + n_tick - 1)
            _write(work, case, joint, rotations, options.reported_samples, options.reported_solution, hist, tick)
