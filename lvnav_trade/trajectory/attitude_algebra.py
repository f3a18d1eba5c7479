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
    half_angle = 0.5 * np.sqrt(_squares(p))
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
    p0, p1, p2, p3 = p.T
    q0, q1, q2, q3 = q.T
    w = p0 * q0 - (p1 * q1 + p2 * q2 + p3 * q3)
    x = p0 * q1 + q0 * p1 + (p2 * q3 - p3 * q2)
    y = p0 * q2 + q0 * p2 + (p3 * q1 - p1 * q3)
    z = p0 * q3 + q0 * p3 + (p1 * q2 - p2 * q1)
    return np.stack([w, x, y, z], axis=1)


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
    x2 = _squares(p)
    # the series of a and b below 0.1 rad
    a_last_terms = 1.0 - x2 / 30.0 * (1.0 - x2 / 56.0)
    a = 0.5 - x2 / 24.0 * a_last_terms
    b_last_terms = 1.0 - x2 / 42.0 * (1.0 - x2 / 72.0)
    b = 1.0 / 6.0 - x2 / 120.0 * b_last_terms
    is_large = x2 >= 0.01
    x = np.sqrt(x2[is_large])
    a[is_large] = (1.0 - np.cos(x)) / x**2
    b[is_large] = (x - np.sin(x)) / x**3
    p_cross_dp = frames.cross(p, dp)
    p_cross_p_cross_dp = frames.cross(p, p_cross_dp)
    return np.asarray(dp - a * p_cross_dp + b * p_cross_p_cross_dp)


def _squares(v: Floats) -> Floats:
    """Return the squared lengths (n, 1) of vectors v (n, 3). For rows of three `np.sum` takes four times as long."""
    x, y, z = v.T
    return (x * x + y * y + z * z)[:, None]


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
    q0, q1, q2, q3 = q.T
    s0, s1, s2, s3 = slope.T
    x = q0 * s1 - s0 * q1 - (q2 * s3 - q3 * s2)
    y = q0 * s2 - s0 * q2 - (q3 * s1 - q1 * s3)
    z = q0 * s3 - s0 * q3 - (q1 * s2 - q2 * s1)
    return np.stack([2.0 * x, 2.0 * y, 2.0 * z], axis=1)
