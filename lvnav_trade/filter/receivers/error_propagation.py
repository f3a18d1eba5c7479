"""Linear error propagation from ranges to the receiver's solution, and from there to the navigation filter.

All errors are truth minus estimate. Over an epoch the receiver's error e follows

    e+ = (I - K H)(Phi e + d + w) - K v

with H the Jacobian of ranges and range rates, v their errors (white and correlated), w the noise of the true clock, and
d = x - Phi x_before the mismatch of the true motion, which is the same in every run. The navigation filter measures the
solution, whose error is S e: its innovation is H_nav e_nav - S e. Hence e is part of the joint vector, with its own
gains K. It is coloured: a covariance that treats it as white noise at every epoch is too small.

Matrices are dense here.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.receivers.ekf_gnss import adapted_variances, add_driving_noise
from lvnav_trade.filter.receivers.receiver import (
    ACC,
    BIAS,
    DRIFT,
    N_FIX,
    N_STATE,
    POS,
    VEL,
    PointModel,
    ReceiverFilter,
    ReportedCovariance,
    transition,
)
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats

# Position and velocity of the solution among the states of the receiver's filter.
SOLUTION = np.array([*range(POS, POS + 3), *range(VEL, VEL + 3)])
# States of the point solution, in the order of `FIX_POS` to `FIX_DRIFT`.
FIX_STATES = np.array([*SOLUTION, BIAS, DRIFT])
# States that follow from ranges and from range rates, and their places in the point solution.
POSITION_AND_BIAS = np.array([*range(POS, POS + 3), BIAS])
VELOCITY_AND_DRIFT = np.array([*range(VEL, VEL + 3), DRIFT])
POSITION_FIX = np.array([0, 1, 2, 6])
VELOCITY_FIX = np.array([3, 4, 5, 7])


class ErrorPropagation(NamedTuple):
    """Linear error propagation of the receiver over an epoch.

    phi : (11, 11). Transition matrix.
    update_matrix : (11, 11). I - K H; zero for a fix that starts the filter.
    gain : (11, n_row). Gain K.
    P : (11, 11). Covariance of the receiver's filter after the epoch.
    """

    phi: Floats
    update_matrix: Floats
    gain: Floats
    P: Floats


def design_matrix(r_i: Floats, v_i: Floats, satellite: Floats, satellite_velocity: Floats) -> Floats:
    """Return the Jacobian H (2 n_sat, 11), satellite by satellite: pseudorange, range rate.

    Parameters
    ----------
    r_i, v_i : (3,) m, m/s, frame i
        Receiver.
    satellite, satellite_velocity : (n_sat, 3) m, m/s, frame i
        Position of the satellites at transmission, and its derivative by reception time.
    """
    line = sight(satellite - r_i, satellite_velocity - v_i)
    jacobian = np.zeros((2 * len(satellite), N_STATE))
    jacobian[0::2, POS : POS + 3] = -line.direction
    jacobian[0::2, BIAS] = 1.0
    jacobian[1::2, POS : POS + 3] = -line.direction_rate
    jacobian[1::2, VEL : VEL + 3] = -line.direction
    jacobian[1::2, DRIFT] = 1.0
    return jacobian


def point_gain(rows: Floats) -> Floats:
    """Return the gain G (8, n_row) of the point solution: measurement errors v cause the error -G v.

    Position and bias follow from the pseudoranges alone. The position error then rotates the lines of sight of the
    range rates.

    rows : (n_row, 11). Jacobian as from `design_matrix`, of at least four satellites.
    """
    range_rows = rows[0::2]
    rate_rows = rows[1::2]
    position_gain = np.linalg.pinv(range_rows[:, POSITION_AND_BIAS])
    velocity_gain = np.linalg.pinv(rate_rows[:, VELOCITY_AND_DRIFT])
    gain = np.zeros((N_FIX, len(rows)))
    gain[POSITION_FIX, 0::2] = position_gain
    gain[VELOCITY_FIX, 1::2] = velocity_gain
    gain[VELOCITY_FIX, 0::2] = -velocity_gain @ rate_rows[:, POS : POS + 3] @ position_gain[:3]
    return gain


def noise_covariances(model: ReceiverFilter, acceleration: Floats, n_row: int) -> tuple[Floats, Floats]:
    """Return the filter's process noise (11, 11) and measurement variances (n_row,) for an acceleration (3,) m/s^2."""
    ax, ay, az = acceleration.tolist()
    x, y, z, range_variance, rate_variance = adapted_variances(ax, ay, az, model)
    noise = np.zeros((N_STATE, N_STATE))
    add_driving_noise(noise, model, x, y, z)
    variances = np.tile([range_variance, rate_variance], n_row // 2)
    return noise, variances


def nominal_acceleration(v_i: Floats, has_fix: Bools, interval: float) -> Floats:
    """Return the acceleration (n_epoch, 3) m/s^2 that adapts the receiver's filter on the nominal motion.

    It is the difference of the velocities at the last two epochs with a point solution over the time between them. It
    is zero before the second such epoch and constant until the next.

    v_i : (n_epoch, 3) m/s. Nominal velocity.
    has_fix : (n_epoch,). Whether the epoch has a point solution.
    interval : s. Time between epochs.
    """
    acceleration = np.zeros_like(v_i)
    last_fix = -1
    for k in range(len(v_i)):
        if k > 0:
            acceleration[k] = acceleration[k - 1]
        if has_fix[k]:
            if last_fix >= 0:
                velocity_change = v_i[k] - v_i[last_fix]
                time_between_fixes = interval * (k - last_fix)
                acceleration[k] = velocity_change / time_between_fixes
            last_fix = k
    return acceleration


def point_solution(model: PointModel, rows: Floats) -> ErrorPropagation:
    """Return the error propagation of a point solution, which is independent of the previous epoch.

    rows : (n_row, 11). Jacobian as from `design_matrix`.
    """
    gain = np.zeros((N_STATE, len(rows)))
    gain[FIX_STATES] = point_gain(rows)
    P = np.zeros((N_STATE, N_STATE))
    for columns, variance, measurement_rows in (
        (POSITION_AND_BIAS, model.range_variance, rows[0::2]),
        (VELOCITY_AND_DRIFT, model.rate_variance, rows[1::2]),
    ):
        normal_matrix = measurement_rows[:, columns].T @ measurement_rows[:, columns]
        P[np.ix_(columns, columns)] = variance * np.linalg.inv(normal_matrix)
    zero_matrix = np.zeros((N_STATE, N_STATE))  # the error of the previous epoch has no effect
    return ErrorPropagation(zero_matrix, zero_matrix.copy(), gain, P)


def filter_start(model: ReceiverFilter, point: PointModel, rows: Floats) -> ErrorPropagation:
    """Return the error propagation of the fix that starts the filter.

    The filter starts with zero acceleration, so that its acceleration error is the true acceleration.
    """
    propagation = point_solution(point, rows)
    acceleration = range(ACC, ACC + 3)
    propagation.P[acceleration, acceleration] = model.start
    propagation.update_matrix[acceleration, acceleration] = 1.0
    return propagation


def filter_epoch(P: Floats, model: ReceiverFilter, rows: Floats, acceleration: Floats) -> ErrorPropagation:
    """Return the error propagation of the running filter over an epoch.

    Parameters
    ----------
    P : (11, 11)
        Covariance after the previous epoch.
    model : ReceiverFilter
    rows : (n_row, 11)
        Jacobian as from `design_matrix`; without rows the filter only propagates.
    acceleration : (3,) m/s^2
        Acceleration that adapts the noise, as from `nominal_acceleration`.
    """
    noise, variance = noise_covariances(model, acceleration, len(rows))
    phi = transition(model)
    propagated_covariance = phi @ P @ phi.T
    P = propagated_covariance + noise
    state_covariance = rows @ P @ rows.T
    innovation_covariance = state_covariance + np.diag(variance)
    # K' = S^-1 H P, because S and P are symmetric
    gain_transposed = np.linalg.solve(innovation_covariance, rows @ P)
    gain = np.asarray(gain_transposed.T, dtype=np.float64)
    update_matrix = np.eye(N_STATE) - gain @ rows
    # Joseph's form: (I - K H) P (I - K H)' + K R K'
    corrected_covariance = update_matrix @ P @ update_matrix.T
    noise_covariance = (gain * variance) @ gain.T
    P = corrected_covariance + noise_covariance
    return ErrorPropagation(phi, update_matrix, gain, P)


def mismatch(model: ReceiverFilter, acceleration: Floats, v_i: Floats, r_i: Floats) -> Floats:
    """Return the mismatch d = x - Phi x_before (n_epoch, 11) of the true motion; at the first epoch the state x itself.

    acceleration : (n_epoch, 3) m/s^2. True acceleration; zeros for a filter without acceleration states.
    v_i, r_i : (n_epoch, 3) m/s, m. True velocity and position.
    """
    state = np.zeros((len(r_i), N_STATE))
    state[:, ACC : ACC + 3] = acceleration
    state[:, VEL : VEL + 3] = v_i
    state[:, POS : POS + 3] = r_i
    difference = state.copy()
    difference[1:] -= state[:-1] @ transition(model).T
    return difference


def reported_covariance(settings: ReportedCovariance, P: Floats) -> Floats:
    """Return the covariance (6, 6) reported with a solution of a filter with covariance P (11, 11)."""
    if not settings.is_computed:
        variances = [settings.position_variance] * 3 + [settings.velocity_variance] * 3
        return np.diag(variances)
    solution_covariance = P[np.ix_(SOLUTION, SOLUTION)]
    R = np.asarray(settings.factor * solution_covariance)
    return R if settings.has_correlations else np.diag(np.diag(R))
