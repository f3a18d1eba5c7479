"""Reported quantities of a case: outputs, true state and axes at the history times, names of innovations."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.receiver import Solver
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, reporting_axes
from lvnav_trade.quantities.records import Motion, Output
from lvnav_trade.quantities.state_layout import StateLayout, backup_outputs, outputs, solution_outputs
from lvnav_trade.scenario.filter_models import measured, reported, solves
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
    scenario: Scenario, flight: TrueFlight, times: Times, layout: StateLayout, solution: ReportedSolution | None
) -> Reporting:
    """Return the reported quantities of a case; solution: of `solution_of`."""
    frame, trajectory = scenario.frame, flight.trajectory
    shown = (*outputs(layout, frame), *(solution_outputs(frame) if reported(scenario) else ()))
    backup = backup_outputs(frame) if scenario.filter.backup else ()
    return Reporting(
        outputs=(*shown, *backup),
        backup=len(shown) if backup else None,
        solution=solution,
        channel_names=_channel_names(scenario, flight.channels, solution),
        record=_record(scenario, flight, times),
        motion=motion(trajectory, np.clip(times.t_hist, trajectory.start, trajectory.end)),
    )


def solution_of(
    scenario: Scenario, chain: SolutionErrorModel | None, channels: Channels, layout: StateLayout, solver: Solver | None
) -> ReportedSolution | None:
    """Return the inputs of the reported errors of the receiver's solution; None if they are not reported."""
    if chain is None or not reported(scenario):
        return None
    first = channels.n_channel + N_SAMPLE * (layout.motion >= 0)
    n_own = 2 * len(channels.satellites) if solver is not None and solver.filter is not None else 0
    return ReportedSolution(chain.point, len(outputs(layout, scenario.frame)), first, n_own)


def _channel_names(scenario: Scenario, channels: Channels, report: ReportedSolution | None) -> tuple[str, ...]:
    """Return the names of all innovations: filter channels, IMU samples, receiver's filter."""
    if not measured(scenario) and not solves(scenario):
        return ("none",)
    sensors = ("gyro", "accelerometer") if "imu" in scenario.filter.measurements else ()
    solved = channels.satellites if report is not None and report.n_channel else ()
    receiver_names = [f"receiver {name} {what}" for name in solved for what in ("range", "range rate")]
    return (*channels.names, *(f"{sensor} {axis}" for sensor in sensors for axis in "xyz"), *receiver_names)


def _record(scenario: Scenario, flight: TrueFlight, times: Times) -> HistoryTruth:
    ticks, ref = times.hist_tick, flight.reference
    t, r, v, q = (np.ascontiguousarray(a[ticks]) for a in (ref.t, ref.r_i, ref.v_i, ref.q_b_i))
    theta0 = flight.trajectory.theta0
    pad_e = ecef_from_eci(ref.r_i[:1], earth_angle(theta0, ref.t[:1]))[0]
    shown = reporting_axes(scenario.frame, t, r, v, theta0, pad_e)
    marks = np.concatenate([[0], flight.epochs.tick])
    since = (ticks - marks[np.searchsorted(marks, ticks, side="right") - 1]) / scenario.imu.rate
    return HistoryTruth(r, v, q, np.ascontiguousarray(shown), t, since, scenario.diverged)
