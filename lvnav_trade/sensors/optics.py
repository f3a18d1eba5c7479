"""Direction of the Sun, to a hundredth of a degree: the low-precision formula of the Astronomical Almanac."""

from datetime import UTC, datetime, timedelta

import numpy as np

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import gmst
from lvnav_trade.quantities.records import Floats

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
