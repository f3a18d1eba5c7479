"""Reported quantities of a case: outputs, true state and axes at the history times, names of innovations."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.receiver import Solver
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, reporting_axes
from lvnav_trade.quantities.records import Motion, Output
from lvnav_trade.quantities.state_layout import StateLayout, backup_outputs, outputs, solution_outputs
from lvnav_trade.scenario.filter_models import filter_measurements, has_receiver_solution, is_solution_reported
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.simulation.preparation.inputs import HistoryTruth, ReportedSolution
from lvnav_trade.simulation.preparation.schedule import Times
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel
from lvnav_trade.simulation.preparation.true_flight import TrueFlight
from lvnav_trade.trajectory.truth import motion


class Reporting(NamedTuple):
    """Reported quantities of a case.

    outputs : Error components, in the order of the history's columns.
    backup : First output of the backup strapdown; None without.
    solution : Inputs of the reported errors of the receiver's solution; None without.
    channel_names : Names of all innovations.
    record : True state at the ticks of the history times.
    motion : True motion at the history times, some of which lie between two ticks.
    """

    outputs: tuple[Output, ...]
    backup: int | None
    solution: ReportedSolution | None
    channel_names: tuple[str, ...]
    record: HistoryTruth
    motion: Motion


def reporting_of(
    scenario: Scenario,
    flight: TrueFlight,
    times: Times,
    layout: StateLayout,
    solution: ReportedSolution | None,
) -> Reporting:
    """Return the reported quantities of a case.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    times
        Schedule of the flight.
    layout
        States of the filter.
    solution
        As from `solution_of`.
    """
    frame, trajectory = scenario.frame, flight.trajectory
    main = outputs(layout, frame)
    if is_solution_reported(scenario):
        main = (*main, *solution_outputs(frame))
    backup = backup_outputs(frame) if scenario.filter.backup else ()
    t_in_flight = np.clip(times.t_hist, trajectory.start, trajectory.end)
    return Reporting(
        outputs=(*main, *backup),
        backup=len(main) if backup else None,
        solution=solution,
        channel_names=_channel_names(scenario, flight.channels, solution),
        record=_record(scenario, flight, times),
        motion=motion(trajectory, t_in_flight),
    )


def solution_of(
    scenario: Scenario,
    chain: SolutionErrorModel | None,
    channels: Channels,
    layout: StateLayout,
    solver: Solver | None,
) -> ReportedSolution | None:
    """Return the inputs of the reported errors of the receiver's solution; None if they are not reported.

    Parameters
    ----------
    scenario
        Validated model of the case.
    chain
        Error propagation of the solution; None without a reported covariance.
    channels, layout
        Measurement channels and states of the filter.
    solver
        Settings of the receiver's solution; None if it is simulated directly.
    """
    if chain is None or not is_solution_reported(scenario):
        return None
    n_sample = N_SAMPLE if layout.motion >= 0 else 0
    has_filter = solver is not None and solver.filter is not None
    return ReportedSolution(
        point=chain.point,
        first_output=len(outputs(layout, scenario.frame)),
        first_channel=channels.n_channel + n_sample,
        n_channel=2 * len(channels.satellites) if has_filter else 0,
    )


def _channel_names(scenario: Scenario, channels: Channels, report: ReportedSolution | None) -> tuple[str, ...]:
    """Return the names of all innovations: filter channels, IMU samples, receiver's filter."""
    if not filter_measurements(scenario) and not has_receiver_solution(scenario):
        return ("none",)
    names = list(channels.names)
    if "imu" in scenario.filter.measurements:
        names += [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    if report is not None and report.n_channel:
        for satellite in channels.satellites:
            names += [f"receiver {satellite} range", f"receiver {satellite} range rate"]
    return tuple(names)


def _record(scenario: Scenario, flight: TrueFlight, times: Times) -> HistoryTruth:
    """Return the true state at the ticks of the history times, with the reporting axes there."""
    ticks = times.hist_tick
    ref = flight.reference
    t = np.ascontiguousarray(ref.t[ticks])
    r = np.ascontiguousarray(ref.r_i[ticks])
    v = np.ascontiguousarray(ref.v_i[ticks])
    q = np.ascontiguousarray(ref.q_b_i[ticks])
    theta0 = flight.trajectory.theta0
    initial_angle = earth_angle(theta0, ref.t[:1])
    pad_e = ecef_from_eci(ref.r_i[:1], initial_angle)[0]
    axes = reporting_axes(scenario.frame, t, r, v, theta0, pad_e)
    # time since the last epoch, or since the start before the first
    epoch_ticks = np.concatenate([[0], flight.epochs.tick])
    last_epoch = np.searchsorted(epoch_ticks, ticks, side="right") - 1
    ticks_since_epoch = ticks - epoch_ticks[last_epoch]
    time_since_epoch = ticks_since_epoch / scenario.imu.rate
    return HistoryTruth(r, v, q, np.ascontiguousarray(axes), t, time_since_epoch, scenario.diverged)
