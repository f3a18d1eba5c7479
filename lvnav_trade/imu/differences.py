"""Difference of two IMUs of an array: its Jacobian by the errors of the axes, and the sigmas of its errors."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.array import ImuSet, least_squares, triads_of
from lvnav_trade.quantities.per_axis import PerAxis, rms, squares
from lvnav_trade.quantities.records import Floats


def difference(imu: ImuSet, first: int, second: int) -> list[Floats]:
    """Return the derivatives of the difference of two IMUs by the errors of their axes.

    Each IMU is fused by its own unweighted least squares.

    Parameters
    ----------
    imu : ImuSet
    first, second : int
        IMUs, from 0. The measurement is the first minus the second.

    Returns
    -------
    list of (2, 3, 3)
        By triad: columns of gyro and accelerometer axes, body axes; zero for other IMUs.
    """
    columns = [np.zeros((2, 3, 3)) for _ in triads_of(imu)]
    seen = [0] * len(imu.units)
    solutions = {
        n: (sign, least_squares(d := imu.units[n].directions, np.ones(len(d))))
        for n, sign in ((first, 1.0), (second, -1.0))
    }
    for number, triad in enumerate(triads_of(imu)):
        if triad.unit in solutions:
            sign, A = solutions[triad.unit]
            members = slice(seen[triad.unit], seen[triad.unit] + triad.n_axis)
            columns[number][:, :, : triad.n_axis] = sign * A[:, members]
            seen[triad.unit] += triad.n_axis
    return columns


class RelativeErrors(NamedTuple):
    """Sigmas of the difference of two IMUs of an array: the same on all axes, or by axis if those of an IMU differ.

    random_walk : rad/sqrt(s) or m/s/sqrt(s). Root PSD of the white noise, root mean square over the axes.
    by_axis : (3,) rad/sqrt(s) or m/s/sqrt(s). Root PSD of the white noise by body axis.
    bias : rad/s or m/s^2. Bias of the first unit minus that of the second.
    walk : rad/s/sqrt(s) or m/s^2/sqrt(s). Root PSD of the random walk of the bias.
    correlation : Correlation of the bias with that of the fused triad at the start.
    """

    random_walk: float
    by_axis: tuple[float, ...]
    bias: PerAxis
    walk: PerAxis
    correlation: PerAxis


def relative_errors(imu: ImuSet, sensor: int, first: int, second: int) -> RelativeErrors:
    """Return the errors of the difference of two IMUs.

    Parameters
    ----------
    imu : ImuSet
    sensor : int
        GYRO or ACCEL.
    first, second : int
        IMUs, from 0. The difference is the first minus the second.
    """
    # variances by axis: noise, bias and walk of the difference, bias of the fused triad (own), and their covariance
    noise, bias, walk, shared, own, biases_alike = *np.zeros((5, 3)), True
    for triad, columns in zip(triads_of(imu), difference(imu, first, second), strict=True):
        unit = imu.units[triad.unit]
        D = columns[sensor]
        A = (triad.gyro, triad.accel)[sensor]
        card = (unit.gyro, unit.accel)[sensor]
        flicker = np.array(squares(card.instability_axes(card.instability_sigma)))
        lasting = np.array(squares(card.bias_repeatability)) + flicker
        drift = np.array(squares(card.rate_random_walk)) + flicker * 2.0 / card.instability.time_constant
        bias = bias + D**2 @ lasting
        walk = walk + D**2 @ drift
        shared = shared + (D * A) @ lasting
        own = own + A**2 @ lasting
        biases_alike &= not any(
            isinstance(size, tuple) for size in (card.bias_repeatability, card.bias_instability, card.rate_random_walk)
        )
        # mean over the body axes if the axes of the IMU are equal
        size = float(np.sum(D**2)) / 3.0
        alike = not isinstance(card.random_walk, tuple)
        noise = noise + (rms(card.random_walk) ** 2 * size if alike else D**2 @ squares(card.random_walk))
    if biases_alike:
        bias, walk, shared, own = (np.full(3, np.mean(variance)) for variance in (bias, walk, shared, own))
    both = np.sqrt(bias * own)
    # a correlation between equal IMUs is rounding; without a bias there is none
    correlated = (both > 0.0) & (np.abs(shared) > 1e-12 * both)
    correlation = np.divide(shared, both, out=np.zeros(3), where=correlated)
    by_axis = tuple(np.sqrt(noise).tolist())
    mean = by_axis[0] if len(set(by_axis)) == 1 else math.sqrt(float(np.mean(noise)))
    return RelativeErrors(mean, by_axis, _of_axes(np.sqrt(bias)), _of_axes(np.sqrt(walk)), _of_axes(correlation))


def _of_axes(values: Floats) -> PerAxis:
    x, y, z = values.tolist()
    return x if x == y == z else (x, y, z)
