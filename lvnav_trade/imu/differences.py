"""Difference of two IMUs of an array: its Jacobian by the errors of the axes, and the sigmas of its errors."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.array import ImuSet, least_squares, list_triads
from lvnav_trade.kernels.transition import GYRO
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
    triads = list_triads(imu)
    columns = [np.zeros((2, 3, 3)) for _ in triads]
    for number, sign in ((first, 1.0), (second, -1.0)):
        axes = imu.units[number].directions
        equal_weights = np.ones(len(axes))
        A = least_squares(axes, equal_weights)
        column = 0
        for index, triad in enumerate(triads):
            if triad.unit == number:
                n = triad.n_axis
                columns[index][:, :, :n] = sign * A[:, column : column + n]
                column += n
    return columns


class RelativeErrors(NamedTuple):
    """Sigmas of the difference of two IMUs of an array: the same on all axes, or by axis if those of an IMU differ.

    random_walk : rad/sqrt(s) or m/s/sqrt(s). Root PSD of the white noise, root mean square over the axes.
    axis_random_walks : (3,) rad/sqrt(s) or m/s/sqrt(s). Root PSD of the white noise by body axis.
    bias : rad/s or m/s^2. Bias of the first unit minus that of the second.
    walk : rad/s/sqrt(s) or m/s^2/sqrt(s). Root PSD of the random walk of the bias.
    correlation : Correlation of the bias with that of the fused triad at the start.
    """

    random_walk: float
    axis_random_walks: tuple[float, ...]
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
    # variances by axis: noise, bias and walk of the difference, bias of the fused triad, and covariance of both biases
    noise, bias, walk, fused_bias, covariance = np.zeros((5, 3))
    has_equal_axes = True
    derivatives = difference(imu, first, second)
    for triad, columns in zip(list_triads(imu), derivatives, strict=True):
        unit = imu.units[triad.unit]
        D = columns[sensor]
        A = triad.gyro if sensor == GYRO else triad.accel
        card = unit.gyro if sensor == GYRO else unit.accel
        instability_sigma = card.instability_axes(card.instability_sigma)
        instability = np.array(squares(instability_sigma))
        repeatability = np.array(squares(card.bias_repeatability))
        bias_variance = repeatability + instability
        rate_random_walk = np.array(squares(card.rate_random_walk))
        drift = rate_random_walk + instability * 2.0 / card.instability.time_constant
        bias += D**2 @ bias_variance
        walk += D**2 @ drift
        covariance += (D * A) @ bias_variance
        fused_bias += A**2 @ bias_variance
        sizes = (card.bias_repeatability, card.bias_instability, card.rate_random_walk)
        has_equal_axes &= not any(isinstance(size, tuple) for size in sizes)
        if isinstance(card.random_walk, tuple):
            noise += D**2 @ squares(card.random_walk)
        else:  # the axes of the IMU are equal: mean over the body axes
            mean_square = float(np.sum(D**2)) / 3.0
            noise += rms(card.random_walk) ** 2 * mean_square
    if has_equal_axes:
        for variance in (bias, walk, covariance, fused_bias):
            variance[:] = np.mean(variance)
    random_walk = np.sqrt(noise).tolist()
    mean_random_walk = random_walk[0]
    if len(set(random_walk)) > 1:
        mean_variance = float(np.mean(noise))
        mean_random_walk = math.sqrt(mean_variance)
    correlation = _correlation(covariance, bias, fused_bias)
    bias_sigma = np.sqrt(bias)
    walk_density = np.sqrt(walk)
    return RelativeErrors(
        random_walk=mean_random_walk,
        axis_random_walks=tuple(random_walk),
        bias=_per_axis(bias_sigma),
        walk=_per_axis(walk_density),
        correlation=_per_axis(correlation),
    )


def _correlation(covariance: Floats, variance: Floats, other_variance: Floats) -> Floats:
    """Return a correlation by axis (3,), 0 without a bias or if it is a rounding error between equal IMUs.

    Parameters
    ----------
    covariance : (3,)
        Covariance of two biases.
    variance, other_variance : (3,)
        Their variances.
    """
    scale = np.sqrt(variance * other_variance)
    is_above_rounding = np.abs(covariance) > 1e-12 * scale
    is_correlated = (scale > 0.0) & is_above_rounding
    no_correlation = np.zeros(3)
    return np.divide(covariance, scale, out=no_correlation, where=is_correlated)


def _per_axis(values: Floats) -> PerAxis:
    """Return three values as one number if they are equal, otherwise by axis."""
    x, y, z = values.tolist()
    return x if x == y == z else (x, y, z)
