"""Contradictions within a user's file: how large a residual may be for an inertial unit, and the refusal beyond."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from lvnav_trade.errors import InputError
from lvnav_trade.world.sensors.imu import ImuCard

ALLOWED = 0.1  # of the unit's one-sigma growth
SHORTEST = 10.0  # s; a shorter interval counts as one of this length, rows know no better
_ROUNDINGS = 5.0  # sigmas of a row's noise by which the worst of thousands may be off without meaning anything
_SHOWN = {  # unit in messages, SI units to it, and what contradicts what
    "position": ("m", 1.0, "its velocity, integrated, and its position part"),
    "velocity": ("m/s", 1.0, "the spline and its velocity part"),
    "attitude": ("deg", 180.0 / math.pi, "the spline and its attitude part"),
}
PRECISION = {"position": 1e-6, "velocity": 1e-8, "attitude": 1e-9}
"""What rounding of doubles and of the spline's equations leaves of rows that agree: m, m/s, rad."""


class Residual(NamedTuple):
    """The worst contradiction of one stretch between events.

    what: position (integrated velocity minus rows, since the first row of the stretch), velocity or attitude (truth
    minus rows). start, end s of the stretch, time s of the worst row, size of the vector there (m, m/s, rad), noise one
    sigma of a component of a row.
    """

    what: str
    start: float
    end: float
    time: float
    size: float
    noise: float


def growth(imu: ImuCard, what: str, interval: float) -> float:
    """Return one sigma per axis of what an inertial unit alone adds to an error over an interval (s), SI.

    White noise of density n and a constant bias b (repeatability and instability) of the sensor that integrates into
    it: attitude and velocity n^2 T + (b T)^2, position n^2 T^3 / 3 + (b T^2 / 2)^2. What else the card holds would only
    widen it.
    """
    sensor = imu.gyro if what == "attitude" else imu.accel
    bias = math.hypot(sensor.bias_repeatability, sensor.instability_sigma)
    if what == "position":
        return math.hypot(sensor.random_walk * math.sqrt(interval**3 / 3.0), 0.5 * bias * interval**2)
    return math.hypot(sensor.random_walk * math.sqrt(interval), bias * interval)


def limit(residual: Residual, imu: ImuCard) -> float:
    """Return the size (SI) up to which a residual is allowed: a tenth of the growth, and what the rows' noise makes;
    rounding in any case, which is all that there is with an ideal unit.
    """
    interval = max(residual.end - residual.start, SHORTEST)
    return max(ALLOWED * growth(imu, residual.what, interval) + _ROUNDINGS * residual.noise, PRECISION[residual.what])


def require_consistent(residuals: Sequence[Residual], imu: ImuCard, file: str, missing: str = "") -> None:
    """InputError with place and size of the worst residual, where one is beyond its limit for this unit; missing: what
    is said of events that the card does not declare.
    """
    beyond = [one for one in residuals if one.size > limit(one, imu)]
    if not beyond:
        return
    worst = max(beyond, key=lambda one: one.size / limit(one, imu))
    unit, factor, text = _SHOWN[worst.what]
    raise InputError(
        f"{file}: {text} by {worst.size * factor:.3g} {unit} at {worst.time:.9g} s (from {worst.start:.9g} s on); "
        f"allowed are {limit(worst, imu) * factor:.3g} {unit}, {ALLOWED:g} of what {imu.name!r} drifts from "
        f"{worst.start:.9g} to {worst.end:.9g} s, and rounding: is an event missing, a frame or unit wrong, does the "
        f"reference point move?{added(missing)}"
    )


def added(missing: str) -> str:
    """Return what is said of missing events as the end of a message."""
    return f" {missing}" if missing else ""
