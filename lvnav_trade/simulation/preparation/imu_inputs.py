"""Inputs of a flight from the IMU, or from an array of IMUs, as arrays for the kernels."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.records import Floats, Ints


class ImuTruth(NamedTuple):
    """Truth-side model of an IMU: ideal increments and true error parameters.

    For an IMU array it has the blocks of all IMUs, with sensor number 2 * triad + sensor, and the increments of the
    combined triad; `ImuArray` has the rest. A block is one error parameter of three axes.

    dt : s. Sampling interval.
    noise_source : Key of the random draws of white noise.
    biases_only : Whether there are no scale-factor, misalignment and g-sensitivity errors.
    dtheta : (n_tick, 3) rad. Angle increments without errors, body axes.
    dvel : (n_tick, 3) m/s. Velocity increments without errors, body axes.
    white : (8,) rad, m/s. Sigma of white noise in an increment: gyro (3), accelerometer (3); both quantisation steps.
    process_ticks : Ticks between two steps of time-varying parameters.
    is_drifting : Whether any parameter varies with time.
    sigma : (n_block, 3) SI. Initial sigma of each parameter.
    decay : (n_block,). Decay factor over a step of `process_ticks`.
    walk : (n_block, 3) SI. Sigma of the noise added in a step.
    sources : (n_block,). Keys of the random draws.
    sensors : (n_block,). GYRO or ACCEL; without the gravity disturbance.
    drivers : (n_block,). Quantity that the parameter multiplies, as in `kernels.transition`.
    profile_sensor : (n_profile,). Sensor of an error profile that is the same in every run: warming or a fault.
    profile_driver : (n_profile,). Quantity that the profile multiplies: constant (bias) or own input (scale factor).
    profile_start : (n_profile,) s since lift-off. Start of the growth.
    profile_end : (n_profile,) s since lift-off. End of the growth.
    profile : (n_profile, 3) SI. Error after the growth.
    gravity : Block of the gravity disturbance, -1 none.
    start : s since lift-off. Time of tick 0.
    """

    dt: float
    noise_source: np.uint64
    biases_only: bool
    dtheta: Floats
    dvel: Floats
    white: Floats
    process_ticks: int
    is_drifting: bool
    sigma: Floats
    decay: Floats
    walk: Floats
    sources: NDArray[np.uint64]
    sensors: Ints
    drivers: Ints
    profile_sensor: Ints
    profile_driver: Ints
    profile_start: Floats
    profile_end: Floats
    profile: Floats
    gravity: int
    start: float


class ImuArray(NamedTuple):
    """An IMU array, triad by triad (up to three sensing axes of an IMU), and how its axes are combined.

    A stage is a part of the flight with the same combination; without redundancy the flight is one stage. A pair is a
    measured difference of two IMUs.

    dtheta : (n_triad, n_tick, 3) rad. Angle increments at the IMU without errors, body axes.
    dvel : (n_triad, n_tick, 3) m/s. Velocity increments at the IMU without errors, body axes.
    n_axis : (n_triad,). Number of sensing axes.
    frames : (n_triad, 3, 3, 3). For each axis, unit vectors in body axes: its direction, those of its misalignments.
    axis_weights : (n_stage, n_triad, 2, 3, 3). Weights of each axis of gyro and accelerometer in the combined triad.
    lever : (n_triad, 3) m. Compensated lever arm, body axes; zero without compensation.
    noise_sources : (n_triad,). Keys of the random draws of white noise.
    white : (n_triad, 8). As `ImuTruth.white`.
    triads : (n_block,). Triad of each block of error parameters.
    pair_sensor : (n_pair,). GYRO or ACCEL.
    pair_weights : (n_pair, n_triad, 3, 3). Weights by which each axis enters the difference.
    pair_state : (n_pair,). First filter state of the relative bias, -1 none.
    pair_of : (n_device,). Pair that a sensor measures, -1 none.
    error_factors : (n_stage, 2, 2, 3). Factor on lasting errors and on white noise, by sensor and combined axis.
    shift : (n_stage, 2, 3) rad, m/s. Mean error of a combined increment.
    stage : (n_tick,). Stage of each tick in linear covariance.
    stage_without_exclusion : (n_tick,). Stage of each tick if no IMU were excluded; a run excludes IMUs itself.
    redundant : ImuRedundancy. Test and selection of the IMUs; None without both.
    """

    dtheta: Floats
    dvel: Floats
    n_axis: Ints
    frames: Floats
    axis_weights: Floats
    lever: Floats
    noise_sources: NDArray[np.uint64]
    white: Floats
    triads: Ints
    pair_sensor: Ints
    pair_weights: Floats
    pair_state: Ints
    pair_of: Ints
    error_factors: Floats
    shift: Floats
    stage: Ints
    stage_without_exclusion: Ints
    redundant: Any = None


class ImuRedundancy(NamedTuple):
    """Parity test of redundant IMUs, and selection of their middle value or of a prime IMU.

    uses_middle_value : Whether the middle value of the IMUs is used in place of their mean.
    uses_prime : Whether the first IMU that is not excluded is used alone.
    excludes : Whether an IMU is excluded when the test fails; otherwise the detection is only reported.
    hands_over_on_failure : Whether the prime IMU is excluded when the test fails.
    planned_handover_tick : Tick from which the first IMU is excluded in any case; -1 without.
    n_test_tick : Ticks summed for a test; 0 without tests.
    weight : (n_window, 2, n_triad, 3). Inverse of the modelled variance of a summed increment; 0 without an axis.
    limits : (n_dof + 1,). Largest weighted sum of squared residuals, by degrees of freedom (chi-square).
    owner : (n_triad,). IMU that the triad belongs to.
    imu_weights : (n_triad, 3, 3). Weights by which the axes enter the solution of their IMU alone.
    shares : (2, n_triad). Weight of the axes in the mean, by sensor.
    noise : (2, n_triad, 3) SI squared per second. PSD of the white noise of an axis.
    spread : (2, n_triad, 3) SI squared. Variance of the bias of an axis.
    walk : (2, n_triad, 3) SI squared per second. Variance rate of the random walk of that bias.
    exclusion_ticks : (n_exclusion,). Ticks from which an IMU is excluded on the nominal flight.
    mean : (n_exclusion + 1, n_triad, 2, 3, 3). Weights of the mean: of all IMUs, then after each exclusion.
    """

    uses_middle_value: bool
    uses_prime: bool
    excludes: bool
    hands_over_on_failure: bool
    planned_handover_tick: int
    n_test_tick: int
    weight: Floats
    limits: Floats
    owner: Ints
    imu_weights: Floats
    shares: Floats
    noise: Floats
    spread: Floats
    walk: Floats
    exclusion_ticks: Ints
    mean: Floats
