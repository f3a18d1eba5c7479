"""Free fall to the ground: impact points, and states after a time of free fall.

The fall is first a Kepler orbit down to the ellipsoid, in closed form, with iteration on the radius of the ellipsoid.
For J2 it is then integrated numerically over the same time and adjusted to height zero. Meanwhile the Earth rotates.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import ECCENTRICITY_2, GM, OMEGA, SEMI_MINOR
from lvnav_trade.quantities.frames import earth_velocity, ecef_from_eci, geodetic_from_ecef, rotation_e_n, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics.orbits import mean_anomaly, oblateness

# Height in m below which no impact point is reported: it would coincide with the vehicle.
LOWEST = 1e3
_STEP = 16.0  # longest step of the numerical fall, s: centimetres over half a revolution
_FEWEST = 8  # steps of a fall


class Impact(NamedTuple):
    """Impact points; all fields are NaN for a state without an impact point.

    r_e : (..., 3), m. Point on the ellipsoid, frame e.
    latitude : (...,), rad. Geodetic latitude.
    longitude : (...,), rad. Longitude.
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
    r_i = np.atleast_2d(np.asarray(r_i, dtype=float))
    v_i = np.atleast_2d(np.asarray(v_i, dtype=float))
    theta = np.broadcast_to(np.asarray(earth_angle, dtype=float), r_i.shape[:1])
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = _kepler_fall(r_i, v_i)
        _, _, height = geodetic_from_ecef(r_i)  # the height does not depend on the rotation of the Earth
        fall = np.where(height >= lowest, fall, np.nan)
        longest = float(np.max(fall, initial=0.0, where=np.isfinite(fall)))
        state = _propagate(r_i, v_i, fall, j2, _step_count(longest))
        fall, state = _reach_ground(fall, state, j2)

        r_i = state[:, :3]
        v_i = state[:, 3:]
        theta = theta + OMEGA * fall
        r_e = ecef_from_eci(r_i, theta)
        latitude, longitude, _ = geodetic_from_ecef(r_e)
        v_e = ecef_from_eci(earth_velocity(r_i, v_i), theta)
        v_n = np.einsum("nij,nj->ni", rotation_e_n(latitude, longitude), v_e)
        return Impact(
            r_e=r_e,
            latitude=latitude,
            longitude=longitude,
            fall=fall,
            heading=np.arctan2(v_n[:, 1], v_n[:, 0]),
        )


def _kepler_fall(r_i: Floats, v_i: Floats) -> Floats:
    """Return the time to the next crossing of the ellipsoid on the Kepler orbit.

    Parameters
    ----------
    r_i, v_i : (n, 3) array
        Position (m) and velocity (m/s), frame i.

    Returns
    -------
    (n,) array
        Time (s); NaN if there is no crossing.
    """
    h_i = np.cross(r_i, v_i)
    h = np.linalg.norm(h_i, axis=1)
    towards = unit(r_i)
    ahead = np.cross(h_i / h[:, None], towards)
    e_i = np.cross(v_i, h_i) / GM - towards
    ex = np.sum(e_i * towards, axis=1)
    ey = np.sum(e_i * ahead, axis=1)
    e = np.hypot(ex, ey)
    p = h**2 / GM
    start = np.arctan2(-ey, ex)
    anomaly = np.mod(start, 2.0 * np.pi)  # true anomaly of the state

    radius = np.full(len(r_i), SEMI_MINOR)
    for _ in range(30):  # each step reduces the error by 300 times the slope of the fall
        # r = p / (1 + e cos(true anomaly)), on the descending half of the orbit
        cosine = (p / radius - 1.0) / e
        impact_anomaly = 2.0 * np.pi - np.arccos(cosine)
        angle = np.mod(impact_anomaly - anomaly, 2.0 * np.pi)
        sine = np.cos(angle) * towards[:, 2] + np.sin(angle) * ahead[:, 2]  # of the geocentric latitude
        cosine_square = 1.0 - sine**2
        previous = radius
        radius = SEMI_MINOR / np.sqrt(1.0 - ECCENTRICITY_2 * cosine_square)
        change = np.abs(radius - previous)
        if not (change > 1e-6).any():
            break

    a = p / (1.0 - e * e)
    mean_angle = mean_anomaly(anomaly + angle, e) - mean_anomaly(anomaly, e)
    time_per_radian = np.sqrt(a**3 / GM)
    return np.asarray(mean_angle * time_per_radian)


def _state_rate(state: Floats, j2: bool) -> Floats:
    """Return the time derivative of states in free fall.

    Parameters
    ----------
    state : (n, 6) array
        Position (m) and velocity (m/s), frame i.
    j2 : bool
        Whether the Earth's oblateness acts on the fall.

    Returns
    -------
    (n, 6) array
        Velocity (m/s) and acceleration (m/s^2), frame i.
    """
    r_i = state[:, :3]
    square = np.einsum("ij,ij->i", r_i, r_i)[:, None]
    cube = square * np.sqrt(square)
    gravitation = -GM * r_i / cube
    if j2:
        gravitation = gravitation + oblateness(r_i)
    return np.concatenate([state[:, 3:], gravitation], axis=1)


def coast(r_i: ArrayLike, v_i: ArrayLike, seconds: float) -> tuple[Floats, Floats]:
    """Return states after free fall about the oblate Earth (J2).

    Parameters
    ----------
    r_i, v_i : (n, 3) array
        Position (m) and velocity (m/s), frame i.
    seconds : float
        Duration of the fall (s).

    Returns
    -------
    (n, 3) array, (n, 3) array
        Position (m) and velocity (m/s), frame i.
    """
    r_i = np.atleast_2d(np.asarray(r_i, dtype=float))
    v_i = np.atleast_2d(np.asarray(v_i, dtype=float))
    if seconds == 0.0:
        return r_i, v_i
    time = np.full(len(r_i), seconds)
    n_steps = _step_count(abs(seconds))
    state = _propagate(r_i, v_i, time, True, n_steps)
    return state[:, :3], state[:, 3:]


def _step_count(seconds: float) -> int:
    """Return the number of integration steps for a time of free fall."""
    return max(_FEWEST, int(np.ceil(seconds / _STEP)))


def _propagate(r_i: Floats, v_i: Floats, time: Floats, j2: bool, steps: int) -> Floats:
    """Return the states after free fall, by the classical fourth-order Runge-Kutta method.

    Parameters
    ----------
    r_i, v_i : (n, 3) array
        Position (m) and velocity (m/s), frame i.
    time : (n,) array
        Duration of the fall of each state (s).
    j2 : bool
        Whether the Earth's oblateness acts on the fall.
    steps : int
        Number of steps.

    Returns
    -------
    (n, 6) array
        Position (m) and velocity (m/s), frame i.
    """
    state = np.concatenate([r_i, v_i], axis=1)
    dt = (time / steps)[:, None]
    for _ in range(steps):
        first = _state_rate(state, j2)
        second = _state_rate(state + 0.5 * dt * first, j2)
        third = _state_rate(state + 0.5 * dt * second, j2)
        fourth = _state_rate(state + dt * third, j2)
        weighted_sum = first + 2.0 * (second + third) + fourth
        state = state + dt / 6.0 * weighted_sum
    return state


def _reach_ground(fall: Floats, state: Floats, j2: bool) -> tuple[Floats, Floats]:
    """Move states near the ground to height zero by Newton's method in time; NaN where this fails.

    Parameters
    ----------
    fall : (n,) array
        Time of fall to the states (s).
    state : (n, 6) array
        Position (m) and velocity (m/s) near the ground, frame i.
    j2 : bool
        Whether the Earth's oblateness acts on the fall.

    Returns
    -------
    (n,) array, (n, 6) array
        Time of fall to the ground (s), and the states there.
    """
    for _ in range(6):
        # the height does not depend on the longitude, so inertial components suffice
        latitude, longitude, height = geodetic_from_ecef(state[:, :3])
        up = -rotation_e_n(latitude, longitude)[:, 2]
        climb_rate = np.sum(state[:, 3:] * up, axis=1)
        newton_step = -height / climb_rate
        step = np.clip(newton_step, -60.0, 60.0)
        state = _propagate(state[:, :3], state[:, 3:], step, j2, 4)
        fall = fall + step
        if not (np.abs(step) > 1e-11).any():  # 0.1 um along the path
            break
    _, _, height = geodetic_from_ecef(state[:, :3])
    is_on_ground = np.abs(height) < 1e-3
    is_impact = is_on_ground & (fall > 0.0)
    impact_time = np.where(is_impact, fall, np.nan)
    impact_state = np.where(is_impact[:, None], state, np.nan)
    return impact_time, impact_state


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
    from_e = np.asarray(from_e, dtype=float)
    to_e = np.asarray(to_e, dtype=float)
    latitude, longitude, _ = geodetic_from_ecef(from_e)
    C_e_n = rotation_e_n(latitude, longitude)
    offset_n = np.einsum("...ij,...j->...i", C_e_n, to_e - from_e)
    north = offset_n[..., 0]
    east = offset_n[..., 1]
    c = np.cos(heading)
    s = np.sin(heading)
    down_range = c * north + s * east
    cross_range = -s * north + c * east
    return np.stack([down_range, cross_range], axis=-1)
