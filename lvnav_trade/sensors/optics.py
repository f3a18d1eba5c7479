"""Geometry of optical sensors: axes along a boresight, direction of the Sun, limb of the Earth."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import numpy as np

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import gmst, quaternions, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.sensors.sensor import FlightView

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)


def sun_direction(epoch: str, t: Floats, theta: Floats) -> Floats:
    """Return geocentric unit vectors to the Sun (n, 3), frame i.

    Mean equator of date. The x axis of frame i need not be the equinox: the Earth angle relates it to Greenwich.

    epoch : ISO 8601 time, UTC.
    t : (n,) s after the epoch.
    theta : (n,) rad. Earth angles at these times.
    """
    start = datetime.fromisoformat(epoch)
    start = start.replace(tzinfo=UTC) if start.tzinfo is None else start.astimezone(UTC)
    days = ((start - _J2000) / timedelta(days=1)) + t / 86400.0
    longitude, anomaly = 280.460 + 0.9856474 * days, np.radians(357.528 + 0.9856003 * days)
    ecliptic = np.radians(longitude + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly))
    obliquity = np.radians(23.439 - 4e-7 * days)
    declination = np.arcsin(np.sin(obliquity) * np.sin(ecliptic))
    # right ascension minus sidereal time is the angle from Greenwich, whose meridian is at theta in frame i
    angle = np.arctan2(np.cos(obliquity) * np.sin(ecliptic), np.cos(ecliptic)) - (gmst(epoch) + OMEGA * t) + theta
    across = np.cos(declination)
    return np.stack([across * np.cos(angle), across * np.sin(angle), np.sin(declination)], axis=-1)


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
