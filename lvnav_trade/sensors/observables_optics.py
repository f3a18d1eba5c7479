"""Geometry of optical sensors: axes along a boresight, angles to the Sun and to the limb of the Earth."""

import math
from collections.abc import Iterator

import numpy as np

from lvnav_trade.quantities.frames import quaternions, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.sensors.sensor import FlightView

Direction = tuple[float, float, float]


def axes_of(boresight: Direction) -> Floats:
    """Return the quaternion (4,) from sensor axes to body axes: z along the boresight, x and y across it."""
    z = unit(np.array(boresight))
    x = unit(np.cross(np.eye(3)[np.argmin(np.abs(z))], z))
    return np.asarray(quaternions(np.stack([x, np.cross(z, x), z], axis=-1)[None])[0])


def no_direction(boresight: Direction) -> Iterator[str]:
    """Yield the input error of a boresight (3,), body axes, of zero or infinite length."""
    if not 0.0 < math.hypot(*boresight) < math.inf:
        yield f"boresight {boresight} has no direction"


def angle(a: Floats, b: Floats) -> Floats:
    """Return the angle (n,) rad between unit vectors (n, 3)."""
    return np.asarray(np.arccos(np.clip(np.sum(a * b, axis=1), -1.0, 1.0)))


def earth_disc(flight: FlightView) -> tuple[Floats, Floats]:
    """Return direction of the Earth's centre (n, 3), frame i, and angular radius (n,) rad of the Earth from a vehicle.

    The Earth is approximated by a sphere through the point below the vehicle.
    """
    distance = np.linalg.norm(flight.r_i, axis=1)
    return -flight.r_i / distance[:, None], np.arcsin(np.clip(1.0 - flight.height / distance, 0.0, 1.0))
