"""The instantaneous impact point: where a vehicle would come down if its thrust ended now, without air.

The fall is a Kepler orbit down to the ellipsoid (closed form, iterated on the radius below), then, for J2, flown
numerically for as long and led to height zero. The Earth turns beneath it meanwhile.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import ECCENTRICITY_2, GM, OMEGA, SEMI_MINOR
from lvnav_trade.quantities.frames import earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_e_n, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics.orbits import mean_anomaly, oblateness

# Height in m below which no point of impact is reported: it would be the vehicle's own place.
LOWEST = 1e3
_STEP = 16.0  # longest step of the numerical fall, s: centimetres over half a revolution
_FEWEST = 8  # steps of a fall


class Impact(NamedTuple):
    """Points of impact: r_e (..., 3) m on the ellipsoid; latitude, longitude (rad); fall (s); heading (rad from north)
    of the velocity over the ground at impact. All NaN where there is none.
    """

    r_e: Floats
    latitude: Floats
    longitude: Floats
    fall: Floats
    heading: Floats


def impact(r_i: ArrayLike, v_i: ArrayLike, earth_angle: ArrayLike, j2: bool = True, lowest: float = LOWEST) -> Impact:
    """Return where states r_i (m), v_i (m/s), each (n, 3), would come down.

    None where the orbit clears the ground, where the vehicle is lower than `lowest` (m), or escapes.

    Parameters
    ----------
    earth_angle
        Angle from the inertial to the Earth-fixed x axis at the time of the states, rad, (n,) or one number.
    j2
        Whether the Earth's oblateness acts on the fall.
    """
    r_i, v_i = np.atleast_2d(np.asarray(r_i, dtype=float)), np.atleast_2d(np.asarray(v_i, dtype=float))
    theta = np.broadcast_to(np.asarray(earth_angle, dtype=float), r_i.shape[:1])
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = _kepler_fall(r_i, v_i)
        _, _, height = geodetic_from_ecef(r_i)  # height does not depend on the turn of the Earth
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
    """Return the time (n,) in s to the first crossing of the ellipsoid ahead on the Kepler orbit; NaN for none."""
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
    for _ in range(30):  # the ellipsoid is nearly round: each round gains a factor of 300 over the slope of the fall
        angle = np.mod(2.0 * np.pi - np.arccos((p / radius - 1.0) / e) - anomaly, 2.0 * np.pi)
        sine = np.cos(angle) * towards[:, 2] + np.sin(angle) * ahead[:, 2]
        before, radius = radius, SEMI_MINOR / np.sqrt(1.0 - ECCENTRICITY_2 * (1.0 - sine**2))
        if not (np.abs(radius - before) > 1e-6).any():
            break
    a = p / (1.0 - e * e)
    return np.asarray((mean_anomaly(anomaly + angle, e) - mean_anomaly(anomaly, e)) * np.sqrt(a**3 / GM))


def _pull(state: Floats, j2: bool) -> Floats:
    """Return the derivative (n, 6) of states in free fall."""
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
    """Return the states (n, 6) after a time (n,) in free fall, by Runge and Kutta's fourth order."""
    state = np.concatenate([r_i, v_i], axis=1)
    dt = (time / steps)[:, None]
    for _ in range(steps):
        first = _pull(state, j2)
        second = _pull(state + 0.5 * dt * first, j2)
        third = _pull(state + 0.5 * dt * second, j2)
        state = state + dt / 6.0 * (first + 2.0 * (second + third) + _pull(state + dt * third, j2))
    return state


def _to_ground(fall: Floats, state: Floats, j2: bool) -> tuple[Floats, Floats]:
    """Lead states near the ground to height zero by Newton's rule in time."""
    for _ in range(6):
        # the height does not depend on the longitude, so inertial components will do
        latitude, longitude, height = geodetic_from_ecef(state[:, :3])
        up = -rotation_e_n(latitude, longitude)[:, 2]
        step = np.clip(-height / np.sum(state[:, 3:] * up, axis=1), -60.0, 60.0)
        state = _fly(state[:, :3], state[:, 3:], step, j2, 4)
        fall = fall + step
        if not (np.abs(step) > 1e-11).any():  # 0.1 um of the way
            break
    _, _, height = geodetic_from_ecef(state[:, :3])
    sound = (np.abs(height) < 1e-3) & (fall > 0.0)
    return np.where(sound, fall, np.nan), np.where(sound[:, None], state, np.nan)


def offsets(from_e: ArrayLike, to_e: ArrayLike, heading: ArrayLike) -> Floats:
    """Return how far points to_e lie from points from_e (..., 3) on the ground, down-range and cross-range (..., 2), m.

    Down-range is along the heading (rad from north), cross-range to its right; in the tangent plane at from_e.
    """
    from_e, to_e = np.asarray(from_e, dtype=float), np.asarray(to_e, dtype=float)
    latitude, longitude, _ = geodetic_from_ecef(from_e)
    north, east, _ = np.moveaxis(np.einsum("...ij,...j->...i", rotation_e_n(latitude, longitude), to_e - from_e), -1, 0)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * north + s * east, -s * north + c * east], axis=-1)
