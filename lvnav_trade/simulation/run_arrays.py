"""Arrays of a run, or of eight runs in lanes: truth, filter, results, and those of the optional features of a case."""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.filter.policies.backup import new_backup
from lvnav_trade.filter.policies.delay import N_PAST
from lvnav_trade.filter.policies.epoch_differences import new_previous_epoch
from lvnav_trade.filter.policies.imu_samples import new_sample_work
from lvnav_trade.filter.policies.integrity.state import new_monitor
from lvnav_trade.filter.policies.iterated import new_iteration_work
from lvnav_trade.filter.policies.mode_logic import new_mode_state
from lvnav_trade.filter.policies.open_loop import new_open_loop
from lvnav_trade.filter.policies.unscented import new_sigma_points
from lvnav_trade.filter.receivers.receiver import N_STATE as N_RECEIVER
from lvnav_trade.filter.receivers.receiver import new_receiver
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.epoch.filter_case import OptionalState
from lvnav_trade.simulation.imu_array import new_units
from lvnav_trade.simulation.preparation.prepared_case import Prepared


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


def new_work(prepared: Prepared, lanes: bool) -> tuple[Work, OptionalState]:
    """Return the arrays of one run, or of eight in lanes, all zero. No array is empty: a lane view needs a length."""
    model, signals, layout = prepared.model, prepared.signals, prepared.layout
    n_lane = WIDTH if lanes else 0
    n = layout.n_state
    n_row = prepared.n_row
    n_hist = prepared.t_hist.size
    n_epoch = prepared.t_epoch.size
    n_out = len(prepared.outputs)
    shapes = {
        "run": (1,),
        "nav": (10,),
        "sums": (N_SUM,),
        "rates": (2, N_SUM),
        "previous": (6,),
        "increments": (_longest_window(prepared), 6),
        "P": (n, n),
        "X": (n, n),
        "D": (model.block_rows.size, 9),
        "x": (n,),
        "K": (n,),
        "H": (n_row, model.entry.shape[1]),
        "z": (n_row,),
        "antenna": (len(model.lever_arms), 21),
        "rate": (3,),
        "true_par": (max(1, len(prepared.unit.sigma)), 3),
        "true_tables": (2, processes.N_TABLE),
        "par": (max(1, len(layout.parameters)), 3),
        "tables": (2, processes.N_TABLE),
        "remainder": (6,),
        "clock": (2,),
        "clock_hat": (2,),
        "shared": (max(1, signals.shared.start.size),),
        "extra": (max(1, model.extra_offset.size),),
        "ranges": (signals.used.shape[1], model.n_kind),
        "solution": (6,),
        "err": (n_hist, n_out),
        "sigma": (n_hist, n_out),
        "nees": (n_hist,),
        "nis": (n_epoch,),
        "n_row": (n_epoch,),
        "n_reject": (n_epoch,),
        "innovation": (n_epoch, len(prepared.channel_names)),
        "failed": (1,),
        "t_failed": (1,),
        "reported": (6, 6),
        "observed": (max(1, len(prepared.devices)), 4),
    }
    arrays = zeros_of(shapes, n_lane)
    arrays["run"] = arrays["run"].view(np.uint64)
    parts = _reporting_arrays(prepared, n_lane) | _truth_arrays(prepared, n_lane) | _filter_arrays(prepared, n_lane)
    return Work(**arrays), OptionalState(run=arrays["run"], **parts)


def _longest_window(prepared: Prepared) -> int:
    """Return the largest number of ticks of a window."""
    return int(prepared.schedule.n_tick.max(initial=0))


def _reporting_arrays(prepared: Prepared, n_lane: int) -> dict[str, Any]:
    """Return the arrays of optional results, by field of `OptionalState`; `n_lane` is 0 for one run."""
    options = prepared.options
    arrays: dict[str, Any] = {}
    if options.report is not None:
        shapes = {"error": (N_RECEIVER,), "covariance": (N_RECEIVER, N_RECEIVER)}
        arrays["solution_error"] = LastSolutionError(**zeros_of(shapes, n_lane))
    if options.misses is not None:
        shape = (prepared.t_hist.size, prepared.layout.n_state)
        arrays["transition_errors"] = TransitionErrors(**zeros_of({"error": shape, "missed": shape}, n_lane))
    return arrays


def _truth_arrays(prepared: Prepared, n_lane: int) -> dict[str, Any]:
    """Return the arrays of optional sensors and of a receiver that computes its solution, as `_reporting_arrays`."""
    options = prepared.options
    arrays: dict[str, Any] = {}
    if options.solver is not None:
        arrays["receiver"] = new_receiver(n_lane, len(prepared.sky.names))
    if options.units is not None:
        arrays["units"] = new_units(options.units, _longest_window(prepared), n_lane)
    if options.delayed is not None:
        shapes = {"observables": (len(prepared.sky.names), prepared.model.n_kind)}
        arrays["previous_observables"] = zeros_of(shapes, n_lane)["observables"]
    return arrays


def _filter_arrays(prepared: Prepared, n_lane: int) -> dict[str, Any]:
    """Return the arrays of the optional features of the filter, as `_reporting_arrays`."""
    options, model = prepared.options, prepared.model
    n = prepared.layout.n_state
    n_par = len(prepared.layout.parameters)
    n_extra = model.extra_offset.size
    n_epoch = prepared.t_epoch.size
    n_channel = prepared.channels.n_receiver
    n_row = prepared.n_row
    arrays: dict[str, Any] = {}
    if prepared.scenario.filter.feedback == "open":
        arrays["open_loop"] = new_open_loop(n, n_par, n_extra, n_lane)
    if options.late is not None:
        shapes = {"states": (options.late.buffered.size + 1, N_PAST)}
        arrays["state_history"] = zeros_of(shapes, n_lane)["states"]
    if options.rules is not None:
        arrays["mode_state"] = new_mode_state(n_epoch, n_channel, n_row, n_lane, n)
    if options.integrity is not None:
        arrays["monitor"] = new_monitor(n_epoch, n_channel, n_row, options.integrity.window, n_lane)
    if options.vehicle is not None or options.samples is not None:
        n_entry = 0 if options.vehicle is None else options.vehicle.columns.shape[1]
        arrays["motion"] = new_sample_work(n, n_entry, n_lane)
    if options.delayed is not None:
        arrays["previous_epoch"] = new_previous_epoch(options.delayed, len(model.lever_arms), n_extra, n, n_lane)
    if options.backup is not None:
        arrays["backup"] = new_backup(n, n_lane)
    if options.unscented is not None:
        arrays["sigma_points"] = new_sigma_points(n, n_par, _longest_window(prepared), n_row, n_lane)
    if options.iterated is not None:
        arrays["iteration"] = new_iteration_work(n, n_extra, n_lane)
    return arrays
