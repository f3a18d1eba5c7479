"""Quaternions (scalar first, body to inertial) and small rotations, as functions of their components."""

from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import where


@jit
def cross(ax, ay, az, bx, by, bz):
    """Return the three components of the vector product a x b, in the axes of a and b."""
    x = ay * bz - az * by
    y = az * bx - ax * bz
    z = ax * by - ay * bx
    return x, y, z


@inline_jit
def rotate(c, x, y, z):
    """Return the vector C (x, y, z).

    Parameters
    ----------
    c : nine entries of the matrix C, by rows
    x, y, z : components of the vector, any unit

    Returns
    -------
    tuple of 3
        Components of the rotated vector; for C = C_b_i, as from `matrix`, from body axes to frame i.
    """
    return (
        c[0] * x + c[1] * y + c[2] * z,
        c[3] * x + c[4] * y + c[5] * z,
        c[6] * x + c[7] * y + c[8] * z,
    )


@inline_jit
def rotate_back(c, x, y, z):
    """Return the vector C' (x, y, z), the inverse of `rotate` for a rotation matrix.

    Parameters
    ----------
    c : nine entries of the matrix C, by rows
    x, y, z : components of the vector, any unit
    """
    return (
        c[0] * x + c[3] * y + c[6] * z,
        c[1] * x + c[4] * y + c[7] * z,
        c[2] * x + c[5] * y + c[8] * z,
    )


@jit
def multiply(p0, p1, p2, p3, q0, q1, q2, q3):
    """Return the quaternion product p q: the rotation q followed by the rotation p.

    Parameters
    ----------
    p0, p1, p2, p3 : first factor, scalar part first
    q0, q1, q2, q3 : second factor, scalar part first
    """
    return (
        p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
        p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
        p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
        p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
    )


@jit
def matrix(q0, q1, q2, q3):
    """Return the nine entries, by rows, of the rotation matrix from body to inertial axes.

    Parameters
    ----------
    q0, q1, q2, q3 : unit quaternion, scalar part first, body to inertial
    """
    a = q1 + q1  # every product below has the factor 2
    b = q2 + q2
    c = q3 + q3
    xx = a * q1
    yy = b * q2
    zz = c * q3
    xy = a * q2
    xz = a * q3
    yz = b * q3
    wx = a * q0
    wy = b * q0
    wz = c * q0
    return (
        1.0 - yy - zz,
        xy - wz,
        xz + wy,
        xy + wz,
        1.0 - xx - zz,
        yz - wx,
        xz - wy,
        yz + wx,
        1.0 - xx - yy,
    )


@jit
def from_rotation(x, y, z):
    """Return the quaternion of a rotation vector; series to the ninth power, exact to 1e-16 below 0.2 rad.

    Parameters
    ----------
    x, y, z : rad, rotation vector

    Returns
    -------
    tuple of 4
        Quaternion, scalar part first.
    """
    h = 0.25 * (x * x + y * y + z * z)
    # with half of the angle a/2 = sqrt(h): cos(a/2), and sin(a/2) / a
    cosine_tail = 1.0 / 24.0 + h * (-1.0 / 720.0 + h * (1.0 / 40320.0))
    cosine = 1.0 + h * (-0.5 + h * cosine_tail)
    sinc_tail = 1.0 / 240.0 + h * (-1.0 / 10080.0 + h * (1.0 / 725760.0))
    half_sinc = 0.5 + h * (-1.0 / 12.0 + h * sinc_tail)
    return cosine, half_sinc * x, half_sinc * y, half_sinc * z


@jit
def normalise(q0, q1, q2, q3):
    """Return a quaternion of nearly unit length, normalised by one Newton step for 1 / |q|.

    The norm may differ from 1 by rounding and integration errors e: an error of order e^2 remains.
    """
    square = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    scale = 1.5 - 0.5 * square
    return scale * q0, scale * q1, scale * q2, scale * q3


@jit
def small_rotation(p0, p1, p2, p3, q0, q1, q2, q3):
    """Return the small rotation vector (rad) from attitude q to attitude p, in inertial axes (p = rotation * q).

    Parameters
    ----------
    p0, p1, p2, p3 : quaternion, body to inertial, for example the true attitude
    q0, q1, q2, q3 : quaternion, body to inertial, for example the estimated attitude
    """
    d0, d1, d2, d3 = multiply(p0, p1, p2, p3, q0, -q1, -q2, -q3)
    return rotation_vector(d0, d1, d2, d3)


@jit
def rotation_vector(d0, d1, d2, d3):
    """Return the small rotation vector (rad) of a unit quaternion.

    Parameters
    ----------
    d0, d1, d2, d3 : quaternion, scalar part first; its negative gives the same result
    """
    # angle = 2 asin(|d|), with the cubic term of the arc sine; q and -q are the same attitude, hence the sign
    sine_square = d1 * d1 + d2 * d2 + d3 * d3
    series = 1.0 + sine_square * (1.0 / 6.0)
    factor = where(d0 < 0.0, -2.0, 2.0) * series
    return factor * d1, factor * d2, factor * d3
