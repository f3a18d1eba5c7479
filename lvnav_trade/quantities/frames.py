"""Frame changes for arrays of epochs: ECI, ECEF, geodetic, NED, orbital; orbital elements.

Matrices read left to right: ``C_e_n`` takes components in e to components in n. SI and radians throughout.
"""

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import (
    ECCENTRICITY_2,
    FLATTENING,
    GM,
    OMEGA,
    SECOND_ECCENTRICITY_2,
    SEMI_MAJOR,
    SEMI_MINOR,
)
from lvnav_trade.quantities.records import Floats


def reporting_axes(
    frame: str, t: Floats, r_i: Floats, v_i: Floats, theta0: float, pad_e: Floats | None = None
) -> Floats:
    """Return the matrices (n, 3, 3) from frame i to the frame of the reported errors, at the true state.

    Velocity errors are errors of inertial velocity resolved in these axes.

    Parameters
    ----------
    frame : {"ned", "ecef", "inertial", "orbital", "pad"}
    t : (n,) s
        Times since lift-off.
    r_i, v_i : (n, 3) m, m/s
        True position and velocity, frame i.
    theta0 : float
        Earth angle at lift-off (rad).
    pad_e : (3,) m, frame e, optional
        Position of the pad, for frame pad. None: the position at the first time.
    """
    if frame == "inertial":
        return np.tile(np.eye(3), (t.size, 1, 1))
    if frame == "orbital":
        return rotation_i_o(r_i, v_i)
    theta = earth_angle(theta0, t)
    if frame == "ecef":
        return rotation_i_e(theta)
    if frame == "pad":
        r_e = ecef_from_eci(r_i, theta)
        C_e_pad = rotation_e_pad(r_e, r_e[0] if pad_e is None else pad_e)
        return C_e_pad @ rotation_i_e(theta)
    return rotation_i_n(r_i, theta)


_ABOVE = 1.0  # m; a vehicle closer to the pad than this, over the ground, has no azimuth from it


def rotation_e_pad(r_e: Floats, pad_e: Floats) -> Floats:
    """Return the matrices (n, 3, 3) from frame e to the directions of growing azimuth, slant range and elevation, as
    a tracking station at the pad sees the vehicle.

    On the pad or straight above it azimuth is undefined; the vehicle is then taken to lie to the north, so that azimuth
    grows to the east.

    r_e : (n, 3) m, frame e. Vehicle.
    pad_e : (3,) m, frame e. Pad.
    """
    latitude, longitude, _ = geodetic_from_ecef(pad_e)
    _, east, down = rotation_e_n(latitude, longitude)
    up = -down
    from_pad = r_e - pad_e
    depth = from_pad @ down
    level = from_pad - depth[:, None] * down
    is_away = np.linalg.norm(level, axis=1) > _ABOVE
    is_off_pad = np.linalg.norm(from_pad, axis=1) > _ABOVE
    line = np.where(is_off_pad[:, None], from_pad, up)
    across = np.where(is_away[:, None], np.cross(level, up), east)
    outward = unit(line)
    azimuth = unit(across)
    # make the direction to the vehicle exactly perpendicular to the azimuth axis
    along_azimuth = np.sum(outward * azimuth, axis=1)
    outward = unit(outward - along_azimuth[:, None] * azimuth)
    elevation = np.cross(azimuth, outward)
    return np.stack([azimuth, outward, elevation], axis=1)


class Elements(NamedTuple):
    """Osculating Kepler elements: a (m), e, inclination, node, argument of perigee, true anomaly (rad)."""

    semi_major_axis: Floats
    eccentricity: Floats
    inclination: Floats
    node: Floats
    perigee_argument: Floats
    true_anomaly: Floats


# --- time and rotation of the Earth -----------------------------------------------------------------------------------


def gmst(iso: str) -> float:
    """Return Greenwich mean sidereal time in rad, [0, 2 pi), at an ISO 8601 instant.

    The IAU 1982 polynomial, with UTC in place of UT1. A text without a time zone is UTC.

    Raises
    ------
    ValueError
        The text is not ISO 8601.
    """
    instant = datetime.fromisoformat(iso)
    instant = instant.replace(tzinfo=UTC) if instant.tzinfo is None else instant.astimezone(UTC)
    since_j2000 = instant - datetime(2000, 1, 1, 12, tzinfo=UTC)
    seconds = since_j2000.seconds + since_j2000.microseconds * 1e-6  # since noon; separate from the days for precision
    days = since_j2000.days + seconds / 86400.0
    century = days / 36525.0
    # sidereal time exceeds the time since noon by this polynomial, in seconds of time (Aoki et al. 1982)
    excess = 67310.54841 + 8640184.812866 * century + 0.093104 * century**2 - 6.2e-6 * century**3
    sidereal_days = (excess + seconds) / 86400.0
    turns = math.fmod(sidereal_days, 1.0) % 1.0
    return turns * 2.0 * math.pi


def earth_angle(theta0: float, t: ArrayLike) -> Floats:
    """Return the Earth angle (rad), from the x axis of frame i to that of frame e, at times t (...,) s after theta0."""
    return np.asarray(theta0 + OMEGA * np.asarray(t, dtype=float))


def rotation_i_e(theta: ArrayLike) -> Floats:
    """Return C_i_e (..., 3, 3), from inertial to Earth-fixed components, for Earth angles theta (...,) rad."""
    theta = np.asarray(theta, dtype=float)
    c, s = np.cos(theta), np.sin(theta)
    zeros, ones = np.zeros_like(theta), np.ones_like(theta)
    return _matrix(
        [
            [c, s, zeros],
            [-s, c, zeros],
            [zeros, zeros, ones],
        ]
    )


def ecef_from_eci(r_i: ArrayLike, theta: ArrayLike) -> Floats:
    """Return vectors r_i (..., 3) in Earth-fixed components, at Earth angles theta (...,) rad.

    Only the axes change. For a velocity relative to the Earth see `earth_velocity`.
    """
    C_i_e = rotation_i_e(theta)
    return np.asarray(np.einsum("...jk,...k->...j", C_i_e, np.asarray(r_i, dtype=float)))


def eci_from_ecef(r_e: ArrayLike, theta: ArrayLike) -> Floats:
    """Return vectors r_e (..., 3) in inertial components, at Earth angles theta (...,) rad."""
    C_i_e = rotation_i_e(theta)
    return np.asarray(np.einsum("...kj,...k->...j", C_i_e, np.asarray(r_e, dtype=float)))


def earth_velocity(r_i: ArrayLike, v_i: ArrayLike) -> Floats:
    """Return the velocity relative to the rotating Earth, v_i - w_e x r_i, (..., 3) m/s in inertial components.

    r_i, v_i : (..., 3) m, m/s. Position and inertial velocity, frame i.
    """
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    cross = np.zeros(r_i.shape)  # of the polar axis and the position
    cross[..., 0] = -r_i[..., 1]
    cross[..., 1] = r_i[..., 0]
    return np.asarray(v_i - OMEGA * cross)


# --- geodetic and local frames ----------------------------------------------------------------------------------------


def ecef_from_geodetic(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Floats:
    """Return positions (..., 3) in m, frame e, of geodetic latitude, longitude (rad) and ellipsoidal height (m)."""
    lat, lon, h = (np.asarray(value, dtype=float) for value in (latitude, longitude, height))
    sin_lat = np.sin(lat)
    normal = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY_2 * sin_lat**2)  # radius of the prime vertical
    axis_distance = (normal + h) * np.cos(lat)
    x = axis_distance * np.cos(lon)
    y = axis_distance * np.sin(lon)
    z = ((1.0 - ECCENTRICITY_2) * normal + h) * sin_lat
    return np.stack([x, y, z], axis=-1)


def geodetic_from_ecef(r_e: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return geodetic latitude, longitude (rad) and height (m), each (...,), of positions r_e (..., 3) in m.

    Bowring's iteration on the reduced latitude (Survey Review 23, 1976); good to 1e-9 m from 100 km below the surface
    to geostationary height and beyond. Longitude of a point on the polar axis is zero.
    """
    # contiguous: for strided columns the last bit of arctan2 depends on their place in memory (numpy 2.0)
    r_e = np.asarray(r_e, dtype=float)
    components = r_e if r_e.ndim == 1 else np.moveaxis(r_e, -1, 0)
    x, y, z = np.ascontiguousarray(components)
    p = np.hypot(x, y)
    lat, height = _latitude_and_height(p, z, np.sin, np.cos)
    lon = np.arctan2(y, x)
    return np.asarray(lat), np.asarray(lon), np.asarray(height)


def height_from_ecef(x: float, y: float, z: float) -> float:
    """Return the height (m) of a single position x, y, z (m), frame e, by the formulas of `geodetic_from_ecef`."""
    p = float(np.hypot(x, y))
    _, height = _latitude_and_height(p, z, math.sin, math.cos)
    return float(height)


def _latitude_and_height(p: Any, z: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]) -> tuple[Any, Any]:
    """Return geodetic latitude (rad) and height (m), see `geodetic_from_ecef`, of positions or of a single one.

    p, z : (...,) or float, m. Distance from the polar axis, and coordinate along it.
    sin, cos : Functions of numpy; of `math`, which are faster, for a single position.
    """
    # the tangent of the reduced latitude is rise over run
    rise = SEMI_MAJOR * z
    run = SEMI_MINOR * p
    for _ in range(4):  # each iteration gains four digits or more, the fourth only confirms
        reduced_latitude = np.arctan2(rise, run)
        # tan lat = (z + e'^2 b sin^3 reduced) / (p - e^2 a cos^3 reduced)
        sin_reduced = sin(reduced_latitude)
        cos_reduced = cos(reduced_latitude)
        polar = z + SECOND_ECCENTRICITY_2 * SEMI_MINOR * sin_reduced**3
        level = p - ECCENTRICITY_2 * SEMI_MAJOR * cos_reduced**3
        lat = np.arctan2(polar, level)
        sin_lat = sin(lat)
        cos_lat = cos(lat)
        rise = (1.0 - FLATTENING) * sin_lat
        run = cos_lat
    surface = SEMI_MAJOR * np.sqrt(1.0 - ECCENTRICITY_2 * sin_lat**2)
    height = p * cos_lat + z * sin_lat - surface
    return lat, height


def rotation_e_n(latitude: ArrayLike, longitude: ArrayLike) -> Floats:
    """Return C_e_n (..., 3, 3): Earth-fixed to north-east-down components."""
    lat, lon = np.broadcast_arrays(np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float))
    sp, cp = np.sin(lat), np.cos(lat)
    sl, cl = np.sin(lon), np.cos(lon)
    return _matrix(
        [
            [-sp * cl, -sp * sl, cp],
            [-sl, cl, np.zeros_like(sl)],
            [-cp * cl, -cp * sl, -sp],
        ]
    )


def rotation_i_n(r_i: ArrayLike, theta: ArrayLike) -> Floats:
    """Return C_i_n (..., 3, 3), from inertial to geodetic north-east-down components, at positions r_i (..., 3) m.

    theta : (...,) rad. Earth angle.
    """
    theta = np.asarray(theta, dtype=float)
    r_e = ecef_from_eci(r_i, theta)
    lat, lon, _ = geodetic_from_ecef(r_e)
    C_e_n = rotation_e_n(lat, lon)
    return np.asarray(C_e_n @ rotation_i_e(theta))


def rotation_i_o(r_i: ArrayLike, v_i: ArrayLike) -> Floats:
    """Return C_i_o (..., 3, 3), from inertial to orbital components (radial, along-track, cross-track).

    r_i, v_i : (..., 3) m, m/s. Position and inertial velocity. Along-track completes the triad: it is the direction of
    the velocity on a circular orbit only.
    """
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    radial = unit(r_i)
    cross_track = unit(np.cross(r_i, v_i))
    along_track = np.cross(cross_track, radial)
    return np.stack([radial, along_track, cross_track], axis=-2)


# --- orbital elements -------------------------------------------------------------------------------------------------


def elements_from_state(r_i: ArrayLike, v_i: ArrayLike) -> Elements:
    """Return the osculating elements, each (...,), of states r_i, v_i (..., 3) in m and m/s.

    The node of an equatorial orbit and the perigee of a circular orbit are undefined and set to zero; the true anomaly
    then counts from there.
    """
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    r = np.linalg.norm(r_i, axis=-1)
    h_i = np.cross(r_i, v_i)  # angular momentum
    h = np.linalg.norm(h_i, axis=-1)
    e_i = np.cross(v_i, h_i) / GM - r_i / r[..., None]  # eccentricity vector, towards the perigee
    e = np.linalg.norm(e_i, axis=-1)
    h_level = np.hypot(h_i[..., 0], h_i[..., 1])
    is_equatorial = h_level < 1e-12 * h
    node_angle = np.arctan2(h_i[..., 0], -h_i[..., 1])
    node = np.where(is_equatorial, 0.0, node_angle)
    to_node = np.stack([np.cos(node), np.sin(node), np.zeros_like(node)], axis=-1)
    across = np.cross(unit(h_i), to_node)
    is_circular = e < 1e-12
    perigee = np.where(is_circular, 0.0, _angle(e_i, to_node, across))
    argument_of_latitude = _angle(r_i, to_node, across)
    # vis-viva: 1/a = 2/r - v^2 / GM
    speed_square = np.sum(v_i * v_i, axis=-1)
    inverse_axis = 2.0 / r - speed_square / GM
    turn = 2.0 * np.pi
    return Elements(
        semi_major_axis=1.0 / inverse_axis,
        eccentricity=e,
        inclination=np.arctan2(h_level, h_i[..., 2]),
        node=np.mod(node, turn),
        perigee_argument=np.mod(perigee, turn),
        true_anomaly=np.mod(argument_of_latitude - perigee, turn),
    )


def state_from_elements(elements: Elements) -> tuple[Floats, Floats]:
    """Return r_i (m) and v_i (m/s), each (..., 3), of osculating elements."""
    a, e, inclination, node, perigee, anomaly = (np.asarray(value, dtype=float) for value in elements)
    p = a * (1.0 - e * e)
    u = perigee + anomaly  # argument of latitude
    r = p / (1.0 + e * np.cos(anomaly))
    cn, sn = np.cos(node), np.sin(node)
    ci, si = np.cos(inclination), np.sin(inclination)
    cu, su = np.cos(u), np.sin(u)
    # axes of the orbital plane: to the ascending node, and a quarter of a turn further
    to_node = np.stack(np.broadcast_arrays(cn, sn, np.zeros_like(cn)), axis=-1)
    across = np.stack([-sn * ci, cn * ci, si * np.ones_like(cn)], axis=-1)
    r_node = r * cu
    r_across = r * su
    r_i = r_node[..., None] * to_node + r_across[..., None] * across
    speed = np.sqrt(GM / p)
    v_node = -speed * (su + e * np.sin(perigee))
    v_across = speed * (cu + e * np.cos(perigee))
    v_i = v_node[..., None] * to_node + v_across[..., None] * across
    return np.asarray(r_i), np.asarray(v_i)


# --- attitude ---------------------------------------------------------------------------------------------------------


def quaternions(C: Floats, continuous: bool = True) -> Floats:
    """Return the unit quaternions (n, 4), scalar first, of rotation matrices C (n, 3, 3).

    continuous : Whether to choose the signs so that successive quaternions do not jump.

    Notes
    -----
    Shepperd's method: divide by the largest component, so that every rotation is well conditioned. The matrix 4 q q'
    follows from sums and differences of entries of C; each of its rows is proportional to the quaternion.
    """
    trace = np.trace(C, axis1=1, axis2=2)
    ww = 1.0 + trace
    diagonal = np.diagonal(C, axis1=1, axis2=2)
    xx, yy, zz = (1.0 + 2.0 * diagonal - trace[:, None]).T
    wx = C[:, 2, 1] - C[:, 1, 2]
    wy = C[:, 0, 2] - C[:, 2, 0]
    wz = C[:, 1, 0] - C[:, 0, 1]
    xy = C[:, 0, 1] + C[:, 1, 0]
    xz = C[:, 0, 2] + C[:, 2, 0]
    yz = C[:, 1, 2] + C[:, 2, 1]
    products = np.array(
        [
            [ww, wx, wy, wz],
            [wx, xx, xy, xz],
            [wy, xy, yy, yz],
            [wz, xz, yz, zz],
        ]
    )
    largest = np.argmax([ww, xx, yy, zz], axis=0)
    epochs = np.arange(len(largest))
    q = unit(products[largest, :, epochs])
    if continuous:
        is_opposite = np.sum(q[1:] * q[:-1], axis=1) < 0.0
        sign_changes = np.where(is_opposite, -1.0, 1.0)
        signs = np.cumprod(sign_changes)
        q[1:] *= signs[:, None]
    return q


def matrices(q: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) of unit quaternions q (..., 4), scalar first."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
    return _matrix(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def unit(v: Floats) -> Floats:
    """Return the vectors v (..., m) divided by their lengths."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of vectors a and b (..., 3).

    The result equals that of `np.cross` to the last bit. For a few vectors it takes a quarter of the time.
    """
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        product[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return product


def _angle(v: Floats, x: Floats, y: Floats) -> Floats:
    """Return the angle of v in the plane of the unit vectors x and y, from x towards y."""
    along_x = np.sum(v * x, axis=-1)
    along_y = np.sum(v * y, axis=-1)
    return np.asarray(np.arctan2(along_y, along_x))


def _matrix(rows: list[list[Floats]]) -> Floats:
    """Stack rows of arrays (...,) to matrices (..., 3, 3)."""
    matrix = np.empty((*np.shape(rows[0][0]), 3, 3))
    for j, row in enumerate(rows):
        for k, entry in enumerate(row):
            matrix[..., j, k] = entry
    return matrix
