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
    rest = (log.t_fix >= begin) & (log.t_fix <= end)
    if not rest.any() or end >= log.t_fix[-1]:
        raise InputError(f"still: no solutions from {begin:g} to {end:g} s, or none after it")
    if (speed := float(np.max(np.linalg.norm(log.moving[rest], axis=1)))) > _FASTEST:
        raise InputError(f"still: the vehicle moves at up to {speed:.2g} m/s from {begin:g} to {end:g} s")
    place = np.mean(log.place[rest], axis=0)
    rate, force = (
        (increments_to(log, np.array([end]), part) - increments_to(log, np.array([begin]), part))[0] / (end - begin)
        for part in (log.turned, log.pushed)
    )
    axes_n = rotation_e_n(place[0], place[1])
    weight = _weight(place)
    size = float(np.linalg.norm(force))
    if abs(size - weight) > _WRONG_FORCE * weight:
        raise InputError(f"still: a mean specific force of {size:.5g} m/s^2, gravity there is {weight:.5g} m/s^2")
    level = _levelled(-force / size)
    if card.heading is not None:
        heading, sigma = card.heading, 0.0
    else:
        # the mean rate at rest includes the Earth rate, which is thus removed too: a twelfth of a degree in 20 s
        heading, sigma = _heading_of_motion(log, card, level, rate, weight)
    C_b_n = Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix() @ level
    turning = C_b_n.T @ axes_n @ np.array([0.0, 0.0, OMEGA])
    bias = rate - turning if card.gyro_bias == "still" else np.zeros(3)
    return Alignment(end, C_b_n, bias, heading, sigma)


def increments_to(log: NavigationData, t: Floats, sums: Floats) -> Floats:
    """Return the summed increments (n, 3) of a log at times t (n,) s, interpolated linearly between its rows."""
    return np.column_stack([np.interp(t, log.t, axis) for axis in sums.T])


def _weight(place: Floats) -> float:
    """Return gravity (m/s^2), gravitation plus centrifugal acceleration, at latitude, longitude (rad), height (m)."""
    r_e = ecef_from_geodetic(*place)
    outward = OMEGA**2 * r_e * np.array([1.0, 1.0, 0.0])
    return float(np.linalg.norm(gravity_along(r_e[None, :])[0] + outward))


def _levelled(down: Floats) -> Floats:
    """Return the attitude C_b_n (3, 3) with zero heading; down (3,): direction of the vertical, body axes."""
    ahead = np.array([1.0, 0.0, 0.0] if abs(down[0]) < _UPRIGHT else [0.0, 0.0, 1.0])
    north = ahead - (ahead @ down) * down
    north /= np.linalg.norm(north)
    return np.stack([north, np.cross(down, north), down])


def _heading_of_motion(
    log: NavigationData, card: NavigationLog, level: Floats, rate: Floats, weight: float
) -> tuple[float, float]:
    """Return the heading that best fits the horizontal velocity of the IMU to that of the receiver, and its sigma, rad.

    With both velocities as complex numbers, the heading is the phase between them.
    """
    end = card.still[1]
    fixes = (log.t_fix > end) & (log.t_fix <= end + card.heading_within)
    rows = log.t[(log.t > end) & (log.t < end + card.heading_within)]
    t = np.concatenate([[end], rows])
    turned, pushed = (np.diff(increments_to(log, t, part), axis=0) for part in (log.turned, log.pushed))
    attitude = Rotation.from_matrix(level)
    gained = np.zeros((len(t), 3))
    steps = Rotation.from_rotvec(turned - rate * np.diff(t)[:, None])
    for k, step in enumerate(steps):
        middle = attitude * Rotation.from_rotvec(0.5 * step.as_rotvec())
        gained[k + 1] = gained[k] + middle.apply(pushed[k])
        attitude = attitude * step
    gained[:, 2] += weight * (t - end)
    inertial = np.interp(log.t_fix[fixes], t, gained[:, 0]) + 1j * np.interp(log.t_fix[fixes], t, gained[:, 1])
    received = log.moving[fixes, 0] + 1j * log.moving[fixes, 1]
    if not fixes.any() or np.sqrt(np.mean(np.abs(received) ** 2)) < _SLOWEST:
        raise InputError(
            f"heading: the vehicle hardly moves in the {card.heading_within:g} s after its rest; state the heading"
        )
    heading = float(np.angle(np.sum(received * np.conj(inertial))))
    across = np.imag(received * np.exp(-1j * (np.angle(inertial) + heading)))
    return heading, float(np.sqrt(np.mean(across**2) / np.sum(np.abs(inertial) ** 2)))
