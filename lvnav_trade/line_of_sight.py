"""Line of sight from an antenna to a satellite or a transmitter: range, its derivatives, and angles of view.

Truth, filter model, preparation and recorded logs all take their geometry from here. Vectors are in frame i unless
stated. Array functions hold for any leading shape; the compiled ones are for one antenna and one satellite.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, rotation_e_n
from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import SEMI_MAJOR, SEMI_MINOR
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.records import Bools, Floats, Motion

_ONE_CONE = 1e12
"""Condition number of the normal equations from which on the satellites are in one cone."""


@jit
def antenna(out: Any, nav: Any, rate: Any, lever: Any, sign: float) -> None:
    """Set the estimated antenna state: out (21,) position (m), velocity (m/s), lever arm and its rate, all in frame i,
    and the velocity by each component of what the body rate is known by (m), 3 x 3.

    nav (10,) navigation state; rate (3,) body rate (rad/s); lever (3,) antenna from the unit, body frame (m); sign of
    the body rate's error in the state that it is known by: 1 for the rate itself, -1 for a gyro bias.
    """
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    sx, sy, sz = cross(rate[0], rate[1], rate[2], lever[0], lever[1], lever[2])
    for i in range(3):
        row = 3 * i
        arm = c[row] * lever[0] + c[row + 1] * lever[1] + c[row + 2] * lever[2]
        swing = c[row] * sx + c[row + 1] * sy + c[row + 2] * sz
        out[i], out[3 + i] = nav[R + i] + arm, nav[V + i] + swing
        out[6 + i], out[9 + i] = arm, swing
        out[12 + row] = sign * (c[row + 2] * lever[1] - c[row + 1] * lever[2])
        out[13 + row] = sign * (c[row] * lever[2] - c[row + 2] * lever[0])
        out[14 + row] = sign * (c[row + 1] * lever[0] - c[row] * lever[1])


@jit
def line_of_sight(satellite: Any, at: Any) -> Any:
    """Return unit vector from antenna to satellite and their distance; satellite (3,) m, frame i; `at` as of
    `antenna`.
    """
    dx, dy, dz = satellite[0] - at[0], satellite[1] - at[1], satellite[2] - at[2]
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / distance
    return dx * scale, dy * scale, dz * scale, distance


class Sight(NamedTuple):
    """Lines of sight, of any leading shape.

    line : (..., 3) m. From the antenna to what it sees.
    moving : (..., 3) m/s. Time derivative of the line.
    distance : (...,) m. Range.
    direction : (..., 3). Unit vector along the line.
    rate : (...,) m/s. Range rate.
    """

    line: Floats
    moving: Floats
    distance: Floats
    direction: Floats
    rate: Floats

    @property
    def turning(self) -> Floats:
        """Time derivative of the unit vector, (..., 3) rad/s; also the derivative of the range rate by the line."""
        return np.asarray((self.moving - self.rate[..., None] * self.direction) / self.distance[..., None])

    def acceleration(self, relative: Floats) -> Floats:
        """Return the second derivative of the range (m/s^2); relative (..., 3) m/s^2 is that of the line."""
        across = np.sum(self.moving**2, axis=-1) - self.rate**2
        return np.asarray(across / self.distance + _along(self.direction, relative))


def _along(direction: Floats, vector: Floats) -> Floats:
    """Return the component (...,) of vectors (..., 3) along directions (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", direction, vector))


def sight(line: Floats, moving: Floats) -> Sight:
    """Return the geometry of lines of sight (..., 3) m and their time derivatives (..., 3) m/s."""
    distance = np.linalg.norm(line, axis=-1)
    direction = line / distance[..., None]
    return Sight(line, moving, distance, direction, _along(direction, moving))


def falling(r_i: Floats, gm: float) -> Floats:
    """Return point-mass gravity (..., 3) m/s^2 at positions (..., 3) m: enough for the curvature of a range.

    gm : m^3/s^2
    """
    return np.asarray(-gm * r_i / np.linalg.norm(r_i, axis=-1, keepdims=True) ** 3)


def point_of(at: Motion, C_b_i: Floats, lever_b: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and velocity (m/s), (n_epoch, 3) each, of a point of a vehicle such as an antenna.

    at : motion of the vehicle at n_epoch times
    C_b_i : (n_epoch, 3, 3) its attitude
    lever_b : (3,) m, the point in body axes
    """
    return at.r_i + C_b_i @ lever_b, at.v_i + np.einsum("nij,nj->ni", C_b_i, np.cross(at.w_ib_b, lever_b))


def lever_partials(seen: Sight, C_b_i: Floats, w_ib_b: Floats) -> Floats:
    """Return the derivatives of range and range rate by the lever arm in body axes, (n_epoch, n_sat, 2, 3).

    C_b_i (n_epoch, 3, 3) attitude; w_ib_b (n_epoch, 3) rad/s body rate, body axes.
    """
    towards = np.einsum("esi,eij->esj", seen.direction, C_b_i)  # u in body axes
    swinging = np.cross(towards, w_ib_b[:, None, :])  # u . (w x l) = l . (u x w)
    return np.stack([-towards, -swinging - np.einsum("esi,eij->esj", seen.turning, C_b_i)], axis=2)


def ranging_rows(direction: Floats) -> Floats:
    """Return the derivatives (n_sat, 4) of pseudoranges by position and clock bias; direction (n_sat, 3)."""
    return np.column_stack([-direction, np.ones(len(direction))])


def pdop(direction: Floats, tracked: Bools) -> Floats:
    """Return the dilution of precision of position, (n_epoch,): inf without four satellites, or all in one cone.

    direction (n_epoch, n_sat, 3) unit vectors to the satellites; tracked (n_epoch, n_sat).
    """
    found = np.full(len(tracked), np.inf)
    for epoch in np.flatnonzero(tracked.sum(axis=1) >= 4):
        rows = ranging_rows(direction[epoch, tracked[epoch]])
        normal = rows.T @ rows
        if np.linalg.cond(normal) < _ONE_CONE:
            found[epoch] = math.sqrt(np.trace(np.linalg.inv(normal)[:3, :3]))
    return found


def range_rate(direction: Floats, v_sat: Floats, v_antenna: Floats) -> Floats:
    """Return the derivative (m/s) of the distance travelled by the signal, with respect to reception time.

    direction (..., 3) unit vector from antenna to satellite; v_sat at transmission, with respect to transmission time,
    and v_antenna (..., 3) m/s. From differentiating the light-time equation: the satellite's motion counts only as
    fast as transmission time passes, dt_tx/dt_rx = 1 - rate/c.
    """
    towards = _along(direction, v_sat)
    return np.asarray((towards - _along(direction, v_antenna)) / (1.0 + towards / SPEED_OF_LIGHT))


def look_angles(theta0: float, t: Floats, antenna_r: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Return azimuth (from north over east, 0 to 2 pi) and elevation (rad), (n_epoch, n_sat) each.

    The angles are those of the geodetic north-east-down axes below the antenna (n_epoch, 3) m at times t (n_epoch,) s;
    theta0: Earth angle (rad) at the lift-off that t counts from; direction (n_epoch, n_sat, 3).
    """
    theta = earth_angle(theta0, t)
    latitude, longitude, _ = geodetic_from_ecef(ecef_from_eci(antenna_r, theta))
    direction_e = ecef_from_eci(direction, theta[:, None])
    north, east, down = np.moveaxis(np.einsum("nij,nsj->nsi", rotation_e_n(latitude, longitude), direction_e), -1, 0)
    return np.mod(np.arctan2(east, north), 2.0 * np.pi), np.arcsin(np.clip(-down, -1.0, 1.0))


def off_nadir(r_sat: Floats, direction: Floats) -> Floats:
    """Return the angle (rad) at the satellite between its nadir and the antenna.

    r_sat (..., 3) from the Earth's centre; direction (..., 3) unit vector from antenna to satellite, same axes.
    """
    along = np.sum(r_sat * direction, axis=-1) / np.linalg.norm(r_sat, axis=-1)
    return np.asarray(np.arccos(np.clip(along, -1.0, 1.0)))


def occluded(antenna_r: Floats, satellite_r: Floats, grazing: float) -> Bools:
    """Return whether the straight ray from antenna to satellite meets the Earth, (...,) bool.

    antenna_r, satellite_r: (..., 3) m, any axes with z along the pole; grazing: height (m) by which the ray must clear
    the ellipsoid at its lowest point between the two. An antenna below that height loses what it would see by looking
    downwards, and nothing else.
    """
    # stretching z turns the ellipsoid into a sphere and keeps straight lines straight
    stretch = np.array([1.0, 1.0, SEMI_MAJOR / SEMI_MINOR])
    near, far = antenna_r * stretch, satellite_r * stretch
    ray = far - near
    along = -np.sum(near * ray, axis=-1) / np.sum(ray * ray, axis=-1)
    lowest = near + along[..., None] * ray
    ahead = (along > 0.0) & (along < 1.0)
    return np.asarray(ahead & (np.sum(lowest * lowest, axis=-1) < (SEMI_MAJOR + grazing) ** 2))
