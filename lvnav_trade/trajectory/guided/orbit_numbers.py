"""Numbers of the orbit that a guided ascent reaches, and their differences."""

import numpy as np

from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.quantities.frames import elements_from_state
from lvnav_trade.quantities.records import ORBIT, Floats

CIRCULAR = 1e-4
"""Eccentricity below which perigee and apogee have no derivative worth the name: 0.7 km of either height."""
AXIS, PERIGEE, APOGEE = (ORBIT.index(name) for name in ("semi_major_axis", "perigee", "apogee"))
VECTOR = [ORBIT.index(name) for name in ("eccentricity_along_node", "eccentricity_ahead_of_node")]
NODE = ORBIT.index("node")


def orbit_of(y: Floats) -> Floats:
    """Return the numbers of `ORBIT` of the osculating orbits of states y (n, 6 or more), (n, n_orbit)."""
    at = elements_from_state(y[:, :3], y[:, 3:6])
    a, e = at.semi_major_axis, at.eccentricity
    low, high = a * (1.0 - e) - SEMI_MAJOR, a * (1.0 + e) - SEMI_MAJOR
    turn = at.perigee_argument
    return np.stack([a, low, high, e * np.cos(turn), e * np.sin(turn), at.inclination, at.node], axis=1)


def orbit_difference(first: Floats, other: Floats) -> Floats:
    """Return numbers of orbits (n, n_orbit) less others, angles of the node the short way round."""
    found = first - other
    found[:, NODE] = np.remainder(found[:, NODE] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(found)


def with_apsides(change: Floats, target: Floats) -> Floats:
    """Return small changes (n, n_orbit or more) of an orbit with those of perigee and apogee as they follow from axis
    and eccentricity vector; NaN of a circular orbit, which has no derivative of them.

    target : (n_orbit,). The orbit that is changed.
    """
    found, vector = change.copy(), target[VECTOR]
    e = float(np.linalg.norm(vector))
    a, longer = target[AXIS], found[:, AXIS]
    stretched = found[:, VECTOR] @ vector / e if e > CIRCULAR else np.full(len(found), np.nan)
    found[:, PERIGEE] = longer * (1.0 - e) - a * stretched
    found[:, APOGEE] = longer * (1.0 + e) + a * stretched
    return np.asarray(found)
