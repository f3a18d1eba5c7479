"""The forward pass of linear covariance: the filter's covariance, the true one by source, and their record."""

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.covariance.difference_errors import begin_successive, clone_joint, measure_further
from lvnav_trade.covariance.forward_samples import expected_of_samples, write_samples
from lvnav_trade.covariance.imu_array_errors import add_sums, inform_nominal
from lvnav_trade.covariance.propagate import nominal_window, propagate
from lvnav_trade.covariance.receiver_error import advance_solution, clone_error, complete_rows
from lvnav_trade.filter.policies.back_propagation import accumulate_transition, begin_transition
from lvnav_trade.filter.policies.delay import keep
from lvnav_trade.filter.policies.integrity.state import begin_monitor
from lvnav_trade.filter.policies.mode_logic import begin_mode_logic
from lvnav_trade.kernels.covariance import variance_along
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import group, total_of, whole
from lvnav_trade.kernels.strapdown import R, place
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
    expected = np.full(len(formal), np.nan)
    expected[has_nees] = np.trace(ratio, axis1=1, axis2=2)
    return expected


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the largest probability, over the measurements of each epoch, that the gate rejects a valid measurement.

    A normalised innovation is normal, with the expected square `ratio` (n_epoch, n_row); in a matched filter it is 1.
    """
    worst = ratio.max(axis=1, initial=1e-300)
    if not np.isfinite(gate_squared):
        return np.zeros_like(worst)
    limit = gate_squared / worst
    return chdtrc(1, limit)  # of a chi-square distribution with one degree of freedom


@jit
def write(out, hist, formal, state, scratch, true, axes_att, axes):
    """Write covariances, mean and error budget at a history time.

    Parameters
    ----------
    out : PassResults, updated in place
    hist : history time
    formal : (n, n) covariance of the filter
    state, scratch, true : JointCovariance, Scratch, Components
    axes_att, axes : (3, 3) rotations from frame i to body axes and to the reporting axes, for the budget
    """
    n = formal.shape[0]
    lane_sums = whole(scratch.spread)
    for i in range(n):
        out.mean[hist, i] = state.mean[i]
        for j in range(i, n):
            out.formal[hist, i, j] = formal[i, j]
            out.formal[hist, j, i] = formal[i, j]
            # the true covariance is the sum over all sources: over groups by lane, then over lanes
            first_sources = group(state.sources, 0)
            lane_sums[0] = first_sources[i, j]
            for g in range(1, true.n_slot.shape[0]):
                further_sources = group(state.sources, g)
                lane_sums[0] += further_sources[i, j]
            total = total_of(scratch.spread)
            out.true[hist, i, j] = total
            out.true[hist, j, i] = total
    _write_budget(out, hist, state, scratch, true, axes_att, axes)


@jit
def _write_budget(out, hist, state, scratch, true, axes_att, axes):
    """Write the variance of each filter state by source at a history time; the parameters are those of `write`."""
    n = out.budget.shape[2]
    for g in range(true.n_slot.shape[0]):
        P = group(state.sources, g)
        budget = group(scratch.budget, g)
        for i in range(3):
            axis = axes[i]
            body_axis = axes_att[i]
            budget[ATT + i, 0] = variance_along(P, ATT, body_axis[0], body_axis[1], body_axis[2])
            budget[VEL + i, 0] = variance_along(P, VEL, axis[0], axis[1], axis[2])
            budget[POS + i, 0] = variance_along(P, POS, axis[0], axis[1], axis[2])
        for i in range(9, n):
            budget[i, 0] = P[i, i]
    for source in range(true.group.shape[0]):
        g = true.group[source]
        lane = true.lane[source]
        for i in range(n):
            variance = scratch.budget[g, i, 0, lane]
            out.budget[hist, source, i] = variance


@jit
def write_solution(out, hist):
    """Write mean and covariance of the receiver's last solution at a history time."""
    n = out.held_mean.shape[0]
    for i in range(n):
        out.receiver_mean[hist, i] = out.held_mean[i]
        for j in range(n):
            for source in range(out.held.shape[0]):
                out.receiver[hist, source, i, j] = out.held[source, i, j]


@jit
def _record_window(tape, w, work):
    """Record the integrals of a window, and the position at which its transition was linearised."""
    if tape.channel.shape[0] > 0:
        for i in range(work.sums.shape[0]):
            tape.sums[w, i] = work.sums[i]
        for i in range(3):
            tape.position[w, i] = work.nav[R + i]


@jit
def _measure_receiver(work, further, signals, tight, epoch):
    """Set the receiver's measurements on the nominal flight at an epoch.

    Parameters
    ----------
    work : Nominal, updated in place
    further : FurtherObservables, or None
    signals : Signals
    tight : whether ranges of satellites are processed; otherwise the receiver's solution
    epoch : index
    """
    if tight:
        for slot in range(signals.n_used[epoch]):
            satellite = signals.used[epoch, slot]
            work.ranges[slot, 0] = signals.range[epoch, satellite]
            work.ranges[slot, 1] = signals.rate[epoch, satellite]
        measure_further(work, further, signals, epoch)
    else:
        for axis in range(3):
            work.solution[axis] = signals.position[epoch, axis]
            work.solution[3 + axis] = signals.velocity[epoch, axis]


@jit
def _measure_sensors(work, sensors, differences, epoch):
    """Set the measurements of the other sensors (Sensors, or None) on the nominal flight at an epoch."""
    if sensors is not None:
        for k in range(sensors.code.shape[0]):
            observed = work.observed[k]
            measure(observed, sensors.code[k], sensors.truth[k, epoch], 0.0, 0.0, 0.0)
            pair = differences.pair_of[k]
            if pair >= 0:
                for i in range(3):
                    observed[i] = differences.nominal[pair, epoch, i]


@jit
def _solve(work, chain, late, epoch):
    """Set the solution of a receiver that reports a covariance, not-a-number without a solution, and complete its
    Jacobian rows by the receiver-error states.
    """
    is_solved = chain.solved[epoch]
    for i in range(6):
        work.solution[i] = chain.point[epoch, i] if is_solved else np.nan
    complete_rows(work.H, late, epoch)


@jit
def _report(receiver, chain, signals, epoch):
    """Set the covariance that the receiver reports on the nominal flight (NominalReport, or None), without the factor
    of the filter's tuning.
    """
    if receiver is not None:
        scale = signals.scale[epoch]
        reported = chain.reported[epoch]
        for i in range(6):
            for j in range(6):
                factor = scale[i] * scale[j]
                receiver.covariance[i, j] = reported[i, j] / factor


@jit
def _jump(mean, clock, jumps):
    """Add jumps of clock bias and drift (2,) to the mean error."""
    if clock >= 0:
        mean[clock] += jumps[0]
        mean[clock + 1] += jumps[1]


@inlined
def _measure(work, receiver, case, joint, chain, epoch):
    """Propagate the receiver errors to an epoch, and set the measurements of the nominal flight.

    chain : SolutionErrorModel of a receiver that reports a covariance with its solution, or None
    """
    options = case.options
    signals = case.signals
    model = case.model
    state = joint.state
    true = joint.true
    # receiver errors advance first, because the measurements of this epoch contain them
    _jump(state.mean, model.clock, signals.clock_jump[epoch])
    if chain is not None:
        advance_solution(state, joint.scratch, chain, true, epoch)
    begin_successive(joint, true.successive, model, epoch)
    _measure_receiver(work, options.further, signals, model.tight, epoch)
    _measure_sensors(work, case.sensors, true.differences, epoch)
    if chain is not None:
        _solve(work, chain, options.late, epoch)
        _report(receiver, chain, signals, epoch)


@inlined
def _propagate(work, parts, case, joint, flight, vehicle, late, w):
    """Propagate all covariances over window w.

    Parameters
    ----------
    work, parts, case, joint, flight : as in `forward`
    vehicle : VehicleModel of a filter that processes IMU samples as measurements, or None
    late : DelayProcessing, for which the navigation error is cloned at times of validity, or None
    w : window
    """
    schedule = case.schedule
    model = case.model
    options = case.options
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    length = schedule.length[w]
    seconds = model.seconds[length]
    injected = schedule.injection[w]
    algorithm = model.strapdown
    sensed = not joint.true.by_samples
    if vehicle is not None:
        sample_window(work, parts, case, joint, flight, w)
    nominal_window(work, flight.reference, flight.unit, first, n_tick, algorithm, sensed, schedule.linearised[w])
    propagate(work, case, joint, flight, options.units, w)
    inform_nominal(work.P, options.units, model, first, n_tick, seconds)
    D = joint.scratch.D
    accumulate_transition(parts.previous_epoch, options.delayed, D, work.held, model, length, injected)
    _record_window(joint.tape, w, work)
    if late is not None:
        place(work.nav, flight.reference, first + n_tick)
        keep(parts.state_history, work.nav, work.previous, work.x, late, w, case.step, algorithm.gravity)
        clone_error(joint.state, joint.true, late, w)


@inlined
def _count_samples(joint, ticks, motion, vehicle, epoch):
    """Count the IMU samples of the last tick before an epoch as measurements of the epoch.

    Parameters
    ----------
    joint : Joint, whose `out` gets count and expected square of the normalised innovations
    ticks : SampleScratch of the nominal flight
    motion : ImuSampleWork
    vehicle : VehicleModel, or None
    epoch : index
    """
    if vehicle is not None:
        out = joint.out
        out.expected_nis[epoch] += expected_of_samples(joint.true, ticks, motion, vehicle)
        out.n_row[epoch] += N_SAMPLE


@inlined
def _update(work, parts, case, joint, flight, report, epoch):
    """Process the measurements of an epoch; report as in `_write`."""
    options = case.options
    _measure(work, parts.receiver, case, joint, flight.chain, epoch)
    if report is not None:
        hold_solution(work, parts, joint, flight.chain.solved, None, report, epoch)
    process_epoch(work, parts, case, joint, parts.open_loop, case.sensors, options.rules, epoch)
    end_epoch(work, parts, case, epoch)
    clone_joint(joint, options.late, options.delayed, epoch)


@inlined
def _write(work, case, joint, record, samples, report, hist, tick):
    """Write the results at a history time, which follows a tick.

    samples : ReportedSamples, if errors of IMU samples are reported, or None
    report : ReportedSolution, if errors of the receiver's solution are reported, or None
    """
    out = joint.out
    state = joint.state
    true = joint.true
    units = case.options.units
    body_axes = record.attitude[hist]
    reporting_axes = record.axes[hist]
    write(out, hist, work.P, state, joint.scratch, true, body_axes, reporting_axes)
    add_sums(out, hist, state, true, units, tick)
    if samples is not None:
        write_samples(out, hist, state, true, units, samples, tick, case.tick)
    if report is not None:
        write_solution(out, hist)


@jit
def forward(work, parts, case, joint, flight, record):
    """Propagate and update the formal covariance and the true covariance by source over the nominal flight.

    Parameters
    ----------
    work : Nominal, at the start of the flight; updated in place
    parts : OptionalState, arrays of the optional features; updated in place
    case : FilterCase
    joint : Joint, whose `out` gets the results and whose `tape` the record for a backward pass
    flight : NominalFlight
    record : HistoryRotations, axes of the results
    """
    schedule = case.schedule
    options = case.options
    tape = joint.tape
    begin_mode_logic(parts.mode_state)
    begin_monitor(parts.monitor)
    begin_transition(parts.previous_epoch, options.delayed)
    for w in range(schedule.n_tick.shape[0]):
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        epoch = schedule.epoch[w]
        hist = schedule.hist[w]
        if n_tick > 0:
            _propagate(work, parts, case, joint, flight, options.vehicle, options.late, w)
        if epoch >= 0:
            _count_samples(joint, flight.ticks, parts.motion, options.vehicle, epoch)
        if epoch >= 0 and case.model.aided:
            # measurements are linearised at the true state, not at the end of the strapdown's integration
            place(work.nav, flight.reference, first + n_tick)
            _update(work, parts, case, joint, flight, options.report, epoch)
        if tape.channel.shape[0] > 0:
            tape.first[w + 1] = tape.used[0]
        if hist >= 0:
            tick = max(0, first + n_tick - 1)
            _write(work, case, joint, record, options.samples, options.report, hist, tick)
