"""Axes of J2000 to axes of date: precession and nutation from a standard epoch to the day of a lift-off.

Precession IAU 1976 (Lieske et al., A&A 58, 1977), the twenty largest terms of nutation IAU 1980 (Seidelmann, Celestial
Mechanics 27, 1982) and the equation of the equinoxes. The omitted terms amount to 0.006 arcsec RMS; IAU 2006/2000A and
the frames GCRF and ICRF differ from it by 0.1 arcsec until 2035, which is 3 m on the ground.
"""

import math
from datetime import UTC, datetime, timedelta

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import leap_seconds

_ARCSEC = math.pi / 648000.0
_TT_AHEAD = 51.184  # s: TT minus GPS time
# Multiples of the arguments l, l', F, D, Omega; sine of longitude and cosine of obliquity at J2000 and their changes in
# a century, 0.1 mas.
_NUTATION = (
    (0, 0, 0, 0, 1, -171996.0, -174.2, 92025.0, 8.9),
    (0, 0, 0, 0, 2, 2062.0, 0.2, -895.0, 0.5),
    (-2, 0, 2, 0, 1, 46.0, 0.0, -24.0, 0.0),
    (0, 0, 2, -2, 2, -13187.0, -1.6, 5736.0, -3.1),
    (0, 1, 0, 0, 0, 1426.0, -3.4, 54.0, -0.1),
    (0, 1, 2, -2, 2, -517.0, 1.2, 224.0, -0.6),
    (0, -1, 2, -2, 2, 217.0, -0.5, -95.0, 0.3),
    (0, 0, 2, -2, 1, 129.0, 0.1, -70.0, 0.0),
    (2, 0, 0, -2, 0, 48.0, 0.0, 1.0, 0.0),
    (0, 0, 2, 0, 2, -2274.0, -0.2, 977.0, -0.5),
    (1, 0, 0, 0, 0, 712.0, 0.1, -7.0, 0.0),
    (0, 0, 2, 0, 1, -386.0, -0.4, 200.0, 0.0),
    (1, 0, 2, 0, 2, -301.0, 0.0, 129.0, -0.1),
    (1, 0, 0, -2, 0, -158.0, 0.0, -1.0, 0.0),
    (-1, 0, 2, 0, 2, 123.0, 0.0, -53.0, 0.0),
    (0, 0, 0, 2, 0, 63.0, 0.0, -2.0, 0.0),
    (1, 0, 0, 0, 1, 63.0, 0.1, -33.0, 0.0),
    (-1, 0, 0, 0, 1, -58.0, -0.1, 32.0, 0.0),
    (-1, 0, 2, 2, 2, -59.0, 0.0, 26.0, 0.0),
    (1, 0, 2, 0, 1, -51.0, 0.0, 27.0, 0.0),
)
# l, l', F, D, Omega in arcsec at J2000 and their changes in a century, with its square and cube
_ARGUMENTS = (
    (485866.733, 1717915922.633, 31.310, 0.064),
    (1287099.804, 129596581.224, -0.577, -0.012),
    (335778.877, 1739527263.137, -13.257, 0.011),
    (1072261.307, 1602961601.328, -6.891, 0.019),
    (450160.280, -6962890.539, 7.455, 0.008),
)


def rotation_to_date(epoch: str) -> Floats:
    """Return the matrix (3, 3) from components along axes of J2000 (EME2000) to those along the true equator and mean
    equinox of the date of an epoch (ISO 8601, UTC).

    Those are the axes that Greenwich mean sidereal time counts from, frame i at its angle (and TEME).
    """
    t = _centuries(epoch)
    longitude, obliquity, node = _nutation(t)
    obliquity_decrease = (46.8150 + (0.00059 - 0.001813 * t) * t) * t
    mean_obliquity = (84381.448 - obliquity_decrease) * _ARCSEC
    to_true_equator = _about_x(-mean_obliquity - obliquity)
    to_ecliptic = _about_x(mean_obliquity)
    nutation = to_true_equator @ _about_z(-longitude) @ to_ecliptic
    # Equation of the equinoxes, from the true to the mean equinox
    node_terms = 0.00264 * math.sin(node) + 0.000063 * math.sin(2.0 * node)
    equinoxes = longitude * math.cos(mean_obliquity) + node_terms * _ARCSEC
    to_mean_equinox = _about_z(equinoxes)
    return np.asarray(to_mean_equinox @ nutation @ _precession(t))


def _precession(t: float) -> Floats:
    """Return the precession (3, 3) from J2000 to t centuries after it (Lieske 1977)."""
    zeta_arcsec = (2306.2181 + (0.30188 + 0.017998 * t) * t) * t
    z_arcsec = (2306.2181 + (1.09468 + 0.018203 * t) * t) * t
    theta_arcsec = (2004.3109 - (0.42665 + 0.041833 * t) * t) * t
    zeta = zeta_arcsec * _ARCSEC
    z = z_arcsec * _ARCSEC
    theta = theta_arcsec * _ARCSEC
    return np.asarray(_about_z(-z) @ _about_y(theta) @ _about_z(-zeta))


def _centuries(epoch: str) -> float:
    """Return the terrestrial time of an epoch (ISO 8601, UTC) in centuries after J2000."""
    moment = datetime.fromisoformat(epoch)
    utc = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    ahead_of_utc = timedelta(seconds=leap_seconds(utc) + _TT_AHEAD)
    terrestrial = utc + ahead_of_utc
    j2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
    century = timedelta(days=36525)
    return (terrestrial - j2000) / century


def _nutation(t: float) -> tuple[float, float, float]:
    """Return nutation in longitude and obliquity and the Moon's node (rad), t centuries after J2000."""
    arguments = []
    for a, b, c, d in _ARGUMENTS:
        arcsec = a + (b + (c + d * t) * t) * t
        arguments.append(math.fmod(arcsec, 1296000.0) * _ARCSEC)
    longitude = 0.0
    obliquity = 0.0
    for *multiples, sine, sine_rate, cosine, cosine_rate in _NUTATION:
        angle = sum(multiple * argument for multiple, argument in zip(multiples, arguments, strict=True))
        longitude_amplitude = sine + sine_rate * t
        obliquity_amplitude = cosine + cosine_rate * t
        longitude += longitude_amplitude * math.sin(angle) * 1e-4 * _ARCSEC
        obliquity += obliquity_amplitude * math.cos(angle) * 1e-4 * _ARCSEC
    return longitude, obliquity, arguments[4]


def _about_x(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, c, s],
            [0.0, -s, c],
        ]
    )


def _about_y(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [
            [c, 0.0, -s],
            [0.0, 1.0, 0.0],
            [s, 0.0, c],
        ]
    )


def _about_z(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [
            [c, s, 0.0],
            [-s, c, 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
