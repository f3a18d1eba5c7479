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
    """Return geocentric unit vectors to the Sun.

    They refer to the mean equator of date. The x axis of frame i need not be the equinox: the Earth angle relates it to
    Greenwich.

    Parameters
    ----------
    epoch : str
        ISO 8601 time, UTC.
    t : (n,) s
        Times after the epoch.
    theta : (n,) rad
        Earth angles at these times.

    Returns
    -------
    (n, 3)
        Unit vectors, frame i.
    """
    start = datetime.fromisoformat(epoch)
    start = start.replace(tzinfo=UTC) if start.tzinfo is None else start.astimezone(UTC)
    days_to_start = (start - _J2000) / timedelta(days=1)
    days = days_to_start + t / 86400.0
    mean_longitude = 280.460 + 0.9856474 * days  # deg
    anomaly = np.radians(357.528 + 0.9856003 * days)
    longitude_deg = mean_longitude + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2.0 * anomaly)
    longitude = np.radians(longitude_deg)
    obliquity = np.radians(23.439 - 4e-7 * days)
    sin_longitude = np.sin(longitude)
    sin_declination = np.sin(obliquity) * sin_longitude
    declination = np.arcsin(sin_declination)
    right_ascension = np.arctan2(np.cos(obliquity) * sin_longitude, np.cos(longitude))
    sidereal_time = gmst(epoch) + OMEGA * t
    # right ascension minus sidereal time is the angle from Greenwich, whose meridian is at theta in frame i
    angle = right_ascension - sidereal_time + theta
    equatorial_component = np.cos(declination)
    x = equatorial_component * np.cos(angle)
    y = equatorial_component * np.sin(angle)
    z = np.sin(declination)
    return np.stack([x, y, z], axis=-1)


Direction = tuple[float, float, float]


def boresight_quaternion(boresight: Direction) -> Floats:
    """Return the quaternion (4,) from sensor axes to body axes: z along the boresight, x and y across it."""
    z = unit(np.array(boresight))
    farthest_axis = np.eye(3)[np.argmin(np.abs(z))]
    x = unit(np.cross(farthest_axis, z))
    y = np.cross(z, x)
    axes = np.stack([x, y, z], axis=-1)
    return np.asarray(quaternions(axes[None])[0])


def boresight_faults(boresight: Direction) -> Iterator[str]:
    """Yield the input error of a boresight (3,), body axes, of zero or infinite length."""
    if not 0.0 < math.hypot(*boresight) < math.inf:
        yield f"boresight {boresight} has no direction"


def angle(a: Floats, b: Floats) -> Floats:
    """Return the angle (n,) rad between unit vectors (n, 3)."""
    cosine = np.sum(a * b, axis=1)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def earth_disc(flight: FlightView) -> tuple[Floats, Floats]:
    """Return direction of the Earth's centre (n, 3), frame i, and angular radius (n,) rad of the Earth from a vehicle.

    The Earth is approximated by a sphere through the point below the vehicle.
    """
    distance = np.linalg.norm(flight.r_i, axis=1)
    down = -flight.r_i / distance[:, None]
    sine = 1.0 - flight.height / distance  # radius of the sphere over distance
    return down, np.arcsin(np.clip(sine, 0.0, 1.0))
