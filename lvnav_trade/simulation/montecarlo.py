"""Monte Carlo simulation: blocks of runs, eight runs at a time in vector lanes."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import config

from lvnav_trade.filter.policies.integrity.state import fault_decisions
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
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.simulation.preparation.signals.recorded_solution import run_coefficients
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
def fly_lanes(work: Any, optional_state: Any, case: Any, truth: Any, key: Any) -> None:
    """Simulate eight runs: `fly` on lane views of arrays whose last axis is the run."""
    fly(view(work), view(optional_state), case, truth, key)


def _simulate(
    prepared_case: PreparedCase,
    seed: int,
    first: int,
    uses_lanes: bool,
    has_tape: bool = False,
) -> tuple[Work, OptionalState]:
    """Simulate one run, or eight runs at a time.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    first
        Number of the first run.
    uses_lanes
        Whether eight runs are simulated in vector lanes.
    has_tape
        Whether a single run is recorded on a tape.
    """
    work, optional_state = new_work(prepared_case, uses_lanes)
    if has_tape:
        tape = new_tape(work, len(prepared_case.unit.dtheta), prepared_case.t_epoch.size)
        optional_state = optional_state._replace(tape=tape)
    n_run = WIDTH if uses_lanes else 1
    runs = np.arange(first, first + n_run, dtype=np.uint64)
    work.run[0] = runs if uses_lanes else runs[0]
    recorded_components = np.flatnonzero(prepared_case.signals.correlated_errors.is_recorded)
    if recorded_components.size:
        values = run_coefficients(prepared_case.recorded_errors, seed, runs)
        work.correlated_errors[recorded_components] = values if uses_lanes else values[:, 0]
    truth = Truth(prepared_case.unit, prepared_case.initial_state, prepared_case.record)
    simulate = fly_lanes if uses_lanes else fly
    simulate(work, optional_state, case_of(prepared_case), truth, seed_words(seed))
    return work, optional_state


class TapedRun(NamedTuple):
    """Inputs and estimates of the filter in one run.

    tape : Tape. Inputs of the filter and its estimates.
    innovation : (n_epoch, n_channel). Normalised innovations; not-a-number without a measurement.
    accepted_count : (n_epoch,). Number of accepted scalar measurements.
    rejected_count : (n_epoch,). Number of scalar measurements that the gate rejects.
    """

    tape: Tape
    innovation: Floats
    accepted_count: Floats
    rejected_count: Floats


def record_run(prepared_case: PreparedCase, seed: int, run: int) -> TapedRun:
    """Return the inputs and estimates of the filter in one run.

    The gravity disturbance is switched off: the simulation adds it to the error of the estimate, so the recorded inputs
    alone would not reproduce the estimates.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    run
        Number of the run.
    """
    undisturbed_imu = prepared_case.unit._replace(gravity=-1)
    undisturbed_case = prepared_case._replace(unit=undisturbed_imu)
    work, optional_state = _simulate(undisturbed_case, seed, run, uses_lanes=False, has_tape=True)
    return TapedRun(optional_state.tape, work.innovation, work.n_row, work.n_reject)


def compile_kernels(prepared_case: PreparedCase) -> None:
    """Compile the kernels of the simulation, or load them from the cache, by a run without windows."""
    none = np.zeros(0, dtype=np.int64)
    no_windows = Schedule(*[none] * len(Schedule._fields))
    without_windows = prepared_case._replace(schedule=no_windows)
    uses_lanes = not config.DISABLE_JIT
    _simulate(without_windows, 0, 0, uses_lanes)


def _run_axis_first(array: Floats, uses_lanes: bool) -> Floats:
    """Return an array of one run or eight lanes with the run on the first axis."""
    if uses_lanes:
        return np.moveaxis(array, -1, 0)
    return array[None]


def simulate_transition_errors(prepared_case: PreparedCase, seed: int, n_run: int) -> Iterator[TransitionErrors]:
    """Yield the transition errors of runs 0 to n_run - 1, some runs at a time, with the run on the first axis.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    n_run
        Number of runs.
    """
    uses_lanes = not config.DISABLE_JIT
    width = WIDTH if uses_lanes else 1
    for first in range(0, n_run, width):
        _, optional_state = _simulate(prepared_case, seed, first, uses_lanes)
        transition_errors = optional_state.transition_errors
        n_remaining = n_run - first
        error = _run_axis_first(transition_errors.error, uses_lanes)[:n_remaining]
        transition_error = _run_axis_first(transition_errors.transition_error, uses_lanes)[:n_remaining]
        yield TransitionErrors(error, transition_error)


def first_run_errors(prepared_case: PreparedCase, hist: int) -> tuple[Floats, Floats, bool]:
    """Return errors and covariance of run 0.

    Returns
    -------
    err
        (n_out,) SI. Errors at history time number `hist`.
    P
        (n_state, n_state). Covariance of the filter at the end.
    has_failed
        Whether the run failed.
    """
    uses_lanes = not config.DISABLE_JIT
    work, _ = _simulate(prepared_case, 0, 0, uses_lanes)
    err = _run_axis_first(work.err, uses_lanes)[0]
    P = _run_axis_first(work.P, uses_lanes)[0]
    failure_codes = _run_axis_first(work.failed, uses_lanes)[0]
    return err[hist], P, bool(failure_codes[0])


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


def run_block(
    prepared_case: PreparedCase, seed: int, first_run: int, n_run: int, uses_lanes: bool | None = None
) -> RunBlock:
    """Simulate runs first_run to first_run + n_run - 1.

    The results of a run depend on the seed and on its number only, not on its block.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    first_run, n_run
        Number of the first run, and number of runs.
    uses_lanes
        Whether eight runs are simulated at once, which agrees with one run at a time to rounding. None: if compiled
        code is available.

    Returns
    -------
    RunBlock
        Errors, sigmas and counts of the runs.
    """
    if uses_lanes is None:
        uses_lanes = not config.DISABLE_JIT
    width = WIDTH if uses_lanes else 1
    arrays: dict[str, Any] = {}
    changes = [NO_CHANGES]
    decisions = [NO_DECISIONS]
    for run_offset in range(0, n_run, width):
        first = first_run + run_offset
        n_new = min(width, n_run - run_offset)
        work, optional_state = _simulate(prepared_case, seed, first, uses_lanes)
        for name, dtype in _OUTPUT.items():
            runs = _run_axis_first(getattr(work, name), uses_lanes)
            if name not in arrays:
                arrays[name] = np.empty((n_run, *runs.shape[1:]), dtype=dtype)
            arrays[name][run_offset : run_offset + n_new] = runs[:n_new]
        if optional_state.mode_state is not None:
            changes.append(_mode_transitions(prepared_case, optional_state.mode_state, first, n_new, uses_lanes))
        if optional_state.monitor is not None:
            isolations = _run_axis_first(optional_state.monitor.fault_type, uses_lanes)[:n_new]
            exclusions = _run_axis_first(optional_state.monitor.is_excluded, uses_lanes)[:n_new]
            decisions.append(fault_decisions(isolations, exclusions, prepared_case.t_epoch, first))
        if optional_state.units is not None and optional_state.units.redundant is not None:
            decisions.append(
                _exclusion_decisions(prepared_case, optional_state.units.redundant, first, n_new, uses_lanes)
            )
    for name in ("failed", "t_failed"):
        arrays[name] = arrays[name][:, 0]
    injection_rows, lost_draws = injections(prepared_case, seed, first_run, arrays["err"])
    return RunBlock(
        first_run=first_run,
        t=prepared_case.t_hist,
        t_epoch=prepared_case.t_epoch,
        changes=np.concatenate(changes),
        decisions=np.concatenate(decisions),
        injections=injection_rows,
        lost_draws=lost_draws,
        **arrays,
    )


def _mode_transitions(
    prepared_case: PreparedCase, mode_state: ModeState, first_run: int, n_run: int, uses_lanes: bool
) -> Floats:
    """Return the mode transitions (n, 5) of some runs: run, t (s), mode before, mode after, reason.

    Parameters
    ----------
    prepared_case
        Prepared case.
    mode_state
        Modes and reasons of the runs at the epochs.
    first_run, n_run
        Number of the first run, and number of runs.
    uses_lanes
        Whether the last axis of the arrays is the run.
    """
    mode = _run_axis_first(mode_state.mode, uses_lanes)[:n_run]
    reason = _run_axis_first(mode_state.reason, uses_lanes)[:n_run]
    initial_mode = np.full((n_run, 1), WAITING)
    previous_mode = np.hstack([initial_mode, mode[:, :-1]])
    run, epoch = np.nonzero(reason)
    t = prepared_case.t_epoch[epoch]
    mode_before = previous_mode[run, epoch]
    mode_after = mode[run, epoch]
    # a sample that is lost for a failed input check has the number of that check
    check = prepared_case.failed_check[epoch]
    numbers = reason[run, epoch]
    has_failed_check = (numbers == DATA_LOST) & (check > 0)
    numbers = np.where(has_failed_check, check, numbers)
    columns = (first_run + run, t, mode_before, mode_after, numbers)
    return np.stack(columns, axis=1)


def _exclusion_decisions(
    prepared_case: PreparedCase, redundant: RedundancyWork, first_run: int, n_run: int, uses_lanes: bool
) -> Floats:
    """Return the decisions (n, 4) on redundant IMUs in some runs: exclusion of an IMU, or an alarm without exclusion.

    The columns are those of `filter.policies.integrity.state.fault_decisions`.
    """
    exclusion_flag = _run_axis_first(redundant.exclusion_flag, uses_lanes)[:n_run]
    tick_by_imu = _run_axis_first(redundant.exclusion_tick, uses_lanes)[:n_run]
    alarm = _run_axis_first(redundant.alarm, uses_lanes)[:n_run, 0]
    run, unit = np.nonzero(exclusion_flag)
    alarm_run = np.flatnonzero(alarm)
    n_alarm = alarm_run.size
    exclusion_tick = tick_by_imu[run, unit]
    alarm_tick = alarm[alarm_run]
    tick = np.concatenate([exclusion_tick, alarm_tick])
    decisions = [float(OF_UNIT), float(OF_INERTIAL)]
    decision = np.repeat(decisions, [run.size, n_alarm])
    no_subject = np.full(n_alarm, -1)
    subject = np.concatenate([FIRST_UNIT - unit, no_subject])
    imu = prepared_case.unit
    t = imu.start + imu.dt * tick
    runs = first_run + np.concatenate([run, alarm_run])
    return np.stack([runs, t, decision, subject], axis=1)


def replay(prepared_case: PreparedCase, seed: int, run: int) -> RunBlock:
    """Simulate one run again, bit for bit as in its block, with every covariance step recorded.

    The additional history times are at covariance steps, where windows of the block end anyway, so the results are
    those of the block.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the campaign.
    run
        Number of the run.
    """
    with_steps = prepare(prepared_case.scenario, additional_times=prepared_case.t_hist)
    return run_block(with_steps, seed, run, 1)
