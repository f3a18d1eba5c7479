"""Where a body points: laws one after the other, each turned to along the shortest way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.frames import earth_angle, earth_velocity, eci_from_ecef, matrices, quaternions, unit
from lvnav_trade.world.ascent.attitude import smoothsteps
from lvnav_trade.world.truth import body_axes, product, rotation_quaternions

Floats = NDArray[np.float64]
Axes = Callable[[Floats, Floats], Floats]  # times (n,) and states (n, 6 or more) to C_b_i (n, 3, 3)


class Mode(NamedTuple):
    """A law of attitude that holds from `start` (s) on, turned to within `slew` seconds."""

    start: float
    slew: float
    axes: Axes


def attitude(modes: Sequence[Mode], t: Floats, y: Floats) -> Floats:
    """Return quaternions q_b_i (n, 4), of continuous sign, at rising times t (n,) and states y (n, 6 or more).

    A turn goes about the axis that leads from one law's attitude to the other's, the angle by a quintic in time. Turns
    of more than half a circle do not come up, but one of exactly half a circle is as good either way; over successive
    times it keeps to one.
    """
    q = quaternions(modes[0].axes(t, y))
    for mode in modes[1:]:
        first = int(np.searchsorted(t, mode.start, side="right"))
        if first == t.size:
            continue
        here = slice(first, None)
        goal = quaternions(mode.axes(t[here], y[here]))
        way = product(q[here] * [1.0, -1.0, -1.0, -1.0], goal)
        way *= np.where(way[0, 0] < 0.0, -1.0, 1.0)
        length = np.linalg.norm(way[:, 1:], axis=1)
        angle = 2.0 * np.arctan2(length, way[:, 0])
        done = smoothsteps((t[here] - mode.start) / mode.slew) if mode.slew > 0.0 else np.ones(t.size - first)
        axis = way[:, 1:] / np.where(length > 0.0, length, 1.0)[:, None]
        q[here] = product(q[here], rotation_quaternions((done * angle)[:, None] * axis))
    return q


def nose(modes: Sequence[Mode], t: float, y: Floats) -> Floats:
    """Return the direction (3,) of the body's x axis, frame i, at a time and state (6 or more)."""
    at, state = np.array([t]), y[None]
    begun = [mode for mode in modes[1:] if mode.start < t]
    last = begun[-1] if begun else modes[0]
    if not begun or t >= last.start + last.slew:
        return np.asarray(last.axes(at, state)[0, :, 0])
    return np.asarray(matrices(attitude([modes[0], *begun], at, state))[0, :, 0])


def fixed_to_earth(x_e: Floats, right_e: Floats, theta0: float) -> Axes:
    """Return the law of a body at rest on the Earth: x axis and right-hand side, each (3,) in frame e."""

    def axes(t: Floats, y: Floats) -> Floats:
        theta = earth_angle(theta0, t)
        x, right = (eci_from_ecef(np.broadcast_to(side, (t.size, 3)), theta) for side in (x_e, right_e))
        return body_axes(x, right, np.zeros(t.size))

    return axes


def along_airspeed(right_e: Floats, theta0: float) -> Axes:
    """Return the law of a body that flies nose first through air that turns with the Earth."""

    def axes(t: Floats, y: Floats) -> Floats:
        right = eci_from_ecef(np.broadcast_to(right_e, (t.size, 3)), earth_angle(theta0, t))
        return body_axes(unit(earth_velocity(y[:, :3], y[:, 3:6])), right, np.zeros(t.size))

    return axes


def fixed_to_stars(C_b_i: Floats) -> Axes:
    """Return the law of a body that keeps its attitude C_b_i (3, 3)."""
    return lambda t, y: np.broadcast_to(C_b_i, (t.size, 3, 3)).copy()


def along_velocity(sign: float = 1.0) -> Axes:
    """Return the law of a body whose x axis is along (sign 1) or against (-1) the inertial velocity, z axis down."""

    def axes(t: Floats, y: Floats) -> Floats:
        across = unit(np.cross(y[:, 3:6], y[:, :3]))  # to the right of one that flies forward, upright
        return body_axes(sign * unit(y[:, 3:6]), sign * across, np.zeros(t.size))

    return axes


def level(t: Floats, y: Floats) -> Floats:
    """Return the axes (n, 3, 3) of a body whose x axis is horizontal in its orbital plane, forward, z to the centre."""
    across = unit(np.cross(y[:, 3:6], y[:, :3]))
    return body_axes(unit(np.cross(y[:, :3], across)), across, np.zeros(t.size))


def turned(axes: Axes, pitch: float, yaw: float) -> Axes:
    """Return a law whose attitude stands off another's by a yaw to the right, then a pitch up (rad), body axes."""
    if pitch == 0.0 and yaw == 0.0:
        return axes
    offset = matrices(product(rotation_quaternions(np.array([[0.0, 0.0, yaw]])),
                              rotation_quaternions(np.array([[0.0, pitch, 0.0]]))))[0]  # fmt: skip
    return lambda t, y: axes(t, y) @ offset
