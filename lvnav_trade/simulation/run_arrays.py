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
from lvnav_trade.simulation.preparation.prepared_case import PreparedCase


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
    transition_error : (n_hist, n_state). True error minus that propagated by the transition from the previous history
        time.
    """

    error: Floats
    transition_error: Floats


Work = namedtuple(
    "Work",
    "run nav sums rates previous increments P X D x K H z antenna rate true_par true_tables par tables remainder clock "
    "clock_hat correlated_errors extra ranges solution err sigma nees nis n_row n_reject innovation failed t_failed "
    "reported_covariance sensor_measurements",
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
correlated_errors : (n_component,). True correlated measurement errors.
extra : (n_extra,). Estimated extra states.
ranges : (n_slot, n_observable). Measured observables of the satellites.
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
reported_covariance : (6, 6). Covariance reported with the solution.
sensor_measurements : (n_sensor, 4). Measurements of the other sensors.
"""


def new_work(prepared_case: PreparedCase, uses_lanes: bool) -> tuple[Work, OptionalState]:
    """Return the arrays of one run, or of eight in lanes, all zero. No array is empty: a lane view needs a length."""
    model, signals, layout = prepared_case.model, prepared_case.signals, prepared_case.layout
    n_lane = WIDTH if uses_lanes else 0
    n = layout.n_state
    n_row = prepared_case.n_row
    n_hist = prepared_case.t_hist.size
    n_epoch = prepared_case.t_epoch.size
    n_out = len(prepared_case.outputs)
    shapes = {
        "run": (1,),
        "nav": (10,),
        "sums": (N_SUM,),
        "rates": (2, N_SUM),
        "previous": (6,),
        "increments": (_longest_window(prepared_case), 6),
        "P": (n, n),
        "X": (n, n),
        "D": (model.block_rows.size, 9),
        "x": (n,),
        "K": (n,),
        "H": (n_row, model.entry.shape[1]),
        "z": (n_row,),
        "antenna": (len(model.lever_arms), 21),
        "rate": (3,),
        "true_par": (max(1, len(prepared_case.unit.sigma)), 3),
        "true_tables": (2, processes.N_TABLE),
        "par": (max(1, len(layout.parameters)), 3),
        "tables": (2, processes.N_TABLE),
        "remainder": (6,),
        "clock": (2,),
        "clock_hat": (2,),
        "correlated_errors": (max(1, signals.correlated_errors.initial_sigma.size),),
        "extra": (max(1, model.extra_offset.size),),
        "ranges": (signals.satellite_by_slot.shape[1], model.n_observable),
        "solution": (6,),
        "err": (n_hist, n_out),
        "sigma": (n_hist, n_out),
        "nees": (n_hist,),
        "nis": (n_epoch,),
        "n_row": (n_epoch,),
        "n_reject": (n_epoch,),
        "innovation": (n_epoch, len(prepared_case.channel_names)),
        "failed": (1,),
        "t_failed": (1,),
        "reported_covariance": (6, 6),
        "sensor_measurements": (max(1, len(prepared_case.devices)), 4),
    }
    arrays = zeros_of(shapes, n_lane)
    arrays["run"] = arrays["run"].view(np.uint64)
    optional_arrays = (
        _reporting_arrays(prepared_case, n_lane)
        | _truth_arrays(prepared_case, n_lane)
        | _filter_arrays(prepared_case, n_lane)
    )
    return Work(**arrays), OptionalState(run=arrays["run"], **optional_arrays)


def _longest_window(prepared_case: PreparedCase) -> int:
    """Return the largest number of ticks of a window."""
    return int(prepared_case.schedule.n_tick.max(initial=0))


def _reporting_arrays(prepared_case: PreparedCase, n_lane: int) -> dict[str, Any]:
    """Return the arrays of optional results, by field of `OptionalState`; `n_lane` is 0 for one run."""
    options = prepared_case.options
    arrays: dict[str, Any] = {}
    if options.reported_solution is not None:
        shapes = {"error": (N_RECEIVER,), "covariance": (N_RECEIVER, N_RECEIVER)}
        arrays["solution_error"] = LastSolutionError(**zeros_of(shapes, n_lane))
    if options.has_transition_errors is not None:
        shape = (prepared_case.t_hist.size, prepared_case.layout.n_state)
        arrays["transition_errors"] = TransitionErrors(**zeros_of({"error": shape, "transition_error": shape}, n_lane))
    return arrays


def _truth_arrays(prepared_case: PreparedCase, n_lane: int) -> dict[str, Any]:
    """Return the arrays of optional sensors and of a receiver that computes its solution, as `_reporting_arrays`."""
    options = prepared_case.options
    arrays: dict[str, Any] = {}
    if options.solver is not None:
        arrays["receiver"] = new_receiver(n_lane, len(prepared_case.sky.names))
    if options.imu_array is not None:
        arrays["units"] = new_units(options.imu_array, _longest_window(prepared_case), n_lane)
    if options.differences is not None:
        shapes = {"observables": (len(prepared_case.sky.names), prepared_case.model.n_observable)}
        arrays["previous_observables"] = zeros_of(shapes, n_lane)["observables"]
    return arrays


def _filter_arrays(prepared_case: PreparedCase, n_lane: int) -> dict[str, Any]:
    """Return the arrays of the optional features of the filter, as `_reporting_arrays`."""
    options, model = prepared_case.options, prepared_case.model
    n = prepared_case.layout.n_state
    n_par = len(prepared_case.layout.parameters)
    n_extra = model.extra_offset.size
    n_epoch = prepared_case.t_epoch.size
    n_channel = prepared_case.channels.n_receiver
    n_row = prepared_case.n_row
    arrays: dict[str, Any] = {}
    if prepared_case.scenario.filter.feedback == "open":
        arrays["open_loop"] = new_open_loop(n, n_par, n_extra, n_lane)
    if options.delay_processing is not None:
        shapes = {"states": (options.delay_processing.is_buffered.size + 1, N_PAST)}
        arrays["state_history"] = zeros_of(shapes, n_lane)["states"]
    if options.rules is not None:
        arrays["mode_state"] = new_mode_state(n_epoch, n_channel, n_row, n_lane, n)
    if options.fault_tests is not None:
        arrays["monitor"] = new_monitor(n_epoch, n_channel, n_row, options.fault_tests.window, n_lane)
    if options.vehicle is not None or options.reported_samples is not None:
        n_entry = 0 if options.vehicle is None else options.vehicle.columns.shape[1]
        arrays["motion"] = new_sample_work(n, n_entry, n_lane)
    if options.differences is not None:
        arrays["previous_epoch"] = new_previous_epoch(options.differences, len(model.lever_arms), n_extra, n, n_lane)
    if options.backup is not None:
        arrays["backup"] = new_backup(n, n_lane)
    if options.has_sigma_points is not None:
        arrays["sigma_points"] = new_sigma_points(n, n_par, _longest_window(prepared_case), n_row, n_lane)
    if options.iteration_settings is not None:
        arrays["iteration"] = new_iteration_work(n, n_extra, n_lane)
    return arrays
