"""Osculating and mean orbits, and free fall to the ground.

J2 changes osculating elements by some 10 km along a low orbit. Perigee and apogee are therefore those of the mean
orbit: the average over one revolution of energy, angular momentum and eccentricity vector, to first order in J2, with
the drift over the revolution removed. Vectors are regular for circular and equatorial orbits; angles are computed last.
(Kozai, Astronomical Journal 64, 1959, has the classical elements, which are singular for both.)

The fall is first a Kepler orbit down to the ellipsoid, in closed form, with iteration on the radius of the ellipsoid.
For J2 it is then integrated numerically over the same time and adjusted to height zero. Meanwhile the Earth rotates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import ECCENTRICITY_2, GM, J2, OMEGA, SEMI_MAJOR, SEMI_MINOR
from lvnav_trade.quantities.frames import earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_e_n, unit
from lvnav_trade.quantities.records import Bools, Floats

# Above it the quadrature over a revolution loses digits; such orbits reach the ground within the revolution.
MOST_ECCENTRIC = 0.9
# Nodes of the quadrature up to an eccentricity: the next larger number changes an offset by less than 1e-12 of it
_NODES = {most: np.polynomial.legendre.leggauss(n) for most, n in ((0.1, 24), (0.5, 40), (1.0, 64))}


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
        return np.asarray(np.arctan2(np.hypot(self.h_i[..., 0], self.h_i[..., 1]), self.h_i[..., 2]))

    @property
    def node(self) -> Floats:
        """Right ascension of the ascending node in rad, [0, 2 pi), against the inertial x axis."""
        return np.mod(np.arctan2(self.h_i[..., 0], -self.h_i[..., 1]), 2.0 * np.pi)

    @property
    def elliptic(self) -> Bools:
        """Whether the orbit is an ellipse that is not too eccentric to be averaged."""
        return np.asarray((self.energy < 0.0) & (self.eccentricity < MOST_ECCENTRIC))


def osculating(r_i: ArrayLike, v_i: ArrayLike) -> OrbitVectors:
    """Return the orbits that states r_i (m), v_i (m/s), each (..., 3), would follow about a point mass."""
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    h_i = np.cross(r_i, v_i)
    r = np.linalg.norm(r_i, axis=-1)
    return OrbitVectors(0.5 * np.sum(v_i * v_i, axis=-1) - GM / r, h_i, np.cross(v_i, h_i) / GM - r_i / r[..., None])


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
    start = osculating(r_i, v_i)
    return OrbitVectors(*(a - b for a, b in zip(start, _offset(start, np.asarray(r_i, dtype=float)), strict=True)))


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
    spread = OrbitVectors(average.energy[..., None], average.h_i[..., None, :], average.e_i[..., None, :])
    towards, ahead = _plane(spread.h_i, np.asarray(r_i, dtype=float)[..., None, :])
    perigee = np.arctan2(np.sum(spread.e_i * ahead, axis=-1), np.sum(spread.e_i * towards, axis=-1))
    angles = (perigee + np.linspace(0.0, 2.0 * np.pi, points, endpoint=False))[..., None]
    line = np.cos(angles) * towards + np.sin(angles) * ahead
    radius = np.sum(spread.h_i**2, axis=-1) / GM / (1.0 + np.sum(spread.e_i * line, axis=-1))
    swing = _offset(spread, radius[..., None] * line)
    h_i, e_i = spread.h_i + swing.h_i, spread.e_i + swing.e_i
    height = np.sum(h_i**2, axis=-1) / GM / (1.0 + np.sum(e_i * line, axis=-1)) - SEMI_MAJOR
    return height.min(axis=-1), height.max(axis=-1)


def _plane(h_i: Floats, r_i: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors in the plane of the orbit: towards the position, and 90 degrees ahead."""
    normal = unit(h_i)
    towards = unit(r_i - np.sum(r_i * normal, axis=-1, keepdims=True) * normal)
    return towards, np.cross(normal, towards)


def _offset(orbit: OrbitVectors, r_i: Floats) -> OrbitVectors:
    """Return the short-periodic variation of energy, h_i and e_i at a position, to first order in J2.

    With the rate g of a quantity along the unperturbed orbit of period T, and time counted from the position, the
    average over a revolution less half its drift is x + 1/T integral of (T/2 - t) g dt. The integral runs over the
    angle from the position, where g r^2 is smooth.
    """
    fit = orbit.elliptic
    e_i = np.where(fit[..., None], orbit.e_i, 0.0)
    towards, ahead = (axis[..., None, :] for axis in _plane(orbit.h_i, r_i))
    h = np.linalg.norm(orbit.h_i, axis=-1)[..., None]
    ex, ey = (np.sum(e_i[..., None, :] * axis, axis=-1) for axis in (towards, ahead))
    largest = np.max(orbit.eccentricity, where=fit, initial=0.0)
    nodes, weights = next(rule for most, rule in _NODES.items() if largest <= most)
    angle, weight = np.pi * (nodes + 1.0), np.pi * weights
    c, s = np.cos(angle), np.sin(angle)
    r = h**2 / GM / (1.0 + ex * c + ey * s)
    along_i = r[..., None] * (c[:, None] * towards + s[:, None] * ahead)
    v_i = (GM / h)[..., None] * (-(s + ey)[..., None] * towards + (c + ex)[..., None] * ahead)
    e = np.hypot(ex, ey)
    start = np.arctan2(-ey, ex)  # true anomaly of the position
    anomaly = mean_anomaly(start + angle, e) - mean_anomaly(start, e)  # increase since the position
    share = (0.5 - anomaly / (2.0 * np.pi)) * weight * r**2 / h  # (T/2 - t) / T dt
    pull = oblateness(along_i)
    turn = np.cross(along_i, pull)
    change = (np.cross(pull, orbit.h_i[..., None, :]) + np.cross(v_i, turn)) / GM
    bad = np.where(fit & np.isfinite(np.sqrt(1.0 - e * e)[..., 0]), 0.0, np.nan)
    return OrbitVectors(
        bad - np.sum(share * np.sum(v_i * pull, axis=-1), axis=-1),
        bad[..., None] - np.sum(share[..., None] * turn, axis=-2),
        bad[..., None] - np.sum(share[..., None] * change, axis=-2),
    )


def mean_anomaly(true: Floats, e: Floats) -> Floats:
    """Return the mean anomaly (rad) for a true anomaly (rad, also beyond one turn) on ellipses of eccentricity e."""
    beta = e / (1.0 + np.sqrt(1.0 - e * e))
    eccentric = true - 2.0 * np.arctan2(beta * np.sin(true), 1.0 + beta * np.cos(true))
    return np.asarray(eccentric - e * np.sin(eccentric))


def oblateness(r_i: Floats) -> Floats:
    """Return the J2 term of the gravitation (..., 3) in m/s^2, frame i."""
    r2 = np.einsum("...i,...i->...", r_i, r_i)[..., None]
    s2 = r_i[..., 2:] ** 2 / r2
    k = 1.5 * J2 * GM * SEMI_MAJOR**2 / (r2 * r2 * np.sqrt(r2))
    return np.asarray(k * r_i * (5.0 * s2 - np.array([1.0, 1.0, 3.0])))


# Height in m below which no impact point is reported: it would coincide with the vehicle.
LOWEST = 1e3
_STEP = 16.0  # longest step of the numerical fall, s: centimetres over half a revolution
_FEWEST = 8  # steps of a fall


class Impact(NamedTuple):
    """Impact points. All fields are NaN where there is none.

    r_e : (..., 3), m. Point on the ellipsoid, frame e.
    latitude, longitude : (...,), rad. Geodetic coordinates.
    fall : (...,), s. Time from the state to impact.
    heading : (...,), rad from north. Heading of the ground velocity at impact.
    """

    r_e: Floats
    latitude: Floats
    longitude: Floats
    fall: Floats
    heading: Floats


def impact(r_i: ArrayLike, v_i: ArrayLike, earth_angle: ArrayLike, j2: bool = True, lowest: float = LOWEST) -> Impact:
    """Return the impact points of states in free fall.

    Parameters
    ----------
    r_i, v_i : (n, 3) array
        Position (m) and velocity (m/s), frame i.
    earth_angle : float or (n,) array
        Angle from the inertial to the Earth-fixed x axis at the time of the states (rad).
    j2 : bool
        Whether the Earth's oblateness acts on the fall.
    lowest : float
        Height (m) below which a state has no impact point.

    Returns
    -------
    Impact
        NaN where the orbit clears the ground, the vehicle is below `lowest`, or the orbit is open without impact.
    """
    r_i, v_i = np.atleast_2d(np.asarray(r_i, dtype=float)), np.atleast_2d(np.asarray(v_i, dtype=float))
    theta = np.broadcast_to(np.asarray(earth_angle, dtype=float), r_i.shape[:1])
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = _kepler_fall(r_i, v_i)
        _, _, height = geodetic_from_ecef(r_i)  # the height does not depend on the rotation of the Earth
        fall = np.where(height >= lowest, fall, np.nan)
        longest = float(np.max(fall, initial=0.0, where=np.isfinite(fall)))
        end = _fly(r_i, v_i, fall, j2, max(_FEWEST, int(np.ceil(longest / _STEP))))
        fall, end = _to_ground(fall, end, j2)
        turned, r_i, v_i = theta + OMEGA * fall, end[:, :3], end[:, 3:]
        r_e = ecef_from_eci(r_i, turned)
        latitude, longitude, _ = geodetic_from_ecef(r_e)
        axes_n = rotation_e_n(latitude, longitude)
        v_n = np.einsum("nij,nj->ni", axes_n, ecef_from_eci(earth_velocity(r_i, v_i), turned))
        return Impact(r_e, latitude, longitude, fall, np.arctan2(v_n[:, 1], v_n[:, 0]))


def _kepler_fall(r_i: Floats, v_i: Floats) -> Floats:
    """Return the time (n,) in s to the next crossing of the ellipsoid on the Kepler orbit; NaN if there is none."""
    h_i = np.cross(r_i, v_i)
    h = np.linalg.norm(h_i, axis=1)
    r = np.linalg.norm(r_i, axis=1)
    towards, normal = unit(r_i), h_i / h[:, None]
    ahead = np.cross(normal, towards)
    e_i = np.cross(v_i, h_i) / GM - towards
    ex, ey = np.sum(e_i * towards, axis=1), np.sum(e_i * ahead, axis=1)
    e, p = np.hypot(ex, ey), h**2 / GM
    anomaly = np.mod(np.arctan2(-ey, ex), 2.0 * np.pi)
    radius = np.full_like(r, SEMI_MINOR)
    for _ in range(30):  # each step reduces the error by 300 times the slope of the fall
        angle = np.mod(2.0 * np.pi - np.arccos((p / radius - 1.0) / e) - anomaly, 2.0 * np.pi)
        sine = np.cos(angle) * towards[:, 2] + np.sin(angle) * ahead[:, 2]
        before, radius = radius, SEMI_MINOR / np.sqrt(1.0 - ECCENTRICITY_2 * (1.0 - sine**2))
        if not (np.abs(radius - before) > 1e-6).any():
            break
    a = p / (1.0 - e * e)
    return np.asarray((mean_anomaly(anomaly + angle, e) - mean_anomaly(anomaly, e)) * np.sqrt(a**3 / GM))


def _pull(state: Floats, j2: bool) -> Floats:
    """Return the time derivative (n, 6) of states (position, velocity) in free fall."""
    r_i = state[:, :3]
    square = np.einsum("ij,ij->i", r_i, r_i)[:, None]
    pull = -GM * r_i / (square * np.sqrt(square))
    return np.concatenate([state[:, 3:], pull + oblateness(r_i) if j2 else pull], axis=1)


def coast(r_i: ArrayLike, v_i: ArrayLike, seconds: float) -> tuple[Floats, Floats]:
    """Return states r_i (m), v_i (m/s), each (n, 3), after a time in s of free fall about the oblate Earth (J2)."""
    r_i, v_i = np.atleast_2d(np.asarray(r_i, dtype=float)), np.atleast_2d(np.asarray(v_i, dtype=float))
    if seconds == 0.0:
        return r_i, v_i
    steps = max(_FEWEST, int(np.ceil(abs(seconds) / _STEP)))
    state = _fly(r_i, v_i, np.full(len(r_i), seconds), True, steps)
    return state[:, :3], state[:, 3:]


def _fly(r_i: Floats, v_i: Floats, time: Floats, j2: bool, steps: int) -> Floats:
    """Return the states (n, 6) after times (n,) of free fall, by the classical fourth-order Runge-Kutta method."""
    state = np.concatenate([r_i, v_i], axis=1)
    dt = (time / steps)[:, None]
    for _ in range(steps):
        first = _pull(state, j2)
        second = _pull(state + 0.5 * dt * first, j2)
        third = _pull(state + 0.5 * dt * second, j2)
        state = state + dt / 6.0 * (first + 2.0 * (second + third) + _pull(state + dt * third, j2))
    return state


def _to_ground(fall: Floats, state: Floats, j2: bool) -> tuple[Floats, Floats]:
    """Move states near the ground to height zero by Newton's method in time; NaN where this fails."""
    for _ in range(6):
        # the height does not depend on the longitude, so inertial components suffice
        latitude, longitude, height = geodetic_from_ecef(state[:, :3])
        up = -rotation_e_n(latitude, longitude)[:, 2]
        step = np.clip(-height / np.sum(state[:, 3:] * up, axis=1), -60.0, 60.0)
        state = _fly(state[:, :3], state[:, 3:], step, j2, 4)
        fall = fall + step
        if not (np.abs(step) > 1e-11).any():  # 0.1 um along the path
            break
    _, _, height = geodetic_from_ecef(state[:, :3])
    sound = (np.abs(height) < 1e-3) & (fall > 0.0)
    return np.where(sound, fall, np.nan), np.where(sound[:, None], state, np.nan)


def offsets(from_e: ArrayLike, to_e: ArrayLike, heading: ArrayLike) -> Floats:
    """Return the distance of points from reference points on the ground, down-range and cross-range.

    Parameters
    ----------
    from_e, to_e : (..., 3) array
        Reference points and points (m), frame e.
    heading : (...,) array
        Heading of down-range (rad from north).

    Returns
    -------
    (..., 2) array
        Down-range along the heading, cross-range to its right (m), in the tangent plane at `from_e`.
    """
    from_e, to_e = np.asarray(from_e, dtype=float), np.asarray(to_e, dtype=float)
    latitude, longitude, _ = geodetic_from_ecef(from_e)
    north, east, _ = np.moveaxis(np.einsum("...ij,...j->...i", rotation_e_n(latitude, longitude), to_e - from_e), -1, 0)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * north + s * east, -s * north + c * east], axis=-1)
