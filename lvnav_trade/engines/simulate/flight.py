"""One simulated flight, of one run or of eight at once: truth and filter meet in measurements only."""

from lvnav_trade.engines.simulate.recording import hold_solution, record
from lvnav_trade.engines.simulate.sensing import begin, begin_solver, measure_sensors, observe, sense
from lvnav_trade.engines.simulate.steps import begin_epoch, begin_filter, propagate, update
from lvnav_trade.engines.simulate.tape import tape_epoch, tape_increments, tape_start, tape_state
from lvnav_trade.kernels.jit import inlined


@inlined
def fly(work, parts, schedule, unit, signals, sensors, start, history, model, options, k0, k1):
    """Simulate one run (float64 arrays) or eight (lane views) from start to end; `work` and `parts` are filled.

    Parameters
    ----------
    work : Work; parts : Parts; schedule : Schedule; unit : Unit; signals : Signals; sensors : Sensors; start : Start
    history : Record; model : FilterModel; options : Options
    k0, k1 : key words of the campaign's seed
    """
    begin(work, parts.units, unit, options.units, signals, start, model, k0, k1)
    begin_solver(work, parts.rx, options.solver)
    tape_start(parts.tape, work)
    begin_filter(work, parts, options)
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            sense(work, parts.units, unit, options.units, first, n_tick, k0, k1)
            tape_increments(parts.tape, work, first, n_tick)
            propagate(work, parts, schedule, unit, model, options, w)
        epoch = schedule.epoch[w]
        if epoch >= 0:
            begin_epoch(work, parts, model, options, epoch)
        if epoch >= 0 and model.aided:
            observe(work, parts.rx, parts.last, options.solver, options.further, signals, model, epoch, k0, k1)
            hold_solution(work, parts.rx, parts.held, options.solver, options.report, epoch)
            measure_sensors(work, parts.units, sensors, options.units, signals, epoch, k0, k1)
            tape_epoch(parts.tape, work, parts.rx, epoch)
            update(work, parts, unit, sensors, signals, model, options, epoch)
        tape_state(parts.tape, work, w)
        if schedule.hist[w] >= 0:
            tick = max(0, first + n_tick - 1)
            record(
                work, parts.open_loop, parts.watch, parts.units, parts.motion, parts.held, parts.missed, parts.backup,
                options.vehicle, options.samples, options.report, options.backup, history, signals.shared,
                options.units, model, tick, schedule.hist[w],
            )  # fmt: skip
