"""What an epoch reads of a case, the arrays of its optional features, and the receiver's last solution."""

from collections import namedtuple
from typing import Any, NamedTuple

from lvnav_trade.filter.receivers.receiver import BIAS as RX_BIAS
from lvnav_trade.filter.receivers.receiver import DRIFT as RX_DRIFT
from lvnav_trade.filter.receivers.receiver import N_FIX
from lvnav_trade.filter.receivers.receiver import N_STATE as N_RX
from lvnav_trade.filter.receivers.receiver import POS as RX_POS
from lvnav_trade.filter.receivers.receiver import VEL as RX_VEL
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.simulation.preparation.prepare import Prepared


class FilterCase(NamedTuple):
    """Inputs of the filter of a case, the same in every run. Optional fields are None if the case lacks the feature.

    Functions of an epoch pass it on as a whole. Functions at the lowest level take single fields, so that one compiled
    version serves many cases; an optional field is an argument of its own, so that the compiler drops `if ... is None`.

    schedule : Schedule. Windows of IMU ticks.
    signals : Signals. Satellites and receiver at the epochs.
    sensors : Sensors. The other sensors.
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


def case_of(prepared: Prepared, **changed: Any) -> FilterCase:
    """Return the filter inputs of a prepared case, with some fields replaced."""
    tick = prepared.unit.dt
    case = FilterCase(
        prepared.schedule,
        prepared.signals,
        prepared.sensors,
        prepared.model,
        prepared.options,
        tick,
        tick * prepared.model.strapdown.subsamples,
    )
    return case._replace(**changed)


Parts = namedtuple(
    "Parts",
    "run rx open_loop watch past motion held missed units backup earlier last points monitor again tape",
    defaults=(None, None, None, None, None, None, None, None, None, None, None, None, None, None, None, None),
)
"""Arrays of the optional features of a case; None without the feature, so that other kernels are compiled once.

run : (1,). Number of the run; None in linear covariance.
rx : filter.receivers.receiver.Receiver. Receiver that computes its solution; in linear covariance the covariance that
it reports.
open_loop : filter.policies.open_loop.OpenLoop. Open-loop correction.
watch : filter.policies.mode_logic.ModeState. Mode logic.
past : (n_place + 1, N_PAST). Stored states of delay compensation, see filter.policies.delay.
motion : filter.policies.imu_samples.ImuSampleWork. IMU samples as measurements, or reported.
held : Held. Reported error of the receiver's solution.
missed : Misses. Error of the filter's transition.
units : UnitWork. IMU array.
backup : filter.policies.backup.Backup. Backup strapdown, which is never corrected.
earlier : filter.policies.epoch_differences.PreviousEpoch. Differences of two epochs.
last : (n_sat, n_kind). Observables of the epoch before, from which differences are formed.
points : filter.policies.unscented.SigmaPoints. Sigma points.
monitor : filter.policies.integrity.state.Monitor. Tests for faults.
again : filter.policies.iterated.IterationWork. Iterated update.
tape : simulation.tape.Tape. Record of one run.
"""


@jit
def _store_estimate_error(work, rx, held, filtering, point_model, point):
    """Set error (frame i) and formal covariance of the receiver's estimate, in the runs that have a solution."""
    valid = rx.solution[0] == rx.solution[0]
    if filtering is None:
        for i in range(4):
            a, b = RX_POS + i if i < 3 else RX_BIAS, RX_VEL + i if i < 3 else RX_DRIFT
            for j in range(4):
                c, d = RX_POS + j if j < 3 else RX_BIAS, RX_VEL + j if j < 3 else RX_DRIFT
                inverse = rx.inverse[i, j]
                held.covariance[a, c] = where(valid, point_model.range_variance * inverse, held.covariance[a, c])
                held.covariance[b, d] = where(valid, point_model.rate_variance * inverse, held.covariance[b, d])
    else:
        for i in range(N_RX):
            for j in range(N_RX):
                held.covariance[i, j] = where(valid, rx.P[i, j], held.covariance[i, j])
    for i in range(N_FIX):
        at = RX_POS + i if i < 3 else RX_VEL + i - 3 if i < 6 else RX_BIAS + i - 6
        estimate = rx.fix[i] if filtering is None else rx.nav[at]
        true = like(estimate, point[i]) if i < 6 else work.clock[i - 6]
        held.error[at] = where(valid, true - estimate, held.error[at])


@jit
def _store_error(run, work, parts, solver, report, epoch):
    """Store the error of the last solution and the innovations of the receiver (run number, or None)."""
    if run is not None:
        _store_estimate_error(work, parts.rx, parts.held, solver.filter, solver.point, report.point[epoch])
        for i in range(report.n_channel):
            work.innovation[epoch, report.first_channel + i] = parts.rx.innovation[i]


@jit
def _store_covariance(joint, solved, epoch):
    """Store the error covariance of the last solution by source, and its mean (Joint, or None)."""
    if joint is not None and solved[epoch]:
        out, state, true = joint.out, joint.state, joint.true
        at, n = true.solution, out.held_mean.shape[0]
        for source in range(true.group.shape[0]):
            P = state.sources[true.group[source], ..., true.lane[source]]
            for i in range(n):
                for j in range(n):
                    out.held[source, i, j] = P[at + i, at + j]
        for i in range(n):
            out.held_mean[i] = state.mean[at + i]


@jit
def hold_solution(work, parts, joint, solved, solver, report, epoch):
    """Store the error of the receiver's last solution at its time of validity.

    In a run: error, formal covariance and innovations of the receiver's filter. In linear covariance: error covariance
    by source, and mean error.

    Parameters
    ----------
    work, parts : arrays of the run and of its optional features
    joint : Joint, or None in a run
    solved : (n_epoch,) whether the receiver has a solution on the nominal flight; None in a run
    solver : Solver, or None in linear covariance
    report : ReportedSolution, or None if the errors of the solution are not reported
    epoch : index
    """
    if report is not None:
        _store_error(parts.run, work, parts, solver, report, epoch)
        _store_covariance(joint, solved, epoch)
