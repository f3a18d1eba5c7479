"""Osculating and mean orbits.

J2 changes osculating elements by some 10 km along a low orbit. Perigee and apogee are therefore those of the mean
orbit: the average over one revolution of energy, angular momentum and eccentricity vector, to first order in J2, with
the drift over the revolution removed. Vectors are regular for circular and equatorial orbits; angles are computed last.
(Kozai, Astronomical Journal 64, 1959, has the classical elements, which are singular for both.)
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import GM, J2, SEMI_MAJOR
from lvnav_trade.quantities.frames import unit
from lvnav_trade.quantities.records import Bools, Floats

# Above it the quadrature over a revolution loses digits; such orbits reach the ground within the revolution.
MOST_ECCENTRIC = 0.9
# Number of nodes of the quadrature up to an eccentricity; the next larger number changes a variation by less than 1e-12
# of it.
_NODE_COUNTS = {0.1: 24, 0.5: 40, 1.0: 64}


class OrbitVectors(NamedTuple):
    """Orbits by their vector elements.

    energy : (...,), J/kg. Specific orbital energy.
    h_i : (..., 3), m^2/s. Specific angular momentum, frame i.
    e_i : (..., 3). Eccentricity vector towards the perigee, frame i.
    """

    energy: Floats
    h_i: Floats
    e_i: Floats

    @property
    def semi_major_axis(self) -> Floats:
        """Semi-major axis in m; negative for a hyperbola."""
        return np.asarray(-0.5 * GM / self.energy)

    @property
    def eccentricity(self) -> Floats:
        """Length of the eccentricity vector."""
        return np.asarray(np.linalg.norm(self.e_i, axis=-1))

    @property
    def perigee(self) -> Floats:
        """Height of the perigee in m above the equatorial radius, a (1 - e) - 6378137."""
        return np.asarray(self.semi_major_axis * (1.0 - self.eccentricity) - SEMI_MAJOR)

    @property
    def apogee(self) -> Floats:
        """Height of the apogee in m above the equatorial radius."""
        return np.asarray(self.semi_major_axis * (1.0 + self.eccentricity) - SEMI_MAJOR)

    @property
    def inclination(self) -> Floats:
        """Inclination in rad."""
        horizontal = np.hypot(self.h_i[..., 0], self.h_i[..., 1])
        return np.asarray(np.arctan2(horizontal, self.h_i[..., 2]))

    @property
    def node(self) -> Floats:
        """Right ascension of the ascending node in rad, [0, 2 pi), against the inertial x axis."""
        angle = np.arctan2(self.h_i[..., 0], -self.h_i[..., 1])
        return np.mod(angle, 2.0 * np.pi)

    @property
    def elliptic(self) -> Bools:
        """Whether the orbit is an ellipse that is not too eccentric to be averaged."""
        return np.asarray((self.energy < 0.0) & (self.eccentricity < MOST_ECCENTRIC))


def osculating(r_i: ArrayLike, v_i: ArrayLike) -> OrbitVectors:
    """Return the orbits that states would follow about a point mass.

    Parameters
    ----------
    r_i, v_i : (..., 3) array
        Position (m) and velocity (m/s), frame i.

    Returns
    -------
    OrbitVectors
        Specific energy, specific angular momentum and eccentricity vector, frame i.
    """
    r_i = np.asarray(r_i, dtype=float)
    v_i = np.asarray(v_i, dtype=float)
    r = np.linalg.norm(r_i, axis=-1)
    h_i = np.cross(r_i, v_i)
    return OrbitVectors(
        energy=0.5 * np.sum(v_i * v_i, axis=-1) - GM / r,
        h_i=h_i,
        e_i=np.cross(v_i, h_i) / GM - r_i / r[..., None],
    )


def mean(r_i: ArrayLike, v_i: ArrayLike) -> OrbitVectors:
    """Return mean orbits: averaged over one revolution, to first order in J2.

    Parameters
    ----------
    r_i, v_i : (..., 3) array
        Position (m) and velocity (m/s), frame i.

    Returns
    -------
    OrbitVectors
        Mean orbits; NaN where `OrbitVectors.elliptic` is false.
    """
    orbit = osculating(r_i, v_i)
    variation = _short_periodic(orbit, np.asarray(r_i, dtype=float))
    return OrbitVectors(
        energy=orbit.energy - variation.energy,
        h_i=orbit.h_i - variation.h_i,
        e_i=orbit.e_i - variation.e_i,
    )


def extremes(r_i: ArrayLike, v_i: ArrayLike, points: int = 180) -> tuple[Floats, Floats]:
    """Return the lowest and the highest altitude over the revolution that begins at a state.

    Parameters
    ----------
    r_i, v_i : (..., 3) array
        Position (m) and velocity (m/s), frame i.
    points : int
        Number of points along the revolution; even, so that perigee and apogee are among them.

    Returns
    -------
    lowest, highest : (...,) array
        Height above the equatorial radius (m), of the mean orbit with its short-periodic variation added.
    """
    average = mean(r_i, v_i)
    # The points along the revolution are the last axis of scalars and the last but one of vectors.
    orbit = OrbitVectors(
        energy=average.energy[..., None],
        h_i=average.h_i[..., None, :],
        e_i=average.e_i[..., None, :],
    )
    start_i = np.asarray(r_i, dtype=float)[..., None, :]
    towards, ahead = _plane(orbit.h_i, start_i)
    ex = np.sum(orbit.e_i * towards, axis=-1)
    ey = np.sum(orbit.e_i * ahead, axis=-1)
    perigee = np.arctan2(ey, ex)
    true_anomaly = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    angle = (perigee + true_anomaly)[..., None]
    direction = np.cos(angle) * towards + np.sin(angle) * ahead

    radius = _radius(orbit.h_i, orbit.e_i, direction)
    variation = _short_periodic(orbit, radius[..., None] * direction)
    h_i = orbit.h_i + variation.h_i
    e_i = orbit.e_i + variation.e_i
    height = _radius(h_i, e_i, direction) - SEMI_MAJOR
    lowest = height.min(axis=-1)
    highest = height.max(axis=-1)
    return lowest, highest


def _radius(h_i: Floats, e_i: Floats, direction: Floats) -> Floats:
    """Return the radius h^2 / GM / (1 + e . u) of orbits in directions u.

    Parameters
    ----------
    h_i : (..., 3) array
        Specific angular momentum (m^2/s), frame i.
    e_i : (..., 3) array
        Eccentricity vector, frame i.
    direction : (..., 3) array
        Unit vectors u, in or close to the orbital plane, frame i.

    Returns
    -------
    (...,) array
        Radius (m).
    """
    semi_latus_rectum = np.sum(h_i**2, axis=-1) / GM
    e_cos_anomaly = np.sum(e_i * direction, axis=-1)
    return np.asarray(semi_latus_rectum / (1.0 + e_cos_anomaly))


def _plane(h_i: Floats, r_i: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors in the plane of the orbit: towards the position, and 90 degrees ahead.

    Parameters
    ----------
    h_i : (..., 3) array
        Angular momentum, frame i; only its direction matters.
    r_i : (..., 3) array
        Position, frame i; its component out of the plane is removed.

    Returns
    -------
    (..., 3) array, (..., 3) array
        Unit vectors, frame i.
    """
    normal = unit(h_i)
    out_of_plane = np.sum(r_i * normal, axis=-1, keepdims=True) * normal
    towards = unit(r_i - out_of_plane)
    return towards, np.cross(normal, towards)


class _Revolution(NamedTuple):
    """Points of orbits over one revolution from a position, which are the nodes of a quadrature.

    eccentricity : (..., 1)
    r_i : (..., n, 3), m. Position on the unperturbed orbit, frame i.
    v_i : (..., n, 3), m/s. Velocity on the unperturbed orbit, frame i.
    weight : (..., n), s. Weights of the integral of (1/2 - t/T) dt, with time t from the position and period T.
    """

    eccentricity: Floats
    r_i: Floats
    v_i: Floats
    weight: Floats


def _short_periodic(orbit: OrbitVectors, r_i: Floats) -> OrbitVectors:
    """Return the short-periodic variation of energy, h_i and e_i at a position, to first order in J2.

    Parameters
    ----------
    orbit : OrbitVectors
        Unperturbed orbits.
    r_i : (..., 3) array
        Position (m), frame i.

    Notes
    -----
    With the rate g of a quantity along the unperturbed orbit of period T, and time counted from the position, the
    average over a revolution minus half its drift is x + 1/T integral of (T/2 - t) g dt. The integral runs over the
    angle from the position, where g r^2 is smooth.
    """
    is_elliptic = orbit.elliptic
    largest = float(np.max(orbit.eccentricity, where=is_elliptic, initial=0.0))
    e_i = np.where(is_elliptic[..., None], orbit.e_i, 0.0)
    revolution = _revolution(orbit.h_i, e_i, r_i, _quadrature(largest))
    weight = revolution.weight

    # Rates by the acceleration a of J2: dE/dt = v . a, dh/dt = r x a, de/dt = (a x h + v x (r x a)) / GM
    acceleration = oblateness(revolution.r_i)
    energy_rate = np.sum(revolution.v_i * acceleration, axis=-1)
    h_rate = np.cross(revolution.r_i, acceleration)
    h_i = orbit.h_i[..., None, :]
    cross_rate = np.cross(acceleration, h_i) + np.cross(revolution.v_i, h_rate)
    e_rate = cross_rate / GM

    # NaN for orbits that cannot be averaged
    e = revolution.eccentricity
    axis_ratio = np.sqrt(1.0 - e * e)
    has_anomaly = np.isfinite(axis_ratio[..., 0])
    base = np.where(is_elliptic & has_anomaly, 0.0, np.nan)
    vector_base = base[..., None]
    vector_weight = weight[..., None]
    return OrbitVectors(
        energy=base - np.sum(weight * energy_rate, axis=-1),
        h_i=vector_base - np.sum(vector_weight * h_rate, axis=-2),
        e_i=vector_base - np.sum(vector_weight * e_rate, axis=-2),
    )


@lru_cache(maxsize=len(_NODE_COUNTS))
def _gauss_legendre(n_node: int) -> tuple[Floats, Floats]:
    """Return the nodes in [-1, 1] and weights of a Gauss-Legendre quadrature, each (n_node,)."""
    nodes, weights = np.polynomial.legendre.leggauss(n_node)
    return nodes, weights


def _quadrature(largest: float) -> tuple[Floats, Floats]:
    """Return angles over one turn (rad) and their weights, each (n,), for eccentricities up to the largest."""
    n_node = min(n for limit, n in _NODE_COUNTS.items() if largest <= limit)
    nodes, weights = _gauss_legendre(n_node)
    return np.pi * (nodes + 1.0), np.pi * weights


def _revolution(h_i: Floats, e_i: Floats, r_i: Floats, quadrature: tuple[Floats, Floats]) -> _Revolution:
    """Return the points of orbits at the angles of a quadrature, counted from the position.

    Parameters
    ----------
    h_i : (..., 3) array
        Specific angular momentum (m^2/s), frame i.
    e_i : (..., 3) array
        Eccentricity vector, frame i.
    r_i : (..., 3) array
        Position (m), frame i.
    quadrature : ((n,) array, (n,) array)
        Angles over one turn (rad), and their weights.
    """
    angle, angle_weight = quadrature
    c = np.cos(angle)
    s = np.sin(angle)
    radial, transverse = _plane(h_i, r_i)
    towards = radial[..., None, :]
    ahead = transverse[..., None, :]
    eccentricity_vector = e_i[..., None, :]
    ex = np.sum(eccentricity_vector * towards, axis=-1)
    ey = np.sum(eccentricity_vector * ahead, axis=-1)
    e = np.hypot(ex, ey)

    h = np.linalg.norm(h_i, axis=-1)[..., None]
    radius = h**2 / GM / (1.0 + ex * c + ey * s)
    direction = c[:, None] * towards + s[:, None] * ahead
    along_position = -(s + ey)[..., None] * towards
    across_position = (c + ex)[..., None] * ahead
    hodograph = along_position + across_position

    # t/T is the increase of the mean anomaly over 2 pi, and dt = r^2 / h d(angle).
    start = np.arctan2(-ey, ex)  # true anomaly of the position
    anomaly = mean_anomaly(start + angle, e) - mean_anomaly(start, e)
    time_fraction = anomaly / (2.0 * np.pi)
    speed_scale = GM / h
    return _Revolution(
        eccentricity=e,
        r_i=radius[..., None] * direction,
        v_i=speed_scale[..., None] * hodograph,
        weight=(0.5 - time_fraction) * angle_weight * radius**2 / h,
    )


def mean_anomaly(true: Floats, e: Floats) -> Floats:
    """Return the mean anomaly for a true anomaly on ellipses.

    Parameters
    ----------
    true : (...,) array
        True anomaly (rad), also beyond one turn.
    e : (...,) array
        Eccentricity, below 1.

    Returns
    -------
    (...,) array
        Mean anomaly (rad), continuous with the true anomaly.
    """
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    half_difference = np.arctan2(beta * np.sin(true), 1.0 + beta * np.cos(true))
    eccentric = true - 2.0 * half_difference
    return np.asarray(eccentric - e * np.sin(eccentric))


def oblateness(r_i: Floats) -> Floats:
    """Return the J2 term of the gravitation (..., 3) in m/s^2, frame i."""
    r2 = np.einsum("...i,...i->...", r_i, r_i)[..., None]
    sine2 = r_i[..., 2:] ** 2 / r2  # squared sine of the geocentric latitude
    r5 = r2 * r2 * np.sqrt(r2)
    factor = 1.5 * J2 * GM * SEMI_MAJOR**2 / r5
    return np.asarray(factor * r_i * (5.0 * sine2 - np.array([1.0, 1.0, 3.0])))
