"""Rotation vectors and quaternions, scalar first, and body axes of a direction and a roll angle; row by row."""

import numpy as np

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Floats


def rotation_quaternions(p: Floats) -> Floats:
    """Return the quaternions of rotation vectors; continuous in p.

    Parameters
    ----------
    p : (n, 3) rad
        Rotation vectors.

    Returns
    -------
    (n, 4)
        Unit quaternions, scalar first.
    """
    half_angle = 0.5 * np.linalg.norm(p, axis=1, keepdims=True)
    sine_ratio = np.sinc(half_angle / np.pi)  # numpy: sinc(x) = sin(pi x)/(pi x)
    scalar = np.cos(half_angle)
    vector = 0.5 * sine_ratio * p
    return np.concatenate([scalar, vector], axis=1)


def product(p: Floats, q: Floats) -> Floats:
    """Return the quaternion products p q: rotation p, then q about the rotated axes.

    Parameters
    ----------
    p, q : (n, 4)
        Quaternions, scalar first.

    Returns
    -------
    (n, 4)
        Products, scalar first.
    """
    p_scalar = p[:, :1]
    p_vector = p[:, 1:]
    q_scalar = q[:, :1]
    q_vector = q[:, 1:]
    dot = np.sum(p_vector * q_vector, axis=1, keepdims=True)
    cross = frames.cross(p_vector, q_vector)
    scalar = p_scalar * q_scalar - dot
    vector = p_scalar * q_vector + q_scalar * p_vector + cross
    return np.concatenate([scalar, vector], axis=1)


def rotation_vector_rate(p: Floats, dp: Floats) -> Floats:
    """Return the body rate of a rotation vector below half a turn.

    w = dp - a p x dp + b p x (p x dp), with x = |p|, a = (1 - cos x) / x^2 and b = (x - sin x) / x^3.

    Parameters
    ----------
    p : (n, 3) rad
        Rotation vectors.
    dp : (n, 3) rad/s
        Their time derivatives.

    Returns
    -------
    (n, 3) rad/s
        Body rates w, rotated (body) axes.
    """
    x2 = np.sum(p * p, axis=1, keepdims=True)
    is_small = x2 < 0.01
    x = np.sqrt(np.where(is_small, 1.0, x2))  # 1 where the series apply, to avoid 0 / 0
    # a = (1 - cos x) / x^2 and its series
    a_closed = (1.0 - np.cos(x)) / x**2
    a_last_terms = 1.0 - x2 / 30.0 * (1.0 - x2 / 56.0)
    a_series = 0.5 - x2 / 24.0 * a_last_terms
    a = np.where(is_small, a_series, a_closed)
    # b = (x - sin x) / x^3 and its series
    b_closed = (x - np.sin(x)) / x**3
    b_last_terms = 1.0 - x2 / 42.0 * (1.0 - x2 / 72.0)
    b_series = 1.0 / 6.0 - x2 / 120.0 * b_last_terms
    b = np.where(is_small, b_series, b_closed)
    p_cross_dp = np.cross(p, dp)
    p_cross_p_cross_dp = np.cross(p, p_cross_dp)
    return np.asarray(dp - a * p_cross_dp + b * p_cross_p_cross_dp)


def body_axes(x: Floats, right: Floats, roll: Floats) -> Floats:
    """Return the attitude of a body from its x axis and a roll angle.

    Parameters
    ----------
    x : (n, 3)
        Unit vectors along the body x axis, frame i.
    right : (n, 3)
        Direction of the y axis at zero roll, frame i. Its component along x is removed.
    roll : (n,) rad
        Roll angles, positive about x.

    Returns
    -------
    (n, 3, 3)
        C_b_i, from body axes to frame i. Its columns are the body axes.
    """
    right_dot_x = np.sum(right * x, axis=1, keepdims=True)
    along_x = right_dot_x * x
    level = frames.unit(right - along_x)
    down = frames.cross(x, level)
    cosine = np.cos(roll)[:, None]
    sine = np.sin(roll)[:, None]
    y = cosine * level + sine * down
    z = cosine * down - sine * level
    return np.stack([x, y, z], axis=-1)


def quaternion_rate(q: Floats, slope: Floats) -> Floats:
    """Return 2 vec(q* slope) (n, 3): the body rate of a quaternion q (n, 4) of unit length with derivative slope.

    The part of the derivative that changes the length is along q and has no vector part in the product.
    """
    scalar = q[:, :1]
    vector = q[:, 1:]
    scalar_slope = slope[:, :1]
    vector_slope = slope[:, 1:]
    cross = np.cross(vector, vector_slope)
    half_rate = scalar * vector_slope - scalar_slope * vector - cross
    return np.asarray(2.0 * half_rate)
