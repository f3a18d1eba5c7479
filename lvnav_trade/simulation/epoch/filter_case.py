"""Filter inputs of a case, arrays of its optional features, and storage of the receiver's last solution."""

from collections import namedtuple
from typing import Any, NamedTuple

from lvnav_trade.filter.receivers.receiver import BIAS as RX_BIAS
from lvnav_trade.filter.receivers.receiver import DRIFT as RX_DRIFT
from lvnav_trade.filter.receivers.receiver import N_FIX
from lvnav_trade.filter.receivers.receiver import N_STATE as N_RX
from lvnav_trade.filter.receivers.receiver import POS as RX_POS
from lvnav_trade.filter.receivers.receiver import VEL as RX_VEL
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.simulation.preparation.inputs import Options
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.preparation.sensors import sensor_arrays


class FilterCase(NamedTuple):
    """Inputs of the filter of a case, the same in every run. Optional fields are None if the case lacks the feature.

    Functions of an epoch pass it on as a whole. Functions at the lowest level take single fields, so that one compiled
    version serves many cases; an optional field is an argument of its own, so that the compiler drops `if ... is None`.

    schedule : Schedule. Windows of IMU ticks.
    signals : Signals. Satellites and receiver at the epochs.
    sensors : Sensors. The other sensors, possibly none; None if their code is not compiled.
    model : FilterModel. The filter as arrays.
    options : Options. Optional features.
    tick : s. Sampling interval of the IMU.
    step : s. Step of the strapdown.
    """

    schedule: Any
    signals: Any
    sensors: Any
    model: Any
    options: Any
    tick: float
    step: float


def case_of(prepared_case: PreparedCase, **changed: Any) -> FilterCase:
    """Return the filter inputs of a prepared case, with some fields replaced."""
    tick = prepared_case.unit.dt
    sensors = prepared_case.sensors
    if sensors is None and _compiles_sensors(prepared_case.options):
        sensors = sensor_arrays((), prepared_case.channels, prepared_case.t_epoch.size)
    case = FilterCase(
        prepared_case.schedule,
        prepared_case.signals,
        sensors,
        prepared_case.model,
        prepared_case.options,
        tick,
        tick * prepared_case.model.strapdown.subsamples,
    )
    return case._replace(**changed)


def _compiles_sensors(options: Options) -> bool:
    """Whether the kernels of a case include the code of sensors even if the case has no sensor.

    Filters with these features often have sensors. Cases with and without sensors then share one compiled version.
    """
    features = (options.vehicle, options.imu_array, options.delay_processing)
    return any(feature is not None for feature in features)


OptionalState = namedtuple(
    "OptionalState",
    "run receiver open_loop mode_state state_history motion solution_error transition_errors units backup"
    " previous_epoch previous_observables sigma_points monitor iteration tape",
    defaults=(None, None, None, None, None, None, None, None, None, None, None, None, None, None, None, None),
)
"""Arrays of the optional features of a case; None without the feature, so that other kernels are compiled once. Their
settings are in `Options`.

run : (1,). Number of the run; None in linear covariance.
receiver : filter.receivers.receiver.Receiver. Receiver that computes its solution; in linear covariance the
    covariance that it reports.
open_loop : filter.policies.open_loop.OpenLoop. Open-loop correction.
mode_state : filter.policies.mode_logic.ModeState. Mode logic.
state_history : (n_place + 1, N_PAST). Stored states of delay compensation, see filter.policies.delay.
motion : filter.policies.imu_samples.ImuSampleWork. IMU samples as measurements, or reported.
solution_error : LastSolutionError. Reported error of the receiver's solution.
transition_errors : TransitionErrors. Error of the filter's transition.
units : ImuArrayWork. IMU array.
backup : filter.policies.backup.Backup. Backup strapdown, which is never corrected.
previous_epoch : filter.policies.epoch_differences.PreviousEpoch. Differences of two epochs.
previous_observables : (n_sat, n_observable). Observables of the epoch before, from which differences are formed.
sigma_points : filter.policies.unscented.SigmaPoints. Sigma points.
monitor : filter.policies.integrity.state.Monitor. Tests for faults.
iteration : filter.policies.iterated.IterationWork. Iterated update.
tape : simulation.tape.Tape. Record of one run.
"""


@jit
def _store_estimate_error(work, receiver, solution_error, filtering, point_model, point):
    """Set error (frame i) and formal covariance of the receiver's estimate, in the runs that have a solution.

    Parameters
    ----------
    work, receiver : Work, Receiver
    solution_error : LastSolutionError, updated in place
    filtering : settings of the receiver's filter; None for a point solution
    point_model : settings of a point solution
    point : (6,) m, m/s, true position and velocity of the solution, frame i
    """
    valid = receiver.solution[0] == receiver.solution[0]
    if filtering is None:
        _store_point_covariance(solution_error.covariance, receiver.inverse, point_model, valid)
    else:
        P = solution_error.covariance
        for i in range(N_RX):
            for j in range(N_RX):
                P[i, j] = where(valid, receiver.P[i, j], P[i, j])
    for i in range(N_FIX):
        state = RX_POS + i if i < 3 else RX_VEL + i - 3 if i < 6 else RX_BIAS + i - 6
        estimate = receiver.fix[i] if filtering is None else receiver.nav[state]
        true = number_like(estimate, point[i]) if i < 6 else work.clock[i - 6]
        error = true - estimate
        last_error = solution_error.error[state]
        solution_error.error[state] = where(valid, error, last_error)


@jit
def _store_error(run, work, optional_state, solver, report, epoch):
    """Store the error of the last solution and the innovations of the receiver (run number, or None)."""
    if run is not None:
        _store_estimate_error(
            work,
            optional_state.receiver,
            optional_state.solution_error,
            solver.filter,
            solver.point,
            report.point[epoch],
        )
        for i in range(report.n_channel):
            work.innovation[epoch, report.first_channel + i] = optional_state.receiver.innovation[i]


@jit
def _store_point_covariance(P, inverse, point_model, valid):
    """Set the covariance of a point solution, in the runs that have a solution.

    It is the inverse normal matrix times the variances of ranges and rates.

    Parameters
    ----------
    P : (N_RX, N_RX) SI squared, updated in place
    inverse : (4, 4) inverse normal matrix of position and clock
    point_model : variances of ranges (m^2) and rates (m^2/s^2)
    valid : condition by lane, whether there is a solution
    """
    range_variance = point_model.range_variance
    rate_variance = point_model.rate_variance
    for i in range(4):
        row = RX_POS + i if i < 3 else RX_BIAS
        rate_row = RX_VEL + i if i < 3 else RX_DRIFT
        for j in range(4):
            column = RX_POS + j if j < 3 else RX_BIAS
            rate_column = RX_VEL + j if j < 3 else RX_DRIFT
            dilution = inverse[i, j]
            by_range = range_variance * dilution
            by_rate = rate_variance * dilution
            P[row, column] = where(valid, by_range, P[row, column])
            P[rate_row, rate_column] = where(valid, by_rate, P[rate_row, rate_column])


@jit
def _store_covariance(joint, has_solution, epoch):
    """Store the error covariance of the last solution by source, and its mean (Joint, or None)."""
    if joint is not None and has_solution[epoch]:
        results = joint.results
        state = joint.state
        components = joint.components
        first = components.solution
        n = results.solution_mean.shape[0]
        for source in range(components.group.shape[0]):
            g = components.group[source]
            lane = components.lane[source]
            P = state.sources[g, ..., lane]
            for i in range(n):
                for j in range(n):
                    results.solution_covariance[source, i, j] = P[first + i, first + j]
        for i in range(n):
            results.solution_mean[i] = state.mean[first + i]


@jit
def hold_solution(work, optional_state, joint, has_solution, solver, report, epoch):
    """Store the error of the receiver's last solution at its time of validity.

    In a run: error, formal covariance and innovations of the receiver's filter. In linear covariance: error covariance
    by source, and mean error.

    Parameters
    ----------
    work, optional_state : arrays of the run and of its optional features
    joint : Joint, or None in a run
    has_solution : (n_epoch,) whether the receiver has a solution on the nominal flight; None in a run
    solver : Solver, or None in linear covariance
    report : ReportedSolution, or None if the errors of the solution are not reported
    epoch : index
    """
    if report is not None:
        _store_error(optional_state.run, work, optional_state, solver, report, epoch)
        _store_covariance(joint, has_solution, epoch)
