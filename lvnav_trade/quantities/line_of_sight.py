"""Line of sight from an antenna to a satellite or a transmitter: range, its derivatives, and angles of view.

Truth, filter model, preparation and recorded logs all take their geometry from here. Vectors are in frame i unless
another frame is given. Array functions accept any leading shape; compiled functions are for one antenna and one
satellite.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.attitude import cross, matrix, rotate
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import SEMI_MAJOR, SEMI_MINOR
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, rotation_e_n
from lvnav_trade.quantities.records import Bools, Floats, Motion

_ONE_CONE = 1e12
"""Condition number of the normal equations above which the satellites count as lying in one cone (no position fix)."""


@jit
def antenna(out: Any, nav: Any, rate: Any, lever: Any, sign: float) -> None:
    """Set the estimated state of the antenna: r_a = r + C l, v_a = v + C (w x l).

    Parameters
    ----------
    out : (21,) output, frame i
        Position (m), velocity (m/s), lever arm C l (m), its rate C (w x l) (m/s), and the derivative of the velocity by
        the rate state (m), 3 x 3 by rows.
    nav : (10,)
        Navigation state: quaternion body to i, velocity (m/s), position (m), frame i.
    rate : (3,) rad/s
        Body rate, body axes.
    lever : (3,) m
        Antenna relative to the IMU, body axes.
    sign : float
        Derivative of the body rate by the state that carries its error: 1 for a rate state, -1 for a gyro bias.
    """
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    lx = lever[0]
    ly = lever[1]
    lz = lever[2]
    sx, sy, sz = cross(rate[0], rate[1], rate[2], lx, ly, lz)
    arm = rotate(c, lx, ly, lz)
    swing = rotate(c, sx, sy, sz)
    for i in range(3):
        out[i] = nav[R + i] + arm[i]
        out[3 + i] = nav[V + i] + swing[i]
        out[6 + i] = arm[i]
        out[9 + i] = swing[i]
        # d(C (w x l))/dw = -C [l x]
        row = 3 * i
        cx = c[row]
        cy = c[row + 1]
        cz = c[row + 2]
        by_rate_x = cz * ly - cy * lz
        by_rate_y = cx * lz - cz * lx
        by_rate_z = cy * lx - cx * ly
        out[12 + row] = sign * by_rate_x
        out[13 + row] = sign * by_rate_y
        out[14 + row] = sign * by_rate_z


@jit
def line_of_sight(satellite: Any, antenna_state: Any) -> Any:
    """Return the unit vector from antenna to satellite (three numbers) and their distance (m).

    satellite : (3,) m, frame i
    antenna_state : state of the antenna, as `antenna` sets it
    """
    dx = satellite[0] - antenna_state[0]
    dy = satellite[1] - antenna_state[1]
    dz = satellite[2] - antenna_state[2]
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / distance
    ux = dx * scale
    uy = dy * scale
    uz = dz * scale
    return ux, uy, uz, distance


class Sight(NamedTuple):
    """Lines of sight, of any leading shape.

    line : (..., 3) m. From the antenna to the satellite or transmitter.
    line_rate : (..., 3) m/s. Time derivative of the line.
    distance : (...,) m. Range.
    direction : (..., 3). Unit vector along the line.
    rate : (...,) m/s. Range rate.
    """

    line: Floats
    line_rate: Floats
    distance: Floats
    direction: Floats
    rate: Floats

    @property
    def direction_rate(self) -> Floats:
        """Time derivative of the unit vector, (..., 3) rad/s, which is also the derivative of the range rate by the
        line: u' = (line' - rate u) / range.
        """
        along = self.rate[..., None] * self.direction
        across = self.line_rate - along
        return np.asarray(across / self.distance[..., None])

    def acceleration(self, relative: Floats) -> Floats:
        """Return the second derivative of the range, (...,) m/s^2.

        relative : (..., 3) m/s^2. Second derivative of the line.
        """
        speed_square = np.sum(self.line_rate**2, axis=-1)
        across = speed_square - self.rate**2  # square of the velocity across the line
        along = _projection(self.direction, relative)
        return np.asarray(across / self.distance + along)


def _projection(direction: Floats, vector: Floats) -> Floats:
    """Return the component (...,) of vectors (..., 3) along directions (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", direction, vector))


def sight(line: Floats, line_rate: Floats) -> Sight:
    """Return distance, direction and range rate of lines of sight.

    Parameters
    ----------
    line : (..., 3) m
        From the antenna to the satellite or transmitter.
    line_rate : (..., 3) m/s
        Time derivative of the line, same axes.
    """
    distance = np.linalg.norm(line, axis=-1)
    direction = line / distance[..., None]
    return Sight(line, line_rate, distance, direction, _projection(direction, line_rate))


def point_mass_gravitation(r_i: Floats, gm: float) -> Floats:
    """Return point-mass gravitation (..., 3) m/s^2 at positions (..., 3) m. It suffices for the curvature of a range.

    gm : m^3/s^2. Gravitational constant of the Earth.
    """
    distance = np.linalg.norm(r_i, axis=-1, keepdims=True)
    return np.asarray(-gm * r_i / distance**3)


def point_motion(motion: Motion, C_b_i: Floats, lever_b: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and velocity (m/s), (n_epoch, 3) each, of a point of the vehicle such as an antenna.

    r_a = r + C l,   v_a = v + C (w x l)

    Parameters
    ----------
    motion : Motion
        Motion of the IMU at n_epoch times.
    C_b_i : (n_epoch, 3, 3)
        Attitude, body to frame i.
    lever_b : (3,) m
        Point relative to the IMU, body axes.
    """
    swing_b = np.cross(motion.w_ib_b, lever_b)
    position_i = motion.r_i + C_b_i @ lever_b
    velocity_i = motion.v_i + np.einsum("nij,nj->ni", C_b_i, swing_b)
    return position_i, velocity_i


def lever_partials(lines: Sight, C_b_i: Floats, w_ib_b: Floats) -> Floats:
    """Return the derivatives of range and range rate by the lever arm in body axes, (n_epoch, n_sat, 2, 3).

    Parameters
    ----------
    lines : Sight, (n_epoch, n_sat)
        Lines of sight in frame i.
    C_b_i : (n_epoch, 3, 3)
        Attitude, body to frame i.
    w_ib_b : (n_epoch, 3) rad/s
        Body rate.

    Returns
    -------
    (n_epoch, n_sat, 2, 3)
        Range (no unit), then range rate (1/s). Both are negative along the line: the lever arm moves the antenna, the
        line's own start.
    """
    direction_b = np.einsum("esi,eij->esj", lines.direction, C_b_i)  # u in body axes
    swing_partial = np.cross(direction_b, w_ib_b[:, None, :])  # u . (w x l) = l . (u x w)
    direction_rate_b = np.einsum("esi,eij->esj", lines.direction_rate, C_b_i)
    by_range = -direction_b
    by_range_rate = -swing_partial - direction_rate_b
    return np.stack([by_range, by_range_rate], axis=2)


def ranging_rows(direction: Floats) -> Floats:
    """Return the Jacobian (..., n_sat, 4) of pseudoranges by antenna position and clock bias: [-u', 1].

    direction : (..., n_sat, 3). Unit vectors u from antenna to satellite.
    """
    by_clock = np.ones((*direction.shape[:-1], 1))
    return np.concatenate([-direction, by_clock], axis=-1)


def pdop(direction: Floats, is_tracked: Bools) -> Floats:
    """Return the position dilution of precision, (n_epoch,), from the trace of (H' H)^-1 over position.

    It is infinite with fewer than four satellites, or if all of them lie in one cone about the antenna.

    Parameters
    ----------
    direction : (n_epoch, n_sat, 3)
        Unit vectors from antenna to satellites.
    is_tracked : (n_epoch, n_sat) bool
        Satellites in the solution.
    """
    dilution = np.full(len(is_tracked), np.inf)
    n_tracked = is_tracked.sum(axis=1)
    for epoch in np.flatnonzero(n_tracked >= 4):
        tracked_direction = direction[epoch, is_tracked[epoch]]
        rows = ranging_rows(tracked_direction)
        normal = rows.T @ rows
        if np.linalg.cond(normal) < _ONE_CONE:
            position_part = np.linalg.inv(normal)[:3, :3]
            dilution[epoch] = math.sqrt(np.trace(position_part))
    return dilution


def range_rate(direction: Floats, v_sat: Floats, v_antenna: Floats) -> Floats:
    """Return the derivative (m/s) of the distance travelled by the signal, with respect to reception time.

    Parameters
    ----------
    direction : (..., 3)
        Unit vector u from antenna to satellite.
    v_sat : (..., 3) m/s
        Satellite velocity at transmission, with respect to transmission time.
    v_antenna : (..., 3) m/s
        Antenna velocity at reception.

    Notes
    -----
    From the derivative of the light-time equation: the satellite moves for dt_tx/dt_rx = 1 - rate/c, hence
    rate = (u . v_sat - u . v_antenna) / (1 + u . v_sat / c).
    """
    satellite_rate = _projection(direction, v_sat)
    antenna_rate = _projection(direction, v_antenna)
    difference = satellite_rate - antenna_rate
    return np.asarray(difference / (1.0 + satellite_rate / SPEED_OF_LIGHT))


def look_angles(theta0: float, t: Floats, antenna_r: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Return azimuth (from north over east, 0 to 2 pi) and elevation (rad), (n_epoch, n_sat) each.

    The angles refer to the geodetic north-east-down axes of the antenna.

    Parameters
    ----------
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n_epoch,) s
        Times since lift-off.
    antenna_r : (n_epoch, 3) m, frame i
        Antenna positions.
    direction : (n_epoch, n_sat, 3), frame i
        Unit vectors from antenna to satellites.
    """
    theta = earth_angle(theta0, t)
    antenna_e = ecef_from_eci(antenna_r, theta)
    latitude, longitude, _ = geodetic_from_ecef(antenna_e)
    C_e_n = rotation_e_n(latitude, longitude)
    direction_e = ecef_from_eci(direction, theta[:, None])
    direction_n = np.einsum("nij,nsj->nsi", C_e_n, direction_e)
    north, east, down = np.moveaxis(direction_n, -1, 0)
    azimuth = np.mod(np.arctan2(east, north), 2.0 * np.pi)
    elevation = np.arcsin(np.clip(-down, -1.0, 1.0))
    return azimuth, elevation


def off_nadir_angle(r_sat: Floats, direction: Floats) -> Floats:
    """Return the angle (...,) rad at the satellite between its nadir and the antenna.

    r_sat : (..., 3) m. Satellite position from the Earth's centre.
    direction : (..., 3). Unit vector from antenna to satellite, same axes.
    """
    distance = np.linalg.norm(r_sat, axis=-1)
    cosine = np.sum(r_sat * direction, axis=-1) / distance
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def is_occluded(antenna_r: Floats, satellite_r: Floats, grazing: float) -> Bools:
    """Return whether the Earth blocks the straight ray from antenna to satellite, (...,) bool.

    An antenna below the grazing height loses the satellites below its horizon and no others.

    Parameters
    ----------
    antenna_r, satellite_r : (..., 3) m
        Positions, in any axes with z along the pole.
    grazing : float
        Height (m) by which the ray must clear the ellipsoid at its lowest point between the two.
    """
    # stretching z turns the ellipsoid into a sphere and keeps straight lines straight
    stretch = np.array([1.0, 1.0, SEMI_MAJOR / SEMI_MINOR])
    start = antenna_r * stretch
    ray = satellite_r * stretch - start
    # the point start + along ray is closest to the centre where start . ray + along ray . ray = 0
    ray_square = np.sum(ray * ray, axis=-1)
    ray_fraction = -np.sum(start * ray, axis=-1) / ray_square
    lowest = start + ray_fraction[..., None] * ray
    lowest_square = np.sum(lowest * lowest, axis=-1)
    least_radius = SEMI_MAJOR + grazing
    is_between = (ray_fraction > 0.0) & (ray_fraction < 1.0)
    is_low = lowest_square < least_radius**2
    return np.asarray(is_between & is_low)
