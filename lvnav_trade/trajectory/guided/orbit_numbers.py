"""Numbers of the orbit that a guided ascent reaches, and their differences."""

import numpy as np

from lvnav_trade.kernels.earth import SEMI_MAJOR
from lvnav_trade.quantities.frames import elements_from_state
from lvnav_trade.quantities.records import ORBIT, Floats
from lvnav_trade.trajectory.guided.piece_derivatives import MOTION_STEPS

CIRCULAR = 1e-4
"""Eccentricity below which perigee and apogee have no derivative worth the name: 0.7 km of either height."""
AXIS, PERIGEE, APOGEE = (ORBIT.index(name) for name in ("semi_major_axis", "perigee", "apogee"))
VECTOR = [ORBIT.index(name) for name in ("eccentricity_along_node", "eccentricity_ahead_of_node")]
NODE = ORBIT.index("node")


def osculating_orbit(y: Floats) -> Floats:
    """Return the numbers of `ORBIT` of the osculating orbits of states y (n, 6 or more), (n, n_orbit)."""
    elements = elements_from_state(y[:, :3], y[:, 3:6])
    a, e = elements.semi_major_axis, elements.eccentricity
    argument = elements.perigee_argument
    perigee = a * (1.0 - e) - SEMI_MAJOR
    apogee = a * (1.0 + e) - SEMI_MAJOR
    along_node = e * np.cos(argument)
    ahead_of_node = e * np.sin(argument)
    orbit = [
        a,
        perigee,
        apogee,
        along_node,
        ahead_of_node,
        elements.inclination,
        elements.node,
    ]
    return np.stack(orbit, axis=1)


def orbit_difference(first: Floats, second: Floats) -> Floats:
    """Return numbers of orbits (n, n_orbit) less others, angles of the node the short way round."""
    difference = first - second
    from_half_turn = difference[:, NODE] + np.pi
    difference[:, NODE] = np.remainder(from_half_turn, 2.0 * np.pi) - np.pi
    return np.asarray(difference)


def append_apsides(change: Floats, target: Floats) -> Floats:
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


def orbit_derivative(y: Floats, target: Floats) -> Floats:
    """Return the derivative (n_orbit, 6) of an orbit by position and velocity."""
    steps = MOTION_STEPS[:6]
    moves = np.diag(steps)
    high = osculating_orbit(y[:6] + moves)
    low = osculating_orbit(y[:6] - moves)
    change = append_apsides(orbit_difference(high, low), target)
    derivative = change / (2.0 * steps[:, None])
    return np.asarray(derivative.T)
