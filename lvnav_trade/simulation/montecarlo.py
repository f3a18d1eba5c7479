"""Monte Carlo simulation: blocks of runs, eight runs at a time in vector lanes."""

from collections import namedtuple
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import config

from lvnav_trade.filter.policies.backup import new_backup
from lvnav_trade.filter.policies.delay import N_PAST
from lvnav_trade.filter.policies.epoch_differences import new_previous_epoch
from lvnav_trade.filter.policies.imu_samples import new_sample_work
from lvnav_trade.filter.policies.integrity.state import decisions_of, new_monitor
from lvnav_trade.filter.policies.iterated import new_iteration_work
from lvnav_trade.filter.policies.mode_logic import DATA_LOST, ModeState, new_mode_state
from lvnav_trade.filter.policies.open_loop import new_open_loop
from lvnav_trade.filter.policies.unscented import new_sigma_points
from lvnav_trade.filter.receivers.receiver import N_STATE as N_RECEIVER
from lvnav_trade.filter.receivers.receiver import new_receiver
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view, zeros_of
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.quantities.records import (
    FIRST_UNIT,
    NO_CHANGES,
    NO_DECISIONS,
    OF_INERTIAL,
    OF_UNIT,
    WAITING,
    Floats,
    RunBlock,
)
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.flight_loop import fly
from lvnav_trade.simulation.guided_runs import injections
from lvnav_trade.simulation.imu_array import new_units
from lvnav_trade.simulation.imu_redundancy import RedundancyWork
from lvnav_trade.simulation.preparation.imu_inputs import ImuTruth
from lvnav_trade.simulation.preparation.inputs import HistoryTruth, InitialState, Schedule
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare
from lvnav_trade.simulation.preparation.signals.recorded_solution import values_of
from lvnav_trade.simulation.tape import Tape, new_tape


class LastSolutionError(NamedTuple):
    """Error of the receiver's last solution, stored until the next.

    error : (11,). Truth minus estimate, frame i.
    covariance : (11, 11). Formal covariance of the receiver, frame i.
    """

    error: Floats
    covariance: Floats


class TransitionErrors(NamedTuple):
    """Error of the filter's transition, for an inertial system without measurements.

    error : (n_hist, n_state). True error at the history times, frame i.
    missed : (n_hist, n_state). True error minus that propagated by the transition from the previous history time.
    """

    error: Floats
    missed: Floats


Work = namedtuple(
    "Work",
    "run nav sums rates previous increments P X D x K H z antenna rate true_par true_tables par tables remainder clock "
    "clock_hat shared extra ranges solution err sigma nees nis n_row n_reject innovation failed t_failed reported "
    "observed",
)
"""Arrays of a run, or of eight runs in lanes: truth, filter, results.

run : (1,). Number of the run.
nav : (10,). Estimated navigation state: attitude quaternion, velocity, position, frame i.
sums : (18,). Strapdown integrals over the window.
rates : (2, 18). Rates of these integrals at which the transition is linearised, and their means over the last window.
previous : (6,) rad, m/s. Increments before the window.
increments : (n_tick, 6) rad, m/s. Increments of the window.
P : (n_state, n_state). Covariance of the filter.
X : (n_state, n_state). Scratch of the NEES: factor of the covariance.
D : (n_block, 9). Blocks of the transition.
x : (n_state,). Error state.
K : (n_state,). P h' of a scalar measurement.
H : (n_row, n_entry). Jacobian rows of the epoch.
z : (n_row,). Measured minus predicted.
antenna : (n_antenna, 21). Estimated antenna states, as in `line_of_sight.antenna`.
rate : (3,) rad/s. Estimated body rate.
true_par : (n_block, 3). True IMU parameters.
true_tables : (2, N_TABLE). Error tables of gyro and accelerometer, from the true parameters.
par : (n_par, 3). Estimated IMU parameters.
tables : (2, N_TABLE). Compensation tables of gyro and accelerometer, from the estimates.
remainder : (6,) rad, m/s. Remainder of quantisation.
clock : (2,) m, m/s. True clock bias and drift.
clock_hat : (2,) m, m/s. Estimated clock bias and drift.
shared : (n_component,). True correlated measurement errors.
extra : (n_extra,). Estimated extra states.
ranges : (n_slot, n_kind). Measured observables of the satellites.
solution : (6,) m, m/s. Measured position and velocity.
err : (n_hist, n_out). Estimation error, as in RunBlock.
sigma : (n_hist, n_out). Standard deviation in the filter's own covariance.
nees : (n_hist,). Normalised estimation error squared.
nis : (n_epoch,). Sum of squared normalised innovations.
n_row : (n_epoch,). Number of accepted scalar measurements.
n_reject : (n_epoch,). Number of rejected scalar measurements.
innovation : (n_epoch, n_channel). Normalised innovations.
failed : (1,). Failure code, as in RunBlock.
t_failed : (1,) s since lift-off. Time of the failure.
reported : (6, 6). Covariance reported with the solution.
observed : (n_sensor, 4). Measurements of the other sensors.
"""


class Truth(NamedTuple):
    """Truth of a case other than its signals, which the filter does not read.

    unit : Truth-side model of the IMU.
    start : True state at tick 0, and covariances of the initial error.
    record : True state at the ticks of the history times.
    """

    unit: ImuTruth
    start: InitialState
    record: HistoryTruth


@jit
def fly_lanes(work: Any, parts: Any, case: Any, truth: Any, key: Any) -> None:
    """Simulate eight runs: `fly` on lane views of arrays whose last axis is the run."""
    fly(view(work), view(parts), case, truth, key)


def new_work(prepared: Prepared, lanes: bool) -> tuple[Work, OptionalState]:
    """Return the arrays of one run, or of eight in lanes, all zero. No array is empty: a lane view needs a length."""
    model, signals, layout = prepared.model, prepared.signals, prepared.layout
    n = layout.n_state
    n_row = prepared.n_row
    n_lane = WIDTH if lanes else 0
    n_hist = prepared.t_hist.size
    n_epoch = prepared.t_epoch.size
    n_out = len(prepared.outputs)
    n_par = len(layout.parameters)
    n_true = len(prepared.unit.sigma)
    n_extra = model.extra_offset.size
    arrays = zeros_of({
        "run": (1,), "nav": (10,), "sums": (N_SUM,), "rates": (2, N_SUM), "previous": (6,),
        "increments": (int(prepared.schedule.n_tick.max(initial=0)), 6), "P": (n, n), "X": (n, n),
        "D": (model.block_rows.size, 9), "x": (n,), "K": (n,), "H": (n_row, model.entry.shape[1]), "z": (n_row,),
        "antenna": (len(model.lever_arms), 21), "rate": (3,), "true_par": (max(1, n_true), 3),
        "true_tables": (2, processes.N_TABLE), "par": (max(1, n_par), 3), "tables": (2, processes.N_TABLE),
        "remainder": (6,), "clock": (2,), "clock_hat": (2,), "shared": (max(1, signals.shared.start.size),),
        "extra": (max(1, n_extra),), "ranges": (signals.used.shape[1], model.n_kind), "solution": (6,),
        "err": (n_hist, n_out), "sigma": (n_hist, n_out), "nees": (n_hist,), "nis": (n_epoch,), "n_row": (n_epoch,),
        "n_reject": (n_epoch,), "innovation": (n_epoch, len(prepared.channel_names)), "failed": (1,),
        "t_failed": (1,), "reported": (6, 6), "observed": (max(1, len(prepared.devices)), 4),
    }, n_lane)  # fmt: skip
    arrays["run"] = arrays["run"].view(np.uint64)
    return Work(**arrays), _new_parts(prepared, n_lane)._replace(run=arrays["run"])


def _new_parts(prepared: Prepared, n_lane: int) -> OptionalState:
    """Return the arrays of the optional features that a case has; `n_lane` is 0 for one run."""
    options = prepared.options
    layout = prepared.layout
    parts = dict[str, Any]()
    n = layout.n_state
    n_channel = prepared.channels.n_receiver
    if options.solver is not None:
        parts["receiver"] = new_receiver(n_lane, len(prepared.sky.names))
    if prepared.scenario.filter.feedback == "open":
        parts["open_loop"] = new_open_loop(n, len(layout.parameters), prepared.model.extra_offset.size, n_lane)
    if options.late is not None:
        parts["state_history"] = aligned_zeros((options.late.buffered.size + 1, N_PAST, *((n_lane,) if n_lane else ())))
    if options.rules is not None:
        parts["mode_state"] = new_mode_state(prepared.t_epoch.size, n_channel, prepared.n_row, n_lane, n)
    if options.integrity is not None:
        sizes = (prepared.t_epoch.size, n_channel, prepared.n_row, options.integrity.window)
        parts["monitor"] = new_monitor(*sizes, n_lane)
    if options.vehicle is not None or options.samples is not None:
        n_entry = 0 if options.vehicle is None else options.vehicle.columns.shape[1]
        parts["motion"] = new_sample_work(n, n_entry, n_lane)
    if options.report is not None:
        parts["solution_error"] = LastSolutionError(
            **zeros_of({"error": (N_RECEIVER,), "covariance": (N_RECEIVER, N_RECEIVER)}, n_lane)
        )
    if options.units is not None:
        n_tick = int(prepared.schedule.n_tick.max(initial=0))
        parts["units"] = new_units(options.units, n_tick, n_lane)
    if options.delayed is not None:
        n_extra = prepared.model.extra_offset.size
        lever_arms = prepared.model.lever_arms
        parts["previous_epoch"] = new_previous_epoch(options.delayed, len(lever_arms), n_extra, n, n_lane)
        shape = (len(prepared.sky.names), prepared.model.n_kind)
        parts["previous_observables"] = aligned_zeros((*shape, *((n_lane,) if n_lane else ())))
    if options.misses is not None:
        parts["transition_errors"] = TransitionErrors(
            **zeros_of(dict.fromkeys(TransitionErrors._fields, (prepared.t_hist.size, n)), n_lane)
        )
    if options.backup is not None:
        parts["backup"] = new_backup(n, n_lane)
    if options.unscented is not None:
        n_tick = int(prepared.schedule.n_tick.max(initial=0))
        parts["sigma_points"] = new_sigma_points(n, len(layout.parameters), n_tick, prepared.n_row, n_lane)
    if options.iterated is not None:
        parts["iteration"] = new_iteration_work(n, prepared.model.extra_offset.size, n_lane)
    return OptionalState(**parts)


def _fly(prepared: Prepared, seed: int, first: int, lanes: bool, taped: bool = False) -> tuple[Work, OptionalState]:
    """Simulate run `first`, or eight runs from it on; taped: one run, with a tape."""
    work, parts = new_work(prepared, lanes)
    if taped:
        parts = parts._replace(tape=new_tape(work, len(prepared.unit.dtheta), prepared.t_epoch.size))
    runs = np.arange(first, first + (WIDTH if lanes else 1), dtype=np.uint64)
    work.run[0] = runs if lanes else runs[0]
    recorded = np.flatnonzero(prepared.signals.shared.given)
    if recorded.size:
        values = values_of(prepared.recorded, seed, runs)
        work.shared[recorded] = values if lanes else values[:, 0]
    truth = Truth(prepared.unit, prepared.start, prepared.record)
    (fly_lanes if lanes else fly)(work, parts, case_of(prepared), truth, seed_words(seed))
    return work, parts


class TapedRun(NamedTuple):
    """Inputs and estimates of the filter in one run.

    tape : Tape. Inputs of the filter and its estimates.
    innovation : (n_epoch, n_channel). Normalised innovations; not-a-number without a measurement.
    accepted : (n_epoch,). Number of accepted scalar measurements.
    rejected : (n_epoch,). Number of scalar measurements that the gate rejects.
    """

    tape: Tape
    innovation: Floats
    accepted: Floats
    rejected: Floats


def taped(prepared: Prepared, seed: int, run: int) -> TapedRun:
    """Return the inputs and estimates of the filter in one run.

    The gravity disturbance is switched off: the simulation adds it to the error of the estimate, so the recorded inputs
    alone would not reproduce the estimates.
    """
    undisturbed = prepared._replace(unit=prepared.unit._replace(gravity=-1))
    work, parts = _fly(undisturbed, seed, run, lanes=False, taped=True)
    return TapedRun(parts.tape, work.innovation, work.n_row, work.n_reject)


def compile_kernels(prepared: Prepared) -> None:
    """Compile the kernels of the simulation, or load them from the cache, by a run without windows."""
    none = np.zeros(0, dtype=np.int64)
    grounded = prepared._replace(schedule=Schedule(*[none] * len(Schedule._fields)))
    _fly(grounded, 0, 0, not config.DISABLE_JIT)


def _by_run(array: Floats, lanes: bool) -> Floats:
    """Return an array of one run or eight lanes with the run on the first axis."""
    return np.moveaxis(array, -1, 0) if lanes else array[None]


def simulated(prepared: Prepared, seed: int, n_run: int) -> Iterator[TransitionErrors]:
    """Yield the transition errors of runs 0 to n_run - 1, some runs at a time, with the run on the first axis."""
    lanes = not config.DISABLE_JIT
    for first in range(0, n_run, WIDTH if lanes else 1):
        misses = _fly(prepared, seed, first, lanes)[1].transition_errors
        yield TransitionErrors(*(_by_run(array, lanes)[: n_run - first] for array in misses))


def end_of_run(prepared: Prepared, at: int) -> tuple[Floats, Floats, bool]:
    """Return errors and covariance of run 0.

    Returns
    -------
    err
        (n_out,) SI. Errors at history time number `at`.
    P
        (n_state, n_state). Covariance of the filter at the end.
    failed
        Whether the run failed.
    """
    lanes = not config.DISABLE_JIT
    work, _ = _fly(prepared, 0, 0, lanes)
    err, P, failed = (_by_run(array, lanes)[0] for array in (work.err, work.P, work.failed))
    return err[at], P, bool(failed[0])


_OUTPUT = {"err": float, "sigma": float, "nees": float, "nis": float, "n_row": np.int32, "n_reject": np.int32,
           "innovation": float, "failed": np.int8, "t_failed": float}  # fmt: skip


def run_block(prepared: Prepared, seed: int, first_run: int, n_run: int, lanes: bool | None = None) -> RunBlock:
    """Simulate runs first_run to first_run + n_run - 1.

    The results of a run depend on the seed and on its number only, not on its block.

    Parameters
    ----------
    prepared
        Prepared case.
    seed
        Seed of the campaign.
    first_run, n_run
        Number of the first run, and number of runs.
    lanes
        Whether eight runs are simulated at once, which agrees with one run at a time to rounding. None: if compiled
        code is available.

    Returns
    -------
    RunBlock
        Errors, sigmas and counts of the runs.
    """
    use_lanes = not config.DISABLE_JIT if lanes is None else lanes
    width = WIDTH if use_lanes else 1
    joined: dict[str, Any] = {}
    changes = [NO_CHANGES]
    decisions = [NO_DECISIONS]
    for done in range(0, n_run, width):
        first = first_run + done
        new = min(width, n_run - done)
        work, parts = _fly(prepared, seed, first, use_lanes)
        for name, kind in _OUTPUT.items():
            runs = _by_run(getattr(work, name), use_lanes)
            joined.setdefault(name, np.empty((n_run, *runs.shape[1:]), dtype=kind))[done : done + new] = runs[:new]
        if parts.mode_state is not None:
            changes.append(_changes(prepared, parts.mode_state, first, new, use_lanes))
        if parts.monitor is not None:
            isolated, excluded = (
                _by_run(log, use_lanes)[:new] for log in (parts.monitor.isolated, parts.monitor.excluded)
            )
            decisions.append(decisions_of(isolated, excluded, prepared.t_epoch, first))
        if parts.units is not None and parts.units.redundant is not None:
            decisions.append(_excluded(prepared, parts.units.redundant, first, new, use_lanes))
    joined |= {name: joined[name][:, 0] for name in ("failed", "t_failed")}
    ends, lost = injections(prepared, seed, first_run, joined["err"])
    return RunBlock(
        first_run=first_run,
        t=prepared.t_hist,
        t_epoch=prepared.t_epoch,
        changes=np.concatenate(changes),
        decisions=np.concatenate(decisions),
        injections=ends,
        lost=lost,
        **joined,
    )


def _changes(prepared: Prepared, mode_state: ModeState, first_run: int, n_run: int, lanes: bool) -> Floats:
    """Return the mode transitions (n, 5) of some runs: run, t (s), mode before, mode after, reason."""
    mode, reason = (_by_run(array, lanes)[:n_run] for array in (mode_state.mode, mode_state.reason))
    before = np.hstack([np.full((n_run, 1), WAITING), mode[:, :-1]])
    run, at = np.nonzero(reason)
    check = prepared.failing[None, :]
    reason = np.where((reason == DATA_LOST) & (check > 0), check, reason)
    return np.stack([first_run + run, prepared.t_epoch[at], before[run, at], mode[run, at], reason[run, at]], axis=1)


def _excluded(prepared: Prepared, redundant: RedundancyWork, first_run: int, n_run: int, lanes: bool) -> Floats:
    """Return the decisions (n, 4) on redundant IMUs in some runs: exclusion of an IMU, or an alarm without exclusion.

    The columns are those of `filter.policies.integrity.state.decisions_of`.
    """
    out, when, alarm = (_by_run(array, lanes)[:n_run] for array in (redundant.out, redundant.when, redundant.alarm))
    run, unit = np.nonzero(out)
    alarmed = np.flatnonzero(alarm[:, 0])
    tick = np.concatenate([when[run, unit], alarm[alarmed, 0]])
    kind = np.repeat([float(OF_UNIT), float(OF_INERTIAL)], [run.size, alarmed.size])
    named = np.concatenate([FIRST_UNIT - unit, np.full(alarmed.size, -1)])
    t = prepared.unit.start + prepared.unit.dt * tick
    return np.stack([first_run + np.concatenate([run, alarmed]), t, kind, named], axis=1)


def replay(prepared: Prepared, seed: int, run: int) -> RunBlock:
    """Simulate one run again, bit for bit as in its block, with every covariance step recorded.

    The additional history times are at covariance steps, where windows of the block end anyway, so the results are
    those of the block.
    """
    return run_block(prepare(prepared.scenario, every_step_beside=prepared.t_hist), seed, run, 1)
