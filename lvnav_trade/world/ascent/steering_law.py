"""Where the thrust points: vertical rise, kick, gravity turn and linear-tangent laws, blended without a jump."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.jit import jit, making_arrays

Floats = NDArray[np.float64]
Direction = tuple[float, float, float]


class Steering(NamedTuple):
    """The steering of one ascent. Times in s since lift-off, angles in rad, vectors of length one.

    up_e, downrange_e (3,) in frame e at the site; theta0 Earth angle at lift-off; the kick tilts from up to downrange;
    `follow_start` begins the blend to the Earth-relative velocity. Linear-tangent laws, each (n_law,) and normal_i
    (n_law, 3): from `law_start` the thrust turns within `slew` to elevation atan(tangent + rate (t - law_start)) above
    the local horizontal, in the plane of normal_i. A law that is not in use starts at infinity.
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
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


@jit
def _blend(weight: float, a: Direction, b: Direction) -> Direction:
    """Return the unit vector that goes from the direction a (weight 0) to b (weight 1)."""
    x = a[0] + weight * (b[0] - a[0])
    y = a[1] + weight * (b[1] - a[1])
    z = a[2] + weight * (b[2] - a[2])
    n = math.sqrt(x * x + y * y + z * z)
    return x / n, y / n, z / n


@jit
def _tilted(t: float, s: Steering) -> Direction:
    """Return the Earth-fixed direction of rise and kick, in frame i."""
    angle = s.kick_angle * smoothstep((t - s.kick_start) / s.kick_duration)
    c, d = math.cos(angle), math.sin(angle)
    x = c * s.up_e[0] + d * s.downrange_e[0]
    y = c * s.up_e[1] + d * s.downrange_e[1]
    theta = s.theta0 + OMEGA * t
    ct, st = math.cos(theta), math.sin(theta)
    return ct * x - st * y, st * x + ct * y, c * s.up_e[2] + d * s.downrange_e[2]


@jit
def _linear_tangent(t: float, r: Direction, k: int, s: Steering) -> Direction:
    """Return the direction of law k at position r, in frame i."""
    n = s.normal_i[k]
    hx, hy, hz = n[1] * r[2] - n[2] * r[1], n[2] * r[0] - n[0] * r[2], n[0] * r[1] - n[1] * r[0]
    h = math.sqrt(hx * hx + hy * hy + hz * hz)
    length = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    slope = s.tangent[k] + s.rate[k] * (t - s.law_start[k])
    level = 1.0 / math.sqrt(1.0 + slope * slope)
    along, out = level / h, level * slope / length
    return along * hx + out * r[0], along * hy + out * r[1], along * hz + out * r[2]


@jit
def direction(t: float, r: Direction, v: Direction, s: Steering) -> Direction:
    """Return the unit vector of the thrust in frame i at time t, position r (m) and inertial velocity v (m/s).

    Each law hands over to the next with a quintic weight, so that the direction has a continuous rate wherever velocity
    is continuous: at ignition and cut-off too, because in a gravity turn thrust and drag do not turn the velocity.
    """
    u = _tilted(t, s)
    weight = smoothstep((t - s.follow_start) / s.kick_duration)
    if weight > 0.0:
        wx, wy, wz = v[0] + OMEGA * r[1], v[1] - OMEGA * r[0], v[2]
        w = math.sqrt(wx * wx + wy * wy + wz * wz)
        u = _blend(weight, u, (wx / w, wy / w, wz / w))
    for k in range(s.law_start.size):
        if t > s.law_start[k]:
            u = _blend(smoothstep((t - s.law_start[k]) / s.slew), u, _linear_tangent(t, r, k, s))
    return u


@making_arrays
def directions(t: Floats, y: Floats, s: Steering) -> Floats:
    """Return `direction` (n, 3) at times t (n,) and states y (n, 6 or more) of position and velocity."""
    out = np.empty((t.size, 3))
    for k in range(t.size):
        u = direction(t[k], (y[k, 0], y[k, 1], y[k, 2]), (y[k, 3], y[k, 4], y[k, 5]), s)
        out[k, 0], out[k, 1], out[k, 2] = u
    return out
