"""Monte Carlo simulation: blocks of runs, eight runs at a time in vector lanes."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import config

from lvnav_trade.filter.policies.integrity.state import decisions_of
from lvnav_trade.filter.policies.mode_logic import DATA_LOST, ModeState
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.random import seed_words
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
from lvnav_trade.simulation.imu_redundancy import RedundancyWork
from lvnav_trade.simulation.preparation.imu_inputs import ImuTruth
from lvnav_trade.simulation.preparation.inputs import HistoryTruth, InitialState, Schedule
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare
from lvnav_trade.simulation.preparation.signals.recorded_solution import values_of
from lvnav_trade.simulation.run_arrays import TransitionErrors, Work, new_work
from lvnav_trade.simulation.tape import Tape, new_tape


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


def _simulate(
    prepared: Prepared,
    seed: int,
    first: int,
    lanes: bool,
    taped: bool = False,
) -> tuple[Work, OptionalState]:
    """Simulate one run, or eight runs at a time.

    Parameters
    ----------
    prepared
        Prepared case.
    seed
        Seed of the campaign.
    first
        Number of the first run.
    lanes
        Whether eight runs are simulated in vector lanes.
    taped
        Whether a single run is recorded on a tape.
    """
    work, parts = new_work(prepared, lanes)
    if taped:
        parts = parts._replace(tape=new_tape(work, len(prepared.unit.dtheta), prepared.t_epoch.size))
    n_run = WIDTH if lanes else 1
    runs = np.arange(first, first + n_run, dtype=np.uint64)
    work.run[0] = runs if lanes else runs[0]
    recorded = np.flatnonzero(prepared.signals.shared.given)
    if recorded.size:
        values = values_of(prepared.recorded, seed, runs)
        work.shared[recorded] = values if lanes else values[:, 0]
    truth = Truth(prepared.unit, prepared.start, prepared.record)
    simulate = fly_lanes if lanes else fly
    simulate(work, parts, case_of(prepared), truth, seed_words(seed))
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

    Parameters
    ----------
    prepared
        Prepared case.
    seed
        Seed of the campaign.
    run
        Number of the run.
    """
    undisturbed_imu = prepared.unit._replace(gravity=-1)
    undisturbed = prepared._replace(unit=undisturbed_imu)
    work, parts = _simulate(undisturbed, seed, run, lanes=False, taped=True)
    return TapedRun(parts.tape, work.innovation, work.n_row, work.n_reject)


def compile_kernels(prepared: Prepared) -> None:
    """Compile the kernels of the simulation, or load them from the cache, by a run without windows."""
    none = np.zeros(0, dtype=np.int64)
    no_windows = Schedule(*[none] * len(Schedule._fields))
    without_windows = prepared._replace(schedule=no_windows)
    lanes = not config.DISABLE_JIT
    _simulate(without_windows, 0, 0, lanes)


def _by_run(array: Floats, lanes: bool) -> Floats:
    """Return an array of one run or eight lanes with the run on the first axis."""
    if lanes:
        return np.moveaxis(array, -1, 0)
    return array[None]


def simulated(prepared: Prepared, seed: int, n_run: int) -> Iterator[TransitionErrors]:
    """Yield the transition errors of runs 0 to n_run - 1, some runs at a time, with the run on the first axis.

    Parameters
    ----------
    prepared
        Prepared case.
    seed
        Seed of the campaign.
    n_run
        Number of runs.
    """
    lanes = not config.DISABLE_JIT
    width = WIDTH if lanes else 1
    for first in range(0, n_run, width):
        _, parts = _simulate(prepared, seed, first, lanes)
        transition_errors = parts.transition_errors
        n_remaining = n_run - first
        error = _by_run(transition_errors.error, lanes)[:n_remaining]
        missed = _by_run(transition_errors.missed, lanes)[:n_remaining]
        yield TransitionErrors(error, missed)


def end_of_run(prepared: Prepared, hist: int) -> tuple[Floats, Floats, bool]:
    """Return errors and covariance of run 0.

    Returns
    -------
    err
        (n_out,) SI. Errors at history time number `hist`.
    P
        (n_state, n_state). Covariance of the filter at the end.
    failed
        Whether the run failed.
    """
    lanes = not config.DISABLE_JIT
    work, _ = _simulate(prepared, 0, 0, lanes)
    err = _by_run(work.err, lanes)[0]
    P = _by_run(work.P, lanes)[0]
    failed = _by_run(work.failed, lanes)[0]
    return err[hist], P, bool(failed[0])


_OUTPUT = {
    "err": float,
    "sigma": float,
    "nees": float,
    "nis": float,
    "n_row": np.int32,
    "n_reject": np.int32,
    "innovation": float,
    "failed": np.int8,
    "t_failed": float,
}
"""Fields of a block that are arrays of the runs, and their types."""


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
        work, parts = _simulate(prepared, seed, first, use_lanes)
        for name, dtype in _OUTPUT.items():
            runs = _by_run(getattr(work, name), use_lanes)
            if name not in joined:
                joined[name] = np.empty((n_run, *runs.shape[1:]), dtype=dtype)
            joined[name][done : done + new] = runs[:new]
        if parts.mode_state is not None:
            changes.append(_changes(prepared, parts.mode_state, first, new, use_lanes))
        if parts.monitor is not None:
            isolated = _by_run(parts.monitor.isolated, use_lanes)[:new]
            excluded = _by_run(parts.monitor.excluded, use_lanes)[:new]
            decisions.append(decisions_of(isolated, excluded, prepared.t_epoch, first))
        if parts.units is not None and parts.units.redundant is not None:
            decisions.append(_excluded(prepared, parts.units.redundant, first, new, use_lanes))
    for name in ("failed", "t_failed"):
        joined[name] = joined[name][:, 0]
    injected, lost = injections(prepared, seed, first_run, joined["err"])
    return RunBlock(
        first_run=first_run,
        t=prepared.t_hist,
        t_epoch=prepared.t_epoch,
        changes=np.concatenate(changes),
        decisions=np.concatenate(decisions),
        injections=injected,
        lost=lost,
        **joined,
    )


def _changes(prepared: Prepared, mode_state: ModeState, first_run: int, n_run: int, lanes: bool) -> Floats:
    """Return the mode transitions (n, 5) of some runs: run, t (s), mode before, mode after, reason.

    Parameters
    ----------
    prepared
        Prepared case.
    mode_state
        Modes and reasons of the runs at the epochs.
    first_run, n_run
        Number of the first run, and number of runs.
    lanes
        Whether the last axis of the arrays is the run.
    """
    mode = _by_run(mode_state.mode, lanes)[:n_run]
    reason = _by_run(mode_state.reason, lanes)[:n_run]
    initial_mode = np.full((n_run, 1), WAITING)
    before = np.hstack([initial_mode, mode[:, :-1]])
    run, epoch = np.nonzero(reason)
    t = prepared.t_epoch[epoch]
    mode_before = before[run, epoch]
    mode_after = mode[run, epoch]
    # a sample that is lost for a failed input check has the number of that check
    check = prepared.failing[epoch]
    numbers = reason[run, epoch]
    has_failed_check = (numbers == DATA_LOST) & (check > 0)
    numbers = np.where(has_failed_check, check, numbers)
    columns = (first_run + run, t, mode_before, mode_after, numbers)
    return np.stack(columns, axis=1)


def _excluded(prepared: Prepared, redundant: RedundancyWork, first_run: int, n_run: int, lanes: bool) -> Floats:
    """Return the decisions (n, 4) on redundant IMUs in some runs: exclusion of an IMU, or an alarm without exclusion.

    The columns are those of `filter.policies.integrity.state.decisions_of`.
    """
    out = _by_run(redundant.out, lanes)[:n_run]
    when = _by_run(redundant.when, lanes)[:n_run]
    alarm = _by_run(redundant.alarm, lanes)[:n_run, 0]
    run, unit = np.nonzero(out)
    alarm_run = np.flatnonzero(alarm)
    n_alarm = alarm_run.size
    exclusion_tick = when[run, unit]
    alarm_tick = alarm[alarm_run]
    tick = np.concatenate([exclusion_tick, alarm_tick])
    decisions = [float(OF_UNIT), float(OF_INERTIAL)]
    decision = np.repeat(decisions, [run.size, n_alarm])
    no_subject = np.full(n_alarm, -1)
    subject = np.concatenate([FIRST_UNIT - unit, no_subject])
    imu = prepared.unit
    t = imu.start + imu.dt * tick
    runs = first_run + np.concatenate([run, alarm_run])
    return np.stack([runs, t, decision, subject], axis=1)


def replay(prepared: Prepared, seed: int, run: int) -> RunBlock:
    """Simulate one run again, bit for bit as in its block, with every covariance step recorded.

    The additional history times are at covariance steps, where windows of the block end anyway, so the results are
    those of the block.

    Parameters
    ----------
    prepared
        Prepared case.
    seed
        Seed of the campaign.
    run
        Number of the run.
    """
    with_steps = prepare(prepared.scenario, additional_times=prepared.t_hist)
    return run_block(with_steps, seed, run, 1)
