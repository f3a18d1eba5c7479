"""Rotation vectors and quaternions, scalar first, and body axes of a direction and a roll angle; row by row."""

import numpy as np

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Floats


def rotation_quaternions(p: Floats) -> Floats:
    """Return the quaternions (n, 4), scalar first, of rotation vectors p (n, 3) rad; continuous in p."""
    half = 0.5 * np.linalg.norm(p, axis=1, keepdims=True)
    vector = 0.5 * np.sinc(half / np.pi) * p  # numpy: sinc(x) = sin(pi x)/(pi x)
    return np.concatenate([np.cos(half), vector], axis=1)


def product(p: Floats, q: Floats) -> Floats:
    """Return the quaternion products p q (n, 4): rotation p (n, 4), then q (n, 4) about the rotated axes."""
    p_scalar, p_vector = p[:, :1], p[:, 1:]
    q_scalar, q_vector = q[:, :1], q[:, 1:]
    scalar = p_scalar * q_scalar - np.sum(p_vector * q_vector, axis=1, keepdims=True)
    vector = p_scalar * q_vector + q_scalar * p_vector + np.cross(p_vector, q_vector)
    return np.concatenate([scalar, vector], axis=1)


def rotation_vector_rate(p: Floats, dp: Floats) -> Floats:
    """Return the body rate (n, 3) rad/s of a rotation vector p (n, 3), below half a turn, with derivative dp (n, 3).

    w = dp - a p x dp + b p x (p x dp), with x = |p|, a = (1 - cos x) / x^2 and b = (x - sin x) / x^3.
    """
    x2 = np.sum(p * p, axis=1, keepdims=True)
    is_small = x2 < 0.01
    x = np.sqrt(np.where(is_small, 1.0, x2))  # 1 where the series apply, to avoid 0 / 0
    a_series = 0.5 - x2 / 24.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0))
    b_series = 1.0 / 6.0 - x2 / 120.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0))
    a = np.where(is_small, a_series, (1.0 - np.cos(x)) / x**2)
    b = np.where(is_small, b_series, (x - np.sin(x)) / x**3)
    p_cross_dp = np.cross(p, dp)
    return np.asarray(dp - a * p_cross_dp + b * np.cross(p, p_cross_dp))


def body_axes(x: Floats, right: Floats, roll: Floats) -> Floats:
    """Return the attitude C_b_i (n, 3, 3) of a body with x axis x (n, 3), frame i, and roll angle roll (n,) rad.

    right : (n, 3), frame i. Direction of the y axis at zero roll, before its component along x is removed.
    """
    along_x = np.sum(right * x, axis=1, keepdims=True) * x
    level = frames.unit(right - along_x)
    below = frames.cross(x, level)
    cosine = np.cos(roll)[:, None]
    sine = np.sin(roll)[:, None]
    y = cosine * level + sine * below
    z = cosine * below - sine * level
    return np.stack([x, y, z], axis=-1)
