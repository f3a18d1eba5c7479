"""Simulation of one run or eight lanes. Truth and filter exchange nothing but measurements."""

from lvnav_trade.kernels.jit import inline_jit
from lvnav_trade.simulation.epoch.filter_case import hold_solution
from lvnav_trade.simulation.imu_sensing import sense
from lvnav_trade.simulation.recording import record
from lvnav_trade.simulation.sensing import begin, begin_solver, measure_sensors, observe
from lvnav_trade.simulation.steps import begin_epoch, begin_filter, propagate, update
from lvnav_trade.simulation.tape import tape_after, tape_before, tape_epoch, tape_increments, tape_start


@inline_jit
def _measure(work, optional_state, case, key, epoch):
    """Simulate the measurements of receiver and sensors at an epoch.

    Parameters
    ----------
    work, optional_state : Work, OptionalState; updated in place
    case : FilterCase
    key : (2,) key words of the campaign's seed
    epoch : index
    """
    options = case.options
    solver = options.solver
    observe(work, optional_state, case, solver, key, epoch)
    hold_solution(work, optional_state, None, None, solver, options.reported_solution, epoch)
    measure_sensors(work, optional_state.units, case.sensors, options.imu_array, case.signals, key, epoch)
    tape_epoch(optional_state.tape, work, optional_state.receiver, epoch)


@inline_jit
def fly(work, optional_state, case, truth, key):
    """Simulate one run (float64 arrays) or eight (lane views) from start to end.

    A window of IMU ticks is sensed and propagated; at its end follow the epoch and the record, if they fall there.

    Parameters
    ----------
    work : Work, arrays of truth, filter and results; updated in place
    optional_state : OptionalState, arrays of the optional features; updated in place
    case : FilterCase
    truth : Truth, which the filter does not read
    key : (2,) key words of the campaign's seed
    """
    schedule, options = case.schedule, case.options
    begin(work, optional_state.units, case, truth, key)
    begin_solver(work, optional_state.receiver, options.solver)
    tape_start(optional_state.tape, work)
    begin_filter(work, optional_state, options)
    for w in range(schedule.n_tick.shape[0]):
        first = schedule.first_tick[w]
        n_tick = schedule.n_tick[w]
        if n_tick > 0:
            sense(work, optional_state.units, truth.unit, options.imu_array, first, n_tick, key)
            tape_increments(optional_state.tape, work, first, n_tick)
            propagate(work, optional_state, case, w)
        epoch = schedule.epoch[w]
        if epoch >= 0:
            tape_before(optional_state.tape, work, epoch)
            begin_epoch(work, optional_state, case, epoch)
        if epoch >= 0 and case.model.has_epochs:
            _measure(work, optional_state, case, key, epoch)
            update(work, optional_state, case, epoch)
        if epoch >= 0:
            tape_after(optional_state.tape, work, epoch)
        # history times follow the update: errors at an epoch are those after its measurements
        hist = schedule.hist[w]
        if hist >= 0:
            last_tick = max(0, first + n_tick - 1)
            record(work, optional_state, case, optional_state.transition_errors, truth.record, last_tick, hist)
    tape_after(optional_state.tape, work, -1)
