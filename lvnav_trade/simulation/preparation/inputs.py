"""Inputs of a flight as arrays for the kernels: schedule, IMU, signals, start, history, optional features."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.records import Bools, Floats, Ints


class Schedule(NamedTuple):
    """Windows of IMU ticks, over which the covariance is propagated at once; each array has shape (n_window,).

    first_tick : First tick.
    n_tick : Number of ticks.
    length_index : Index of the window's length in `FilterModel.seconds`.
    epoch : Epoch at the end, -1 none.
    hist : History time at the end, -1 none.
    injection : Index in `FilterModel.injected_variance` of the variance added at the end, -1 none.
    linearisation : Code of the linearisation, see `kernels.transition.linearise`.
    """

    first_tick: Ints
    n_tick: Ints
    length_index: Ints
    epoch: Ints
    hist: Ints
    injection: Ints
    linearisation: Ints


class CorrelatedErrors(NamedTuple):
    """Correlated measurement errors: random errors that last, or that several measurements share.

    A family is one physical cause; its components are Gauss-Markov processes or constants.

    member : (n_family, n_channel). Component of the family that enters the channel, -1 none.
    partial : (n_family, n_epoch, n_channel). Derivative of the measurement with respect to that component.
    initial_sigma : (n_component,) SI. Initial sigma.
    decay : (n_component,). Decay factor over an interval of epochs.
    walk : (n_component,) SI. Sigma of the noise added over an interval of epochs.
    source_keys : (n_component,). Key of the random draws, by cause.
    satellite_keys : (n_component,). Key of the satellite or label; 0 for an error of the receiver.
    extra : (n_component,). Number of the filter's first extra state that models the component, -1 none.
    error_of : (n_pair,). Components that extra states of the filter model.
    state_of : (n_pair,). Number of the extra state, for each of these.
    is_recorded : (n_component,). Whether the component is read from a recording and not drawn.
    """

    member: Ints
    partial: Floats
    initial_sigma: Floats
    decay: Floats
    walk: Floats
    source_keys: NDArray[np.uint64]
    satellite_keys: NDArray[np.uint64]
    extra: Ints
    error_of: Ints
    state_of: Ints
    is_recorded: Bools


class Signals(NamedTuple):
    """Satellites and receiver at the epochs: true measurements, true noise, and the noise that the filter assumes.

    A channel is an observable of one satellite (tight coupling: pseudorange, range rate and further observables in
    turn) or an axis of the receiver's solution (loose coupling). Channels of the other sensors follow.

    satellite_by_slot : (n_epoch, n_slot). Satellite of each slot, -1 none.
    n_used : (n_epoch,). Number of satellites in use.
    satellite_keys : (n_sat,). Keys of the satellites for random draws.
    range : (n_epoch, n_sat) m. Pseudorange without clock and random errors, minus the corrections of the filter.
    rate : (n_epoch, n_sat) m/s. Range rate, likewise.
    position : (n_epoch, 3) m. Receiver's solution without random errors, frame i.
    velocity : (n_epoch, 3) m/s. Receiver's solution without random errors, frame i.
    satellite_position : (n_epoch, n_sat, 3) m. Satellite position that the filter uses, frame i.
    satellite_velocity : (n_epoch, n_sat, 3) m/s. Satellite velocity that the filter uses, frame i.
    antenna : (n_epoch, n_sat). Antenna that receives the satellite.
    sigma : (n_epoch, n_measured) SI. True sigma of white noise, by measured channel of receiver and sensors.
    variance : (n_epoch, n_channel) SI squared. Noise variance in the filter model, with the factor of its tuning.
    scale : (n_epoch, n_channel). Square root of that factor.
    beta : (n_epoch, n_channel). Underweighting: share of H P H' added to the innovation variance.
    partial : (n_extra_family, n_epoch, n_channel). Derivative of the measurement with respect to extra states.
    clock_step : (3,). Cholesky factor of the receiver clock's noise over an epoch: bias (m) and drift (m/s).
    clock_start : (2,) m, m/s. Initial sigma of clock bias and drift.
    clock_jump : (n_epoch, 2) m, m/s. Jump of clock bias and drift at the epoch.
    is_frozen : (n_epoch,). Whether the receiver repeats the output of the epoch before.
    interval : s. Time between epochs.
    n_receiver : Channels of the receiver in the filter; they are the first channels.
    reference : (n_epoch, n_observable). Slot of the reference satellite of a difference between satellites, -1 none.
    shift : Offset of the sensor channels in `sigma` and `correlated_errors`, which count the channels that the receiver
        measures.
    source_keys : (4,). Keys of random draws: clock, ranges, solution, initial clock error.
    correlated_errors : Correlated measurement errors.
    """

    satellite_by_slot: Ints
    n_used: Ints
    satellite_keys: NDArray[np.uint64]
    range: Floats
    rate: Floats
    position: Floats
    velocity: Floats
    satellite_position: Floats
    satellite_velocity: Floats
    antenna: Ints
    sigma: Floats
    variance: Floats
    scale: Floats
    beta: Floats
    partial: Floats
    clock_step: Floats
    clock_start: Floats
    clock_jump: Floats
    is_frozen: Bools
    interval: float
    n_receiver: int
    reference: Ints
    shift: int
    source_keys: NDArray[np.uint64]
    correlated_errors: CorrelatedErrors


class FurtherObservables(NamedTuple):
    """Truth of the further satellite observables: carrier phase and differences of two epochs.

    phase : (n_epoch, n_sat) m. Carrier phase without clock and random errors, minus the corrections of the filter.
    is_phase : (n_observable,). Whether the observable is a carrier phase or a difference of carrier phases.
    is_difference : (n_observable,). Whether the observable is a difference of two epochs.
    is_restarted : (n_epoch, n_sat). Whether the carrier is newly acquired at the epoch.
    ambiguity : (n_sat,). Component of the correlated errors that is the ambiguity, -1 none.
    source : Key of the random draws of the phase noise.
    """

    phase: Floats
    is_phase: Bools
    is_difference: Bools
    is_restarted: Bools
    ambiguity: Ints
    source: np.uint64


class InitialState(NamedTuple):
    """True state at tick 0, and covariances of the initial error.

    nav : (10,). True navigation state, frame i.
    roots : (3, 3, 3). Square roots of the true covariances of attitude, velocity and position error, frame i.
    source_keys : (3,). Keys of the random draws of these errors.
    P : (n_state, n_state). Initial covariance of the filter.
    """

    nav: Floats
    roots: Floats
    source_keys: NDArray[np.uint64]
    P: Floats


class HistoryTruth(NamedTuple):
    """True motion at the ticks of the history times.

    r : (n_hist, 3) m. Position, frame i.
    v : (n_hist, 3) m/s. Velocity, frame i.
    q : (n_hist, 4). Attitude quaternion, body to i.
    axes : (n_hist, 3, 3). Rotation from frame i to the reporting frame.
    t : (n_hist,) s since lift-off.
    time_since_epoch : (n_hist,) s. Time since the last epoch.
    limit : m. Position error beyond which a run has failed.
    """

    r: Floats
    v: Floats
    q: Floats
    axes: Floats
    t: Floats
    time_since_epoch: Floats
    limit: float


class Sensors(NamedTuple):
    """Sensors other than the receiver. `Signals` has their noise and the noise model of the filter, by channel.

    code : (n_sensor,). Type of the sensor, as in `sensors.family`.
    channel : (n_sensor,). First channel.
    scalars : (n_sensor,). Number of channels.
    is_measuring : (n_sensor, n_epoch). Whether the sensor measures at the epoch.
    truth : (n_sensor, n_epoch, 4). True value, see the module of the sensor.
    filter_parameters : (n_sensor, n_epoch, N_FILTER_PARAMETER). Quantities known to the filter, see the module of the
        sensor.
    theta : (n_sensor, n_epoch) rad. Earth rotation angle in the filter.
    source_keys : (n_sensor,). Keys of the random draws.
    """

    code: Ints
    channel: Ints
    scalars: Ints
    is_measuring: Bools
    truth: Floats
    filter_parameters: Floats
    theta: Floats
    source_keys: NDArray[np.uint64]


class ReportedSamples(NamedTuple):
    """Inputs of the reported errors of IMU samples.

    rate : (n_tick, 3) rad/s. True mean angular rate over each tick, body axes.
    force : (n_tick, 3) m/s^2. True mean specific force over each tick, body axes.
    par : (2,). Parameter blocks of the biases of gyro and accelerometer, -1 none.
    bias : (6,). States of these biases, gyro first, -1 none.
    raw : (6,) SI squared. Error variance of a sample in the filter model: noise and initial bias.
    variance : (6,) SI squared. Noise variance of a sample in the filter model.
    """

    rate: Floats
    force: Floats
    par: Ints
    bias: Ints
    raw: Floats
    variance: Floats


class ReportedSolution(NamedTuple):
    """Inputs of the reported errors of the receiver's solution.

    point : (n_epoch, 6) m, m/s. True position and velocity of the point that the receiver solves for, frame i.
    first_output : First column of the outputs.
    first_channel : First channel of the innovations of the receiver's filter.
    n_channel : Number of these channels; 0 without a filter.
    """

    point: Floats
    first_output: int
    first_channel: int
    n_channel: int


class Options(NamedTuple):
    """Settings of the optional features of a case; None without the feature, which is then not compiled.

    The arrays that a run changes are in `epoch.filter_case.OptionalState`.
    An option is passed to kernels as its own argument: the compiler drops `if option is None` for arguments only.

    solver : filter.receivers.receiver.Solver. The receiver computes position and velocity itself.
    rules : filter.policies.mode_logic.ModeRules. Mode logic of the filter.
    delay_processing : filter.policies.delay.DelayProcessing. Delay compensation.
    gains : filter.policies.stored_gains.StoredGains. Stored gains.
    vehicle : filter.policies.imu_samples.VehicleModel. IMU samples are processed as measurements.
    reported_samples : ReportedSamples. Errors of IMU samples are reported.
    reported_solution : ReportedSolution. Errors of the receiver's solution are reported.
    has_transition_errors : True. The error of the filter's transition is recorded in place of estimation errors.
    imu_array : ImuArray. Several IMUs are combined.
    direct : True. The filter corrects its total state after each scalar measurement.
    backup : int. First output of the backup strapdown, which is never corrected.
    further_observables : FurtherObservables. Carrier phases or differences of two epochs are measured.
    differences : filter.policies.epoch_differences.DifferenceProcessing. Differences of two epochs are measured.
    has_sigma_points : True. Sigma points in place of Jacobians.
    fault_tests : filter.policies.integrity.state.FaultTests. Tests for faults.
    iteration_settings : filter.policies.iterated.IterationSettings. Iterated measurement update.
    """

    solver: Any = None
    rules: Any = None
    delay_processing: Any = None
    gains: Any = None
    vehicle: Any = None
    reported_samples: Any = None
    reported_solution: Any = None
    has_transition_errors: Any = None
    imu_array: Any = None
    direct: Any = None
    backup: Any = None
    further_observables: Any = None
    differences: Any = None
    has_sigma_points: Any = None
    fault_tests: Any = None
    iteration_settings: Any = None
