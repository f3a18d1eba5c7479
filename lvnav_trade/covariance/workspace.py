"""Work arrays and results of the forward pass of linear covariance, and its record for the backward pass."""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.components import Components, initial_state
from lvnav_trade.covariance.difference_errors import N_ENTRIES
from lvnav_trade.covariance.receiver_error import N_SOLUTION_ENTRY
from lvnav_trade.covariance.slots import arrange_lanes
from lvnav_trade.covariance.sources import n_joint
from lvnav_trade.filter.policies.epoch_differences import PreviousEpoch, new_previous_epoch
from lvnav_trade.filter.receivers.receiver import N_STATE
from lvnav_trade.kernels.lanes import grouped_zeros, zeros_of
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.simulation.epoch.joint import Joint, NominalFlight
from lvnav_trade.simulation.preparation.prepare import PreparedCase


class JointCovariance(NamedTuple):
    """True covariance of the joint vector in a pass, updated in place.

    The N joint states are the estimation error (n), the error of the receiver's solution, and clones.

    mean : (N,). Mean of the joint states.
    sources : (n_group, N, N, n_lane). Covariance by source, one lane each.
    cross : (n_group, n_slot, N, n_lane). Covariance of the joint states with each error component.
    variance : (n_group, n_slot, 1, n_lane). Variance of each error component.
    profile : (n_profile, 3). Present value of the deterministic biases.
    """

    mean: Floats
    sources: Floats
    cross: Floats
    variance: Floats
    profile: Floats


class UpdateTape(NamedTuple):
    """Record of the forward pass for the backward pass; empty if no backward pass is requested.

    sums : (n_window, 18). Strapdown integrals over each window.
    position : (n_window, 3) m. Position in frame i at which the gravity gradient is evaluated.
    gain : (n_update, N). Gain of each scalar update, in order of processing.
    h : (n_update, n_entry). Jacobian row of each update.
    epoch : (n_update,). Epoch of each update.
    channel : (n_update,). Channel of each update.
    first : (n_window + 1,). Number of updates before those at the end of each window.
    n_recorded : (1,). Number of updates recorded so far.
    sample_gain : (n_tick, 6, N). Gain of IMU samples processed as measurements, tick by tick.
    """

    sums: Floats
    position: Floats
    gain: Floats
    h: Floats
    epoch: Ints
    channel: Ints
    first: Ints
    n_recorded: Ints
    sample_gain: Floats


class NominalReport(NamedTuple):
    """Covariance (6, 6) that the receiver reports with its solution on the nominal flight, frame i."""

    covariance: Floats


class HistoryRotations(NamedTuple):
    """Rotations (n_hist, 3, 3) at the history times from frame i: to body axes (attitude), to the reporting axes."""

    attitude: Floats
    axes: Floats


class PassResults(NamedTuple):
    """Results of the forward pass at the history times and epochs, SI.

    formal : (n_hist, n, n). The filter's own covariance, frame i.
    true : (n_hist, n, n). Covariance of the true estimation error about its mean, frame i.
    mean : (n_hist, n). Mean of the true estimation error, frame i.
    budget : (n_hist, n_source, n). Variance of the true error by source, reporting axes.
    samples : (n_hist, n_source, 12). Error variance of the raw IMU sample (6) and of the corrected sample (6), by
        source.
    receiver : (n_hist, n_source, 11, 11). Error covariance of the receiver's last solution, frame i, by source.
    receiver_mean : (n_hist, 11). Mean error of the receiver's last solution, frame i.
    solution_covariance : (n_source, 11, 11). Error covariance of the receiver's present solution, until the next epoch.
    solution_mean : (11,). Mean error of the receiver's present solution.
    n_row : (n_epoch,). Number of scalar measurements processed.
    expected_nis : (n_epoch,). Expected sum of squared normalised innovations.
    expected_row_nis : (n_epoch, n_row). Expected square of each normalised innovation; 0 of rows that are not
        processed.
    """

    formal: Floats
    true: Floats
    mean: Floats
    budget: Floats
    samples: Floats
    receiver: Floats
    receiver_mean: Floats
    solution_covariance: Floats
    solution_mean: Floats
    n_row: Floats
    expected_nis: Floats
    expected_row_nis: Floats


Nominal = namedtuple(
    "Nominal",
    "nav sums rates filter_sums previous increments antenna rate H z ranges solution sensor_measurements clock_hat par "
    "x extra reported_covariance P K innovation nis n_row n_reject",
)
"""Work arrays of the nominal run, by the names that the filter's kernels read.

nav : (10,). Navigation state: attitude quaternion, velocity, position, frame i.
sums : (18,). Strapdown integrals over the window.
rates : (2, 18). Rates of these integrals at which the transition is linearised, and their means over the last window.
filter_sums : (18,). Strapdown integrals that the filter linearises with.
previous : (6,) rad, m/s. Increments before the window.
increments : (n_tick, 6) rad, m/s. Increments of the window.
antenna : (n_antenna, 21). Antenna states, as in `line_of_sight.antenna`.
rate : (3,) rad/s. Body rate.
H : (n_row, n_entry). Jacobian rows of the epoch.
z : (n_row,). Measured minus predicted.
ranges : (n_slot, n_observable). Observables of the satellites.
solution : (6,) m, m/s. Receiver's solution.
sensor_measurements : (n_sensor, 4). Measurements of the other sensors.
clock_hat : (2,) m, m/s. Estimated clock bias and drift.
par : (n_par, 3). Estimated IMU parameters.
x : (n_state,). Error state, which stays zero.
extra : (n_extra,). Estimated extra states.
reported_covariance : (6, 6). Covariance reported with the solution.
P : (n_state, n_state). Covariance of the filter.
K : (n_state,). P h' of a scalar measurement.
innovation : (n_epoch, n_channel). Normalised innovations of the nominal flight, as those of a run.
nis : (n_epoch,). Sum of their squares.
n_row : (n_epoch,). Number of accepted scalar measurements.
n_reject : (n_epoch,). Number of rejected scalar measurements: of those that a test excludes.
"""

Scratch = namedtuple(
    "Scratch",
    "D D_true block input mean_input state_effect gain deviation receiver y b measurement_covariance noise "
    "innovation_variance budget",
)
"""Work arrays of the forward pass; lanes are the sources of a group.

D : (n_block, 9). Blocks of the filter's transition.
D_true : (n_nav, 9). Blocks of the true transition.
block : (9,). One 3 x 3 block.
input : (9, 3). Effect of the components of a block on attitude, velocity and position.
mean_input : (2, 3). Mean inputs of a triad over the window: of the sensor itself, of the other sensor.
state_effect : (N,). Effect of one error on the joint states.
gain : (N,). Gain of a scalar measurement on the joint states.
deviation : (12,). Deterministic strapdown error over the window.
receiver : (N,). Scratch of the propagation of the receiver's error.
y : (N,) in lanes. P h' of a source.
b : (n_group, n_slot, 9) in lanes. Effect of each component on attitude, velocity and position.
measurement_covariance : (n_group, n_slot, 1) in lanes. Covariance of each component with the measurement.
noise : (n_group, 1, 1) in lanes. Measurement noise by source.
innovation_variance : (1,) in lanes. Innovation variance by source.
budget : (n_group, n_state, 1) in lanes. Variance of each state by source, reporting axes.
"""

SampleScratch = namedtuple(
    "SampleScratch",
    "gain innovation_mean deviation innovation_square sequence_matrix covariance_change Y S noise a "
    "innovation_covariance state_effect",
)
"""Work arrays of the joint covariance where IMU samples are measurements; lanes are the sources of a group.

gain : (6, n). Gain of the sample on the joint states.
innovation_mean : (6,). Mean innovation.
deviation : (6,) rad/s, m/s^2. Deterministic error of the sample.
innovation_square : (6, 6). Expected square of the innovation.
sequence_matrix : (6, 6). Matrix from the sample's innovation to the innovations of its scalars in succession.
covariance_change : (9, n) in lanes. Scratch of the propagation of a source's covariance.
Y : (6, n) in lanes. P H' of a source.
S : (n_group, 6, 6) in lanes. Innovation covariance by source.
noise : (n_group, 6) in lanes. Variance of the sample's noise by source.
a : (n_group, n_slot, 6) in lanes. Derivative of the sample with respect to each component.
innovation_covariance : (6,) in lanes. Covariance of a component with the innovation.
state_effect : (n,) in lanes. Effect of a component on the joint states by the gain.
"""

BackwardScratch = namedtuple("BackwardScratch", "D y input mean_input block sums h b a")
"""Work arrays of the backward pass; lanes are the sources of a group.

D : (n_nav, 9). Blocks of the true transition.
y : (max(N, 6),). Gains times the adjoint.
input : (9, 3). Effect of the components of a block on attitude, velocity and position.
mean_input : (2, 3). Mean inputs of a triad over the window: of the sensor itself, of the other sensor.
block : (9,). One 3 x 3 block.
sums : (18,). Integrals over a tick: attitude matrix, velocity gained.
h : (6, n_entry). Jacobian of an IMU sample.
b : (n_group, n_slot, 9) in lanes. Effect of each component on attitude, velocity and position.
a : (n_group, n_slot, 6) in lanes. Derivative of an IMU sample with respect to each component.
"""


def _record(record_type: Any, array_shapes: dict[str, tuple[int, ...]], lane_shapes: dict[str, tuple[int, ...]]) -> Any:
    """Return a record of zeros: arrays of given shapes, and arrays with the lanes of a group as an additional axis."""
    arrays = {name: np.zeros(shape) for name, shape in array_shapes.items()}
    return record_type(**arrays, **{name: grouped_zeros(shape) for name, shape in lane_shapes.items()})


def row_width(prepared_case: PreparedCase) -> int:
    """Return the number of entries of a Jacobian row, receiver-error states included."""
    if prepared_case.options.differences is not None:
        return prepared_case.model.entry.shape[1] + N_ENTRIES
    return prepared_case.model.entry.shape[1] + (0 if prepared_case.chain is None else N_SOLUTION_ENTRY)


def new_nominal(prepared_case: PreparedCase) -> Nominal:
    """Return the work arrays of the nominal run, zero except for the initial covariance."""
    model, signals = prepared_case.model, prepared_case.signals
    n, n_epoch = prepared_case.layout.n_state, prepared_case.t_epoch.size
    nominal = Nominal(
        **zeros_of(
            {
                "nav": (10,),
                "sums": (N_SUM,),
                "rates": (2, N_SUM),
                "filter_sums": (N_SUM,),
                "previous": (6,),
                "increments": (int(prepared_case.schedule.n_tick.max()), 6),
                "antenna": (len(model.lever_arms), 21),
                "rate": (3,),
                "H": (prepared_case.n_row, row_width(prepared_case)),
                "z": (prepared_case.n_row,),
                "ranges": (signals.satellite_by_slot.shape[1], model.n_observable),
                "solution": (6,),
                "sensor_measurements": (max(1, len(prepared_case.devices)), 4),
                "clock_hat": (2,),
                "par": (max(1, len(prepared_case.layout.parameters)), 3),
                "x": (n,),
                "extra": (max(1, model.extra_offset.size),),
                "reported_covariance": (6, 6),
                "P": (n, n),
                "K": (n,),
                "innovation": (n_epoch, prepared_case.channels.n_channel),
                "nis": (n_epoch,),
                "n_row": (n_epoch,),
                "n_reject": (n_epoch,),
            }
        )
    )
    nominal.P[:] = prepared_case.initial_state.P
    if prepared_case.options.differences is not None:  # error of the measurement minus that of the previous epoch
        nominal.H[:, -N_ENTRIES:] = 1.0, -1.0
    return nominal


def new_nominal_previous_epoch(prepared_case: PreparedCase) -> PreviousEpoch | None:
    """Return the arrays for the previous epoch of the nominal run; None without differences of two epochs."""
    differences, model = prepared_case.options.differences, prepared_case.model
    if differences is None:
        return None
    return new_previous_epoch(differences, len(model.lever_arms), model.extra_offset.size, model.n_state)


def _new_covariance(prepared_case: PreparedCase, components: Components) -> JointCovariance:
    """Return the joint covariance at the start of the flight."""
    mean, vehicle = np.zeros(n_joint(prepared_case)), prepared_case.options.vehicle
    if vehicle is not None:  # the estimated motion starts at zero
        mean[vehicle.motion : vehicle.motion + 6] = *vehicle.rate[0], *vehicle.force[0]
    profile = np.zeros((prepared_case.unit.profile_sensor.size, 3))
    return JointCovariance(mean, *initial_state(prepared_case, components), profile)


def new_scratch(prepared_case: PreparedCase, components: Components) -> Scratch:
    """Return the work arrays of the forward pass, zero."""
    n, n_state, (n_group, n_slot) = n_joint(prepared_case), prepared_case.layout.n_state, components.has_cross.shape
    return _record(
        Scratch,
        {
            "D": (prepared_case.model.block_rows.size, 9),
            "D_true": (components.nav_rows.size, 9),
            "block": (9,),
            "input": (9, 3),
            "mean_input": (2, 3),
            "state_effect": (n,),
            "gain": (n,),
            "deviation": (12,),
            "receiver": (n,),
        },
        {
            "y": (n,),
            "b": (n_group, n_slot, 9),
            "measurement_covariance": (n_group, n_slot, 1),
            "noise": (n_group, 1, 1),
            "innovation_variance": (1,),
            "budget": (n_group, n_state, 1),
        },
    )


def new_sample_scratch(prepared_case: PreparedCase, components: Components) -> SampleScratch | None:
    """Return the work arrays for IMU samples as measurements; None without."""
    if prepared_case.options.vehicle is None:
        return None
    n, (n_group, n_slot), six = n_joint(prepared_case), components.has_cross.shape, N_SAMPLE
    scratch: SampleScratch = _record(
        SampleScratch,
        {
            "gain": (six, n),
            "innovation_mean": (six,),
            "deviation": (six,),
            "innovation_square": (six, six),
            "sequence_matrix": (six, six),
        },
        {
            "covariance_change": (9, n),
            "Y": (six, n),
            "S": (n_group, six, six),
            "noise": (n_group, six),
            "a": (n_group, n_slot, six),
            "innovation_covariance": (six,),
            "state_effect": (n,),
        },
    )
    scratch.noise[:] = arrange_lanes(components.sample_noise, components.group, components.lane)
    return scratch


def new_joint(prepared_case: PreparedCase, components: Components, tape: UpdateTape) -> Joint:
    """Return the joint covariance at the start of the flight, with empty results and tape."""
    results = new_results(prepared_case, components.group.size)
    return Joint(
        _new_covariance(prepared_case, components), new_scratch(prepared_case, components), tape, results, components
    )


def new_flight(prepared_case: PreparedCase, components: Components) -> NominalFlight:
    """Return the nominal flight of a pass."""
    ticks = new_sample_scratch(prepared_case, components)
    return NominalFlight(prepared_case.unit, prepared_case.reference, prepared_case.chain, ticks)


def new_backward_scratch(prepared_case: PreparedCase, components: Components) -> BackwardScratch:
    """Return the work arrays of the backward pass, zero."""
    vehicle = prepared_case.options.vehicle
    n_entry = 1 if vehicle is None else vehicle.columns.shape[1]
    array_shapes = {
        "D": (components.nav_rows.size, 9),
        "y": (max(n_joint(prepared_case), N_SAMPLE),),
        "input": (9, 3),
        "mean_input": (2, 3),
        "block": (9,),
        "sums": (N_SUM,),
        "h": (N_SAMPLE, n_entry),
    }
    lane_shapes = {"b": (*components.has_cross.shape, 9), "a": (*components.has_cross.shape, N_SAMPLE)}
    return _record(BackwardScratch, array_shapes, lane_shapes)


def new_results(prepared_case: PreparedCase, n_source: int) -> PassResults:
    """Return the results of a forward pass, zero."""
    options = prepared_case.options
    n, n_hist, n_epoch = prepared_case.layout.n_state, prepared_case.t_hist.size, prepared_case.t_epoch.size
    n_sampled = 0 if options.reported_samples is None else n_hist
    n_reported = 0 if options.reported_solution is None else n_hist
    return PassResults(
        **zeros_of(
            {
                "formal": (n_hist, n, n),
                "true": (n_hist, n, n),
                "mean": (n_hist, n),
                "budget": (n_hist, n_source, n),
                "samples": (n_sampled, n_source, 2 * N_SAMPLE),
                "receiver": (n_reported, n_source, N_STATE, N_STATE),
                "receiver_mean": (n_reported, N_STATE),
                "solution_covariance": (n_source, N_STATE, N_STATE),
                "solution_mean": (N_STATE,),
                "n_row": (n_epoch,),
                "expected_nis": (n_epoch,),
                "expected_row_nis": (n_epoch, prepared_case.n_row),
            }
        )
    )


def new_tape(n_window: int, n_update: int, n: int, n_entry: int, n_tick: int = 0) -> UpdateTape:
    """Return an empty tape of n joint states; n_update 0 records nothing.

    Parameters
    ----------
    n_window, n_update, n_tick
        Number of windows, of scalar updates, and of ticks whose samples are updates.
    n
        Number of joint states.
    n_entry
        Number of entries of a Jacobian row.
    """
    windows = n_window if n_update else 0
    return UpdateTape(
        np.zeros((windows, N_SUM)),
        np.zeros((windows, 3)),
        np.zeros((n_update, n)),
        np.zeros((n_update, n_entry)),
        np.zeros(n_update, dtype=np.int64),
        np.zeros(n_update, dtype=np.int64),
        np.zeros(windows + 1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
        np.zeros((n_tick, N_SAMPLE, n)),
    )
