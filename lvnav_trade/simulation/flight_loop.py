"""Simulation of one run or eight lanes. Truth and filter exchange nothing but measurements."""

from lvnav_trade.kernels.jit import inlined
from lvnav_trade.simulation.epoch.filter_case import hold_solution
from lvnav_trade.simulation.imu_sensing import sense
from lvnav_trade.simulation.recording import record
from lvnav_trade.simulation.sensing import begin, begin_solver, measure_sensors, observe
from lvnav_trade.simulation.steps import begin_epoch, begin_filter, propagate, update
from lvnav_trade.simulation.tape import tape_after, tape_before, tape_epoch, tape_increments, tape_start


@inlined
def _measure(work, parts, case, key, epoch):
    """Simulate the measurements of receiver and sensors at an epoch.

    Parameters
    ----------
    work, parts : Work, OptionalState; updated in place
    case : FilterCase
    key : (2,) key words of the campaign's seed
    epoch : index
    """
    options = case.options
    solver = options.solver
    observe(work, parts, case, solver, key, epoch)
    hold_solution(work, parts, None, None, solver, options.report, epoch)
    measure_sensors(work, parts.units, case.sensors, options.units, case.signals, key, epoch)
    tape_epoch(parts.tape, work, parts.receiver, epoch)


@inlined
def fly(work, parts, case, truth, key):
    """Simulate one run (float64 arrays) or eight (lane views) from start to end.

    A window of IMU ticks is sensed and propagated; at its end follow the epoch and the record, if they fall there.

    Parameters
    ----------
    work : Work, arrays of truth, filter and results; updated in place
    parts : OptionalState, arrays of the optional features; updated in place
    case : FilterCase
    truth : Truth, which the filter does not read
    key : (2,) key words of the campaign's seed
    """
    schedule, options = case.schedule, case.options
    begin(work, parts.units, case, truth, key)
    begin_solver(work, parts.receiver, options.solver)
    tape_start(parts.tape, work)
    begin_filter(work, parts, options)
    for w in range(schedule.n_tick.shape[0]):
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        if n_tick > 0:
            sense(work, parts.units, truth.unit, options.units, first, n_tick, key)
            tape_increments(parts.tape, work, first, n_tick)
            propagate(work, parts, case, w)
        epoch = schedule.epoch[w]
        if epoch >= 0:
            tape_before(parts.tape, work, epoch)
            begin_epoch(work, parts, case, epoch)
        if epoch >= 0 and case.model.aided:
            _measure(work, parts, case, key, epoch)
            update(work, parts, case, epoch)
        if epoch >= 0:
            tape_after(parts.tape, work, epoch)
        # history times follow the update: errors at an epoch are those after its measurements
        hist = schedule.hist[w]
        if hist >= 0:
            last_tick = max(0, first + n_tick - 1)
            record(work, parts, case, parts.transition_errors, truth.record, last_tick, hist)
    tape_after(parts.tape, work, -1)
