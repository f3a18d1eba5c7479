"""Contradictions within a user's file: largest residuals allowed for an IMU, and the refusal of larger residuals."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError

ALLOWED = 0.1  # of the one-sigma error growth of the IMU
SHORTEST = 10.0  # s; shorter intervals count as this long, because rows are not more accurate
_ROUNDINGS = 5.0  # sigmas of a row's noise that the worst of thousands of rows may reach by chance
_SHOWN = {  # unit in messages, SI units to it, and what contradicts what
    "position": ("m", 1.0, "its velocity, integrated, and its position part"),
    "velocity": ("m/s", 1.0, "the spline and its velocity part"),
    "attitude": ("deg", 180.0 / math.pi, "the spline and its attitude part"),
}
PRECISION = {"position": 1e-6, "velocity": 1e-8, "attitude": 1e-9}
"""Rounding errors of consistent rows after the spline fit: m, m/s, rad."""


class Residual(NamedTuple):
    """The worst contradiction of a part between events.

    quantity : "position" (integrated velocity minus rows since the first row of the part), "velocity" or "attitude"
        (truth minus rows).
    start, end : s. The part.
    time : s. The worst row.
    size : m, m/s or rad. Length of the residual vector there.
    noise : m, m/s or rad. One sigma of a component of a row.
    """

    quantity: str
    start: float
    end: float
    time: float
    size: float
    noise: float


def error_growth(imu: ImuCard, quantity: str, interval: float) -> float:
    """Return one sigma per axis of the error growth due to an IMU over an interval, SI.

    Parameters
    ----------
    imu : ImuCard
    quantity : {"position", "velocity", "attitude"}
    interval : float
        T (s).

    Notes
    -----
    For white noise with root PSD n and a constant bias b (repeatability and instability) of the sensor, the variance is
    n^2 T + (b T)^2 for attitude and velocity, n^2 T^3 / 3 + (b T^2 / 2)^2 for position. Other errors are neglected.
    """
    sensor = imu.gyro if quantity == "attitude" else imu.accel
    bias = math.hypot(sensor.bias_repeatability, sensor.instability_sigma)
    if quantity == "position":
        noise_growth = sensor.random_walk * math.sqrt(interval**3 / 3.0)
        bias_growth = 0.5 * bias * interval**2
        return math.hypot(noise_growth, bias_growth)
    noise_growth = sensor.random_walk * math.sqrt(interval)
    bias_growth = bias * interval
    return math.hypot(noise_growth, bias_growth)


def residual_limit(residual: Residual, imu: ImuCard) -> float:
    """Return the largest allowed residual (SI): a tenth of the error growth plus the effect of the rows' noise.

    Rounding errors are always allowed, also for an ideal IMU.
    """
    interval = max(residual.end - residual.start, SHORTEST)
    drift_limit = ALLOWED * error_growth(imu, residual.quantity, interval)
    limit = drift_limit + _ROUNDINGS * residual.noise
    return max(limit, PRECISION[residual.quantity])


def require_consistent(residuals: Sequence[Residual], imu: ImuCard, file: str, event_warning: str = "") -> None:
    """Require that the residuals of a file are within their limits for an IMU.

    Parameters
    ----------
    residuals : sequence of Residual
        Residuals of position, velocity and attitude.
    imu : ImuCard
        IMU, whose error growth determines the limits (see `residual_limit`).
    file : str
        Name of the file, for the message.
    event_warning : str
        Warning about events that the card does not declare, for the end of the message.

    Raises
    ------
    InputError
        A residual exceeds its limit. The message has time and size of the worst residual.
    """
    excessive = [residual for residual in residuals if residual.size > residual_limit(residual, imu)]
    if not excessive:
        return
    worst = max(excessive, key=lambda residual: residual.size / residual_limit(residual, imu))
    unit, factor, text = _SHOWN[worst.quantity]
    raise InputError(
        f"{file}: {text} by {worst.size * factor:.3g} {unit} at {worst.time:.9g} s (from {worst.start:.9g} s on); "
        f"allowed are {residual_limit(worst, imu) * factor:.3g} {unit}, {ALLOWED:g} of what {imu.name!r} drifts from "
        f"{worst.start:.9g} to {worst.end:.9g} s, and rounding: is an event missing, a frame or unit wrong, does the "
        f"reference point move?{message_suffix(event_warning)}"
    )


def message_suffix(event_warning: str) -> str:
    """Return a warning about missing events as the end of a message."""
    return f" {event_warning}" if event_warning else ""
