"""Envelopes of angular acceleration and jerk by phase, and how a filter that assumes them weights a measurement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.filters.base import EnvelopeCard

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Envelopes(NamedTuple):
    """Standard deviations (n, 3) of angular acceleration (rad/s^2: roll, pitch, yaw) and jerk (m/s^3: x, y, z)."""

    turning: Floats
    jerk: Floats


def changing(card: EnvelopeCard, t: Floats, changes: Floats) -> Flags:
    """Return whether each time (n,) lies within the window around a change of phase (k,), s."""
    begin = np.searchsorted(changes, t - card.after_change, side="left")
    end = np.searchsorted(changes, t + card.before_change, side="right")
    return np.asarray(end > begin)


def envelopes(
    card: EnvelopeCard, t: Floats, burning: Flags, changes: Floats, commanded_rate: Floats, nozzle_command: Floats
) -> Envelopes:
    """Return the envelopes on even ticks t (n,) from commanded rate (n, 2) rad/s and nozzle angles (n, 2), pitch, yaw.

    Derivatives are finite differences to the tick before, with the nozzle centred before the first; what is commanded
    at a tick counts from the next one on. A phase that is changing is no coast: the air and the next motor may already
    turn the vehicle.
    """
    dt = float(t[1] - t[0])
    turning, jerk = np.empty((t.size, 3)), np.empty((t.size, 3))
    change = changing(card, t, changes)
    unknown = np.asarray(np.where(burning | change, card.burn, card.coast))
    turns = card.turn_gain * _slope(commanded_rate, commanded_rate[:1], dt)
    pushes = card.nozzle_gain * _slope(nozzle_command, np.zeros((1, 2)), dt)
    turning[:, 0] = card.roll
    turning[:, 1:] = np.abs(_lagged(turns, card.turn_time, dt)) + unknown[:, np.newaxis]
    pushed = np.abs(_lagged(pushes, card.nozzle_time, dt)) + card.lateral
    jerk[:, 1], jerk[:, 2] = pushed[:, 1], pushed[:, 0]
    jerk[:, 0] = np.where(burning, card.axial_burn, card.axial_coast)
    jerk[change, 0] = card.axial_change
    return Envelopes(turning, jerk)


def _slope(value: Floats, before: Floats, dt: float) -> Floats:
    """Return the finite difference (n, k) to the tick before, the first to the values (1, k) before."""
    return np.diff(value, axis=0, prepend=before) / dt


def _lagged(drive: Floats, time_constant: float, dt: float) -> Floats:
    """Return the first-order lag (n, k) of a drive that is held over each tick; it starts at zero."""
    from scipy.signal import lfilter  # with it comes scipy.stats: 30 MiB and 0.5 s of every worker, for few filters

    factor = math.exp(-dt / time_constant)
    return np.asarray(lfilter([0.0, 1.0 - factor], [1.0, -factor], drive, axis=0))


def steady_ratio(driving: float, noise: float) -> float:
    """Return the steady variance of a scalar random walk after a measurement, over the variance of a measurement.

    `driving` is the variance of a step, `noise` that of a measurement: (-x + sqrt(x^2 + 4 x)) / 2 with x their ratio.
    It is the steady gain too.
    """
    x = driving / noise
    return 0.5 * (math.sqrt(x * x + 4.0 * x) - x)
