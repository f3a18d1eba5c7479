"""Alignment from a recorded log: level and gyro bias from the rest, heading as given or from the motion."""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import OMEGA, gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import ecef_from_geodetic, rotation_e_n
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.recorded.navigation_log import NavigationData, NavigationLog

_UPRIGHT = math.cos(math.radians(30.0))  # x axis within 30 degrees of the vertical: its heading is ill-defined
_WRONG_FORCE = 0.03  # largest error of the mean specific force at rest, as a fraction of gravity
_FASTEST = 0.5  # m/s, largest speed of a vehicle at rest
_SLOWEST = 0.5  # m/s rms, smallest speed from which a heading is determined


class Alignment(NamedTuple):
    """Initial attitude and gyro bias of a recorded log.

    t : s. Time of the alignment, the end of the rest.
    C_b_n : (3, 3). Rotation from body axes to north, east, down.
    gyro_bias : (3,) rad/s. Bias that is subtracted from the rates, body axes.
    heading : rad.
    heading_sigma : rad. One-sigma of a heading from the motion; 0 if it was given.
    """

    t: float
    C_b_n: Floats
    gyro_bias: Floats
    heading: float
    heading_sigma: float


def align(log: NavigationData, card: NavigationLog) -> Alignment:
    """Return the alignment at the end of the rest.

    Raises
    ------
    InputError
        If the vehicle is not at rest, the specific force at rest is not gravity, or the motion does not show a heading.
    """
    begin, end = card.still
    is_at_rest = (log.t_fix >= begin) & (log.t_fix <= end)
    if not is_at_rest.any() or end >= log.t_fix[-1]:
        raise InputError(f"still: no solutions from {begin:g} to {end:g} s, or none after it")
    speeds = np.linalg.norm(log.velocity_ned[is_at_rest], axis=1)
    speed = float(np.max(speeds))
    if speed > _FASTEST:
        raise InputError(f"still: the vehicle moves at up to {speed:.2g} m/s from {begin:g} to {end:g} s")
    place = np.mean(log.place[is_at_rest], axis=0)
    rate = _mean_at_rest(log, card, log.angle_sums)
    force = _mean_at_rest(log, card, log.velocity_sums)
    weight = _weight(place)
    force_size = float(np.linalg.norm(force))
    if abs(force_size - weight) > _WRONG_FORCE * weight:
        raise InputError(f"still: a mean specific force of {force_size:.5g} m/s^2, gravity there is {weight:.5g} m/s^2")
    level = _level_attitude(-force / force_size)
    if card.heading is not None:
        heading, sigma = card.heading, 0.0
    else:
        # the mean rate at rest includes the Earth rate, which is thus removed too: a twelfth of a degree in 20 s
        heading, sigma = _motion_heading(log, card, level, rate, weight)
    turn = Rotation.from_rotvec([0.0, 0.0, heading])
    C_b_n = turn.as_matrix() @ level
    latitude, longitude, _ = place
    C_e_n = rotation_e_n(latitude, longitude)
    earth_rate_e = np.array([0.0, 0.0, OMEGA])
    earth_rate_b = C_b_n.T @ C_e_n @ earth_rate_e
    bias = rate - earth_rate_b if card.gyro_bias == "still" else np.zeros(3)
    return Alignment(t=end, C_b_n=C_b_n, gyro_bias=bias, heading=heading, heading_sigma=sigma)


def interpolated_increments(log: NavigationData, t: Floats, sums: Floats) -> Floats:
    """Return the summed increments of a log at given times, interpolated linearly between its rows, (n, 3).

    Parameters
    ----------
    log
        Log of the flight.
    t
        (n,) s.
    sums
        (n_row, 3) rad or m/s. Increments summed up to each row.
    """
    return np.column_stack([np.interp(t, log.t, axis) for axis in sums.T])


def _weight(place: Floats) -> float:
    """Return gravity (m/s^2), gravitation plus centrifugal acceleration, at latitude, longitude (rad), height (m)."""
    r_e = ecef_from_geodetic(*place)
    centrifugal = OMEGA**2 * r_e * np.array([1.0, 1.0, 0.0])
    gravitation = gravity_along(r_e[None, :])[0]
    return float(np.linalg.norm(gravitation + centrifugal))


def _mean_at_rest(log: NavigationData, card: NavigationLog, sums: Floats) -> Floats:
    """Return the mean rate (rad/s) or specific force (m/s^2) during the rest, (3,), body axes.

    Parameters
    ----------
    log, card
        Log of the flight, and its card.
    sums
        (n_row, 3) rad or m/s. Increments summed up to each row.
    """
    begin, end = card.still
    sum_at_end = interpolated_increments(log, np.array([end]), sums)
    sum_at_begin = interpolated_increments(log, np.array([begin]), sums)
    increment = sum_at_end - sum_at_begin
    return np.asarray(increment[0] / (end - begin))


def _level_attitude(down: Floats) -> Floats:
    """Return the attitude C_b_n (3, 3) with zero heading; down (3,): direction of the vertical, body axes."""
    if abs(down[0]) < _UPRIGHT:
        ahead = np.array([1.0, 0.0, 0.0])
    else:  # the x axis is nearly vertical: zero heading is that of the z axis
        ahead = np.array([0.0, 0.0, 1.0])
    north = ahead - (ahead @ down) * down
    north /= np.linalg.norm(north)
    return np.stack([north, np.cross(down, north), down])


def _motion_heading(
    log: NavigationData,
    card: NavigationLog,
    level: Floats,
    rate: Floats,
    weight: float,
) -> tuple[float, float]:
    """Return the heading that best fits the horizontal velocity of the IMU to that of the receiver, and its sigma, rad.

    With both velocities as complex numbers, the heading is the phase between them.

    Parameters
    ----------
    log, card
        Log of the flight, and its card.
    level
        (3, 3). Attitude C_b_n with zero heading.
    rate
        (3,) rad/s. Mean rate at rest, body axes.
    weight
        m/s^2. Gravity at rest.
    """
    _, begin = card.still
    end = begin + card.heading_within
    solutions = (log.t_fix > begin) & (log.t_fix <= end)
    received_north = log.velocity_ned[solutions, 0]
    received_east = log.velocity_ned[solutions, 1]
    receiver_velocity = received_north + 1j * received_east
    if not solutions.any() or np.sqrt(np.mean(np.abs(receiver_velocity) ** 2)) < _SLOWEST:
        raise InputError(
            f"heading: the vehicle hardly moves in the {card.heading_within:g} s after its rest; state the heading"
        )
    is_between = (log.t > begin) & (log.t < end)
    t = np.concatenate([[begin], log.t[is_between]])
    velocity = _inertial_velocity(log, t, level, rate)
    velocity[:, 2] += weight * (t - begin)
    t_fix = log.t_fix[solutions]
    inertial_ahead = np.interp(t_fix, t, velocity[:, 0])
    inertial_right = np.interp(t_fix, t, velocity[:, 1])
    imu_velocity = inertial_ahead + 1j * inertial_right
    correlation = np.sum(receiver_velocity * np.conj(imu_velocity))
    heading = float(np.angle(correlation))
    # components of the received velocities across the inertial velocities, turned by the heading
    direction = np.angle(imu_velocity) + heading
    cross_velocity = np.imag(receiver_velocity * np.exp(-1j * direction))
    sum_of_squares = np.sum(np.abs(imu_velocity) ** 2)
    variance = np.mean(cross_velocity**2) / sum_of_squares
    return heading, float(np.sqrt(variance))


def _inertial_velocity(log: NavigationData, t: Floats, level: Floats, rate: Floats) -> Floats:
    """Return the velocity gained by specific force since the first time, (n, 3) m/s, levelled axes.

    Parameters
    ----------
    log
        Log of the flight.
    t
        (n,) s. Times.
    level
        (3, 3). Attitude at the first time.
    rate
        (3,) rad/s. Rate that is subtracted from the angular rate, body axes.
    """
    dt = np.diff(t)[:, None]
    angle_sums = interpolated_increments(log, t, log.angle_sums)
    velocity_sums = interpolated_increments(log, t, log.velocity_sums)
    dtheta = np.diff(angle_sums, axis=0) - rate * dt
    dvel = np.diff(velocity_sums, axis=0)
    steps = Rotation.from_rotvec(dtheta)
    half_steps = Rotation.from_rotvec(0.5 * steps.as_rotvec())
    velocity_steps = half_steps.apply(dvel)
    attitude = level
    velocity = np.zeros((len(t), 3))
    for k, step in enumerate(steps.as_matrix()):
        velocity[k + 1] = velocity[k] + attitude @ velocity_steps[k]
        attitude = attitude @ step
    return velocity
