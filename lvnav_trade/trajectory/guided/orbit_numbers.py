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
    elements = elements_from_state(y[:, :3], y[:, 3:6])
    a, e = elements.semi_major_axis, elements.eccentricity
    perigee = a * (1.0 - e) - SEMI_MAJOR
    apogee = a * (1.0 + e) - SEMI_MAJOR
    along_node = e * np.cos(elements.perigee_argument)
    ahead_of_node = e * np.sin(elements.perigee_argument)
    orbit = [a, perigee, apogee, along_node, ahead_of_node, elements.inclination, elements.node]
    return np.stack(orbit, axis=1)


def orbit_difference(first: Floats, second: Floats) -> Floats:
    """Return numbers of orbits (n, n_orbit) less others, angles of the node the short way round."""
    difference = first - second
    difference[:, NODE] = np.remainder(difference[:, NODE] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(difference)


def with_apsides(change: Floats, target: Floats) -> Floats:
    """Return small changes (n, n_orbit or more) of an orbit with those of perigee and apogee as they follow from axis
    and eccentricity vector; NaN of a circular orbit, which has no derivative of them.

    target : (n_orbit,). The orbit that is changed.
    """
    complete = change.copy()
    eccentricity_vector = target[VECTOR]
    e = float(np.linalg.norm(eccentricity_vector))
    a, a_change = target[AXIS], complete[:, AXIS]
    if e > CIRCULAR:
        e_change = complete[:, VECTOR] @ eccentricity_vector / e
    else:
        e_change = np.full(len(complete), np.nan)
    complete[:, PERIGEE] = a_change * (1.0 - e) - a * e_change
    complete[:, APOGEE] = a_change * (1.0 + e) + a * e_change
    return np.asarray(complete)
