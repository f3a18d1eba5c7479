"""Attitude of a flight of which only the path is known: x axis along the specific force, or along the velocity."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from lvnav_trade.errors import InputError
from lvnav_trade.frames import (
    earth_angle,
    earth_velocity,
    ecef_from_eci,
    eci_from_ecef,
    geodetic_from_ecef,
    rotation_e_n,
    unit,
)
from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.world.ascent.attitude import ascent_attitude, smoothsteps
from lvnav_trade.world.ascent.vehicle import Roll

Floats = NDArray[np.float64]

_STEP = 0.5  # s between knots
_PAD_STEP = 2.5  # s between knots on the pad
_COAST = 0.5  # m/s^2; a stretch with less specific force than this (median) is a coast
_DAMPING = 5.0  # s, in which the turn of the body dies away after the last thrust
_SLOW, _FAST = 1.0, 20.0  # m/s; upright below, along the velocity above, blended between
_EDGE = 1e-9  # s by which a time is kept within its stretch: force is one-sided at a break


def along_path(
    position: BSpline, edges: list[float], theta0: float, along: Literal["thrust", "velocity"], roll: Roll, hold: float
) -> BSpline:
    """Return the quaternion spline of the body, from `hold` seconds before the first edge, at rest on the Earth there.

    position: spline in frame i; edges (n + 1,) of its n stretches, in s. InputError where the x axis is to lie along a
    thrust that is nowhere.
    """
    times = [_knots(begin, end) for begin, end in pairwise(edges)]
    t = np.concatenate([*(part[:-1] for part in times), times[-1][-1:]])
    x = _along_force(position, times) if along == "thrust" else _along_velocity(position, t, theta0)
    right_e = _right_of_path(position, edges, theta0)
    if hold > 0.0:
        before = edges[0] + np.linspace(-hold, 0.0, max(8, int(np.ceil(hold / _PAD_STEP))) + 1)[:-1]
        fixed = ecef_from_eci(x[0], earth_angle(theta0, edges[0]))
        x = np.concatenate([eci_from_ecef(np.tile(fixed, (before.size, 1)), earth_angle(theta0, before)), x])
        t = np.concatenate([before, t])
    return ascent_attitude(t, x, right_e, theta0, roll)


def _knots(begin: float, end: float) -> Floats:
    return np.linspace(begin, end, max(8, int(np.ceil((end - begin) / _STEP))) + 1)


def _along_force(position: BSpline, times: list[Floats]) -> Floats:
    """Return the directions (n, 3) along the specific force, and through the coasts from one thrust to the next."""
    thrust: list[BSpline | None] = []
    for t in times:
        inside = np.clip(t, t[0] + _EDGE, t[-1] - _EDGE)
        force = position(inside, 2) - gravity_along(position(inside))
        powered = float(np.median(np.linalg.norm(force, axis=1))) > _COAST
        thrust.append(make_interp_spline(t, unit(force), k=5) if powered else None)
    if all(one is None for one in thrust):
        raise InputError("there is no thrust to point along: give columns of attitude, or pointing: velocity")
    found = []
    for k, t in enumerate(times):
        here = thrust[k]
        part = t if k == len(times) - 1 else t[:-1]
        if here is not None:
            found.append(unit(here(part)))
            continue
        earlier = next((i for i in range(k - 1, -1, -1) if thrust[i] is not None), None)
        later = next((i for i in range(k + 1, len(times)) if thrust[i] is not None), None)
        ends = [None if i is None else thrust[i] for i in (earlier, later)]
        found.append(_turn(part, ends[0], ends[1], float(times[earlier or 0][-1]), float(times[later or 0][0])))
    return np.concatenate(found)


def _turn(t: Floats, before: BSpline | None, after: BSpline | None, begin: float, end: float) -> Floats:
    """Return the directions (n, 3) through a coast from the thrust that ends at `begin` to the one from `end` on.

    Both go on at the rate they have there and are blended; where one is missing, the rate of the other dies away.
    """
    if before is None:
        assert after is not None
        return unit(after(end) - _DAMPING * -np.expm1((t - end)[:, None] / _DAMPING) * after(end, 1))
    if after is None:
        return unit(before(begin) + _DAMPING * -np.expm1(-(t - begin)[:, None] / _DAMPING) * before(begin, 1))
    weight = smoothsteps((t - begin) / (end - begin))[:, None]
    leaving = before(begin) + (t - begin)[:, None] * before(begin, 1)
    arriving = after(end) + (t - end)[:, None] * after(end, 1)
    return unit((1.0 - weight) * leaving + weight * arriving)


def _along_velocity(position: BSpline, t: Floats, theta0: float) -> Floats:
    """Return the directions (n, 3) of the Earth-relative velocity, upright where there is none."""
    r = position(t)
    v = earth_velocity(r, position(t, 1))
    speed = np.linalg.norm(v, axis=1)
    theta = earth_angle(theta0, t)
    latitude, longitude, _ = geodetic_from_ecef(ecef_from_eci(r, theta))
    up = eci_from_ecef(-rotation_e_n(latitude, longitude)[:, 2], theta)
    weight = smoothsteps((speed - _SLOW) / (_FAST - _SLOW))[:, None]
    return unit((1.0 - weight) * up + weight * v / np.maximum(speed, _SLOW)[:, None])


def _right_of_path(position: BSpline, edges: list[float], theta0: float) -> Floats:
    """Return the unit vector (3,) of frame e to the right of the path; to the south of one that goes straight up."""
    first, last = (ecef_from_eci(position(t), earth_angle(theta0, t)) for t in (edges[0], edges[-1]))
    latitude, longitude, _ = geodetic_from_ecef(first)
    north, _, down = rotation_e_n(latitude, longitude)
    right = np.cross(last - first, -down)
    length = float(np.linalg.norm(right))
    return np.asarray(right / length if length > 1.0 else -north)
