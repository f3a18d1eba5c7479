"""Difference of two IMUs of a set: columns by which errors enter it, and its one-sigma."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.per_axis import PerAxis, rms, squares
from lvnav_trade.records import Floats
from lvnav_trade.world.sensors.units import ImuSet, least_squares, triads_of


def difference(imu: ImuSet, first: int, second: int) -> list[Floats]:
    """Return for every triad how errors of its axes enter the measurement of one unit minus that of another.

    Columns (2, 3, 3), of gyro and of accelerometer; each unit is fused by its own least squares. first, second : units,
    from 0.
    """
    found, seen = [np.zeros((2, 3, 3)) for _ in triads_of(imu)], [0] * len(imu.units)
    own = {
        n: (sign, least_squares(d := imu.units[n].directions, np.ones(len(d))))
        for n, sign in ((first, 1.0), (second, -1.0))
    }
    for number, triad in enumerate(triads_of(imu)):
        if triad.unit in own:
            sign, A = own[triad.unit]
            here = slice(seen[triad.unit], seen[triad.unit] + triad.n_axis)
            found[number][:, :, : triad.n_axis] = sign * A[:, here]
            seen[triad.unit] += triad.n_axis
    return found


class RelativeErrors(NamedTuple):
    """One-sigma of what two units of a set differ by: mean over the axes, or of each where those of a unit differ.

    random_walk : rad/sqrt(s) or m/s/sqrt(s). Root PSD of the white noise, mean over the axes.
    by_axis : (3,). The same of each body axis.
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
    """Return what the gyros or accelerometers of two units (numbers from 0) differ by."""
    noise, bias, walk, shared, own, biases_alike = *np.zeros((5, 3)), True
    for triad, columns in zip(triads_of(imu), difference(imu, first, second), strict=True):
        unit, D, A = imu.units[triad.unit], columns[sensor], (triad.gyro, triad.accel)[sensor]
        card = (unit.gyro, unit.accel)[sensor]
        flicker = np.array(squares(card.instability_axes(card.instability_sigma)))
        lasting = np.array(squares(card.bias_repeatability)) + flicker
        drift = np.array(squares(card.rate_random_walk)) + flicker * 2.0 / card.instability.time_constant
        bias, walk = bias + D**2 @ lasting, walk + D**2 @ drift
        shared, own = shared + (D * A) @ lasting, own + A**2 @ lasting
        biases_alike &= not any(
            isinstance(one, tuple) for one in (card.bias_repeatability, card.bias_instability, card.rate_random_walk)
        )
        # of axes alike the mean over those of the body
        size, alike = float(np.sum(D**2)) / 3.0, not isinstance(card.random_walk, tuple)
        noise = noise + (rms(card.random_walk) ** 2 * size if alike else D**2 @ squares(card.random_walk))
    if biases_alike:
        bias, walk, shared, own = (np.full(3, np.mean(one)) for one in (bias, walk, shared, own))
    both = np.sqrt(bias * own)
    # one between like units is rounding; two units without a bias differ by none
    correlated = (both > 0.0) & (np.abs(shared) > 1e-12 * both)
    correlation = np.divide(shared, both, out=np.zeros(3), where=correlated)
    by_axis = tuple(np.sqrt(noise).tolist())
    mean = by_axis[0] if len(set(by_axis)) == 1 else math.sqrt(float(np.mean(noise)))
    return RelativeErrors(mean, by_axis, _of_axes(np.sqrt(bias)), _of_axes(np.sqrt(walk)), _of_axes(correlation))


def _of_axes(values: Floats) -> PerAxis:
    x, y, z = values.tolist()
    return x if x == y == z else (x, y, z)
