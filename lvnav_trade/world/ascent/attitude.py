"""Attitude of an ascent: the roll programme, the axes over pad and flight, one spline for all phases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lvnav_trade.frames import earth_angle, eci_from_ecef, quaternions
from lvnav_trade.world.ascent.vehicle import Roll
from lvnav_trade.world.truth import attitude_spline, body_axes

Floats = NDArray[np.float64]

_PEAK = 1.875  # peak slope of the quintic smoothstep


def roll_angle(roll: Roll, t: Floats) -> Floats:
    """Return the roll angle (n,) in rad at times t (n,): quintic between the card's angles, at most at its rate."""
    change = roll.flight - roll.pad
    if change == 0.0:
        return np.full_like(t, roll.pad)
    return np.asarray(roll.pad + change * smoothsteps((t - roll.start) * roll.rate / (_PEAK * abs(change))))


def smoothsteps(x: Floats) -> Floats:
    """Return the quintic step of `steering.smoothstep` at every x (n,)."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 + x * (6.0 * x - 15.0)))


def ascent_attitude(t: Floats, x: Floats, right_e: Floats, theta0: float, roll: Roll) -> BSpline:
    """Return the quaternion spline of a body whose x axis is x (n, 3), frame i, at times t (n,).

    `right_e` (3,), fixed to the Earth, is the right-hand side of the launch plane, which zero roll refers to. One
    spline serves all phases, so attitude and body rate are continuous across them.
    """
    right = eci_from_ecef(np.broadcast_to(right_e, x.shape), earth_angle(theta0, t))
    return attitude_spline(t, quaternions(body_axes(x, right, roll_angle(roll, t))))
