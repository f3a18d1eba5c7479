"""Directions of thrust and body: steering laws blended smoothly, and the attitude spline with its roll."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.jit import array_jit, jit
from lvnav_trade.quantities.frames import earth_angle, eci_from_ecef, quaternions, unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.vehicle_cards import Roll
from lvnav_trade.trajectory.attitude_algebra import body_axes
from lvnav_trade.trajectory.truth import attitude_spline

Direction = tuple[float, float, float]
_STEP = 0.5  # s between knots of the attitude
_DAMPING = 5.0  # s; time in which the body rate decays if no thrust follows
_PEAK = 1.875  # peak slope of the quintic smoothstep


class Steering(NamedTuple):
    """Steering of one ascent. Directions are unit vectors.

    In a linear-tangent law the thrust turns within `slew` to elevation atan(tangent + rate (t - law_start)) above the
    local horizontal. A law that is not in use starts at infinity.

    up_e : (3,). Local vertical at the site, frame e.
    downrange_e : (3,). Horizontal launch direction at the site, frame e.
    theta0 : rad. Earth rotation angle at lift-off.
    kick_start : s since lift-off. Start of the tilt from up to downrange.
    kick_duration : s. Duration of the tilt.
    kick_angle : rad. Angle of the tilt.
    follow_start : s since lift-off. Start of the transition to the direction of the Earth-relative velocity.
    slew : s. Duration of the transition to a linear-tangent law.
    law_start : (n_law,) s since lift-off. Start of each law.
    normal_i : (n_law, 3). Normal of the plane of the thrust, frame i.
    tangent : (n_law,). Tangent of the elevation at the start.
    rate : (n_law,) 1/s. Rate of that tangent.
    """

    up_e: Floats
    downrange_e: Floats
    theta0: float
    kick_start: float
    kick_duration: float
    kick_angle: float
    follow_start: float
    slew: float
    law_start: Floats
    normal_i: Floats
    tangent: Floats
    rate: Floats


@jit
def smoothstep(x: float) -> float:
    """Return the quintic that rises from 0 to 1 for x from 0 to 1, with no slope and no curvature at the ends."""
    x = min(max(x, 0.0), 1.0)
    polynomial = 10.0 + x * (6.0 * x - 15.0)
    return x * x * x * polynomial


@jit
def _blend(weight: float, a: Direction, b: Direction) -> Direction:
    """Return the unit vector that goes from the direction a (weight 0) to b (weight 1)."""
    x = a[0] + weight * (b[0] - a[0])
    y = a[1] + weight * (b[1] - a[1])
    z = a[2] + weight * (b[2] - a[2])
    length = math.sqrt(x * x + y * y + z * z)
    return (
        x / length,
        y / length,
        z / length,
    )


@jit
def _kick_direction(t: float, s: Steering) -> Direction:
    """Return the direction of vertical rise and kick, frame i. Apart from the kick it is fixed to the Earth.

    t : s since lift-off
    """
    progress = smoothstep((t - s.kick_start) / s.kick_duration)
    angle = s.kick_angle * progress
    cosine = math.cos(angle)
    sine = math.sin(angle)
    up, downrange = s.up_e, s.downrange_e
    x = cosine * up[0] + sine * downrange[0]
    y = cosine * up[1] + sine * downrange[1]
    z = cosine * up[2] + sine * downrange[2]
    theta = s.theta0 + OMEGA * t
    cos_theta = math.cos(theta)
    sin_theta = math.sin(theta)
    return (
        cos_theta * x - sin_theta * y,
        sin_theta * x + cos_theta * y,
        z,
    )


@jit
def _linear_tangent(t: float, r: Direction, k: int, s: Steering) -> Direction:
    """Return the direction of a linear-tangent law, frame i.

    It is cos(elevation) along the horizontal normal x r, plus sin(elevation) along r.

    t : s since lift-off
    r : (3,) m, frame i. Position.
    k : index of the law
    """
    normal = s.normal_i[k]
    x, y, z = r[0], r[1], r[2]
    horizontal_x = normal[1] * z - normal[2] * y
    horizontal_y = normal[2] * x - normal[0] * z
    horizontal_z = normal[0] * y - normal[1] * x
    horizontal_square = horizontal_x * horizontal_x + horizontal_y * horizontal_y + horizontal_z * horizontal_z
    horizontal_length = math.sqrt(horizontal_square)
    square_radius = x * x + y * y + z * z
    radius = math.sqrt(square_radius)
    span = t - s.law_start[k]
    tangent = s.tangent[k] + s.rate[k] * span
    secant = math.sqrt(1.0 + tangent * tangent)
    cos_elevation = 1.0 / secant
    along = cos_elevation / horizontal_length
    outward = cos_elevation * tangent / radius
    return (
        along * horizontal_x + outward * x,
        along * horizontal_y + outward * y,
        along * horizontal_z + outward * z,
    )


@jit
def direction(t: float, r: Direction, v: Direction, s: Steering) -> Direction:
    """Return the unit vector of the thrust in frame i.

    Successive laws are blended with a quintic weight, so that the rate of the direction is continuous. This includes
    ignition and cut-off, because in a gravity turn thrust and drag do not rotate the velocity.

    Parameters
    ----------
    t : float
        Time since lift-off (s).
    r, v : (3,) m, m/s
        Position and inertial velocity, frame i.
    s : Steering
        Steering laws.
    """
    u = _kick_direction(t, s)
    weight = smoothstep((t - s.follow_start) / s.kick_duration)
    if weight > 0.0:
        # Velocity relative to the rotating Earth, v - OMEGA x r
        wx = v[0] + OMEGA * r[1]
        wy = v[1] - OMEGA * r[0]
        wz = v[2]
        square_speed = wx * wx + wy * wy + wz * wz
        speed = math.sqrt(square_speed)
        along_airspeed = (wx / speed, wy / speed, wz / speed)
        u = _blend(weight, u, along_airspeed)
    for k in range(s.law_start.size):
        if t > s.law_start[k]:
            law_weight = smoothstep((t - s.law_start[k]) / s.slew)
            law_direction = _linear_tangent(t, r, k, s)
            u = _blend(law_weight, u, law_direction)
    return u


@array_jit
def directions(t: Floats, y: Floats, s: Steering) -> Floats:
    """Return the unit vectors of the thrust along a path (see `direction`).

    Parameters
    ----------
    t : (n,) s
        Times since lift-off.
    y : (n, 6 or more) m, m/s
        Position and inertial velocity, frame i, in the first six columns.
    s : Steering
        Steering laws.

    Returns
    -------
    (n, 3)
        Unit vectors, frame i.
    """
    out = np.empty((t.size, 3))
    for k in range(t.size):
        r = (y[k, 0], y[k, 1], y[k, 2])
        v = (y[k, 3], y[k, 4], y[k, 5])
        u = direction(t[k], r, v, s)
        out[k, 0] = u[0]
        out[k, 1] = u[1]
        out[k, 2] = u[2]
    return out


def roll_angle(roll: Roll, t: Floats) -> Floats:
    """Return the roll angle (n,) in rad at times t (n,): quintic between the card's angles, at most at its rate."""
    change = roll.flight - roll.pad
    if change == 0.0:
        return np.full_like(t, roll.pad)
    # The smoothstep is steepest in its middle, by the factor _PEAK.
    span = t - roll.start
    progress = smoothsteps(span * roll.rate / (_PEAK * abs(change)))
    return np.asarray(roll.pad + change * progress)


def smoothsteps(x: Floats) -> Floats:
    """Return the quintic step of `smoothstep` at every x (n,)."""
    x = np.clip(x, 0.0, 1.0)
    polynomial = 10.0 + x * (6.0 * x - 15.0)
    return np.asarray(x**3 * polynomial)


def ascent_attitude(t: Floats, x: Floats, right_e: Floats, theta0: float, roll: Roll) -> BSpline:
    """Return the quaternion spline of an ascent from its body x axis and the roll programme.

    All phases share this spline, so that attitude and body rate are continuous between them.

    Parameters
    ----------
    t : (n,) s
        Times since lift-off.
    x : (n, 3)
        Unit vectors along the body x axis, frame i.
    right_e : (3,)
        Right-hand side of the launch plane, frame e, to which zero roll refers.
    theta0 : float
        Earth angle at lift-off (rad).
    roll : Roll
        Roll programme.
    """
    theta = earth_angle(theta0, t)
    right = eci_from_ecef(right_e, theta)
    C_b_i = body_axes(x, right, roll_angle(roll, t))
    return attitude_spline(t, quaternions(C_b_i))


def stretch_knots(begin: float, end: float) -> Floats:
    """Return the knots (n,) of the attitude over a stretch (s), both ends included, at least nine."""
    span = end - begin
    n_interval = max(8, int(np.ceil(span / _STEP)))
    return np.linspace(begin, end, n_interval + 1)


def thrust_directions(times: Sequence[Floats], thrusts: Sequence[BSpline | None]) -> list[Floats]:
    """Return the directions (n, 3) at the knots of successive phases, with each common knot only once.

    times : Knots (s) of each phase.
    thrusts : Spline of the direction of the specific force in each phase, of unit length at its knots. None in a coast,
        in which the body turns from the previous thrust to the next. At least one phase is powered.
    """
    powered_phases = [k for k, thrust in enumerate(thrusts) if thrust is not None]
    directions = []
    for k, (t, thrust) in enumerate(zip(times, thrusts, strict=True)):
        is_last = k == len(times) - 1
        knots = t if is_last else t[:-1]
        if thrust is not None:
            directions.append(thrust(knots))
            continue
        earlier_phases = [i for i in powered_phases if i < k]
        later_phases = [i for i in powered_phases if i > k]
        previous_thrust = None
        if earlier_phases:
            last = earlier_phases[-1]
            previous_thrust = (thrusts[last], float(times[last][-1]))
        next_thrust = None
        if later_phases:
            first = later_phases[0]
            next_thrust = (thrusts[first], float(times[first][0]))
        directions.append(_coast_directions(knots, previous_thrust, next_thrust))
    return directions


def _coast_directions(
    t: Floats, previous_thrust: tuple[Any, float] | None, next_thrust: tuple[Any, float] | None
) -> Floats:
    """Return the directions in a coast, between the thrust before it and the thrust after it.

    Both are extrapolated at constant rate and blended by a quintic. If one is missing, the rate of the other decays.

    Parameters
    ----------
    t : (n,) s
        Times.
    previous_thrust : tuple, optional
        Spline of the direction of the previous thrust, and its end (s).
    next_thrust : tuple, optional
        Spline of the direction of the next thrust, and its start (s).

    Returns
    -------
    (n, 3)
        Unit vectors.
    """
    if next_thrust is None:
        assert previous_thrust is not None
        return _decaying_rotation(t, *previous_thrust, 1.0)
    if previous_thrust is None:
        return _decaying_rotation(t, *next_thrust, -1.0)
    previous_spline, begin = previous_thrust
    next_spline, end = next_thrust
    since_begin = (t - begin)[:, None]
    to_end = (t - end)[:, None]
    progress = smoothsteps((t - begin) / (end - begin))
    weight = progress[:, None]
    previous_direction = previous_spline(begin) + since_begin * previous_spline(begin, 1)
    next_direction = next_spline(end) + to_end * next_spline(end, 1)
    mean = (1.0 - weight) * previous_direction + weight * next_direction
    return unit(mean)


def _decaying_rotation(t: Floats, thrust: Any, edge: float, sign: float) -> Floats:
    """Return the directions (n, 3) of a body whose rate decays away from the edge of a thrust.

    t : (n,) s. Times.
    thrust : spline of the direction of the thrust
    edge : s. End or start of the thrust.
    sign : 1 after the thrust, -1 before it
    """
    # Integral of the decaying rate exp(-|t - edge| / _DAMPING)
    span = (t - edge)[:, None]
    decay_fraction = -np.expm1(-sign * span / _DAMPING)
    effective_time = sign * _DAMPING * decay_fraction
    direction = thrust(edge) + effective_time * thrust(edge, 1)
    return unit(direction)
