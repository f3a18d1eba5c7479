"""The Earth as a formula: WGS-84 constants, gravitation of zonal harmonics and its gradient.

The scalar formulas use only + - * / and `sqrt`, so that they step one run or eight lanes of runs alike. They are
valid in any frame whose z axis is the Earth's polar axis, Earth-fixed or inertial.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import array_jit, jit
from lvnav_trade.kernels.lanes import sqrt

# WGS-84 defining constants (NGA.STND.0036), and constants derived from them.
SEMI_MAJOR = 6378137.0  # m
FLATTENING = 1.0 / 298.257223563
SEMI_MINOR = SEMI_MAJOR * (1.0 - FLATTENING)
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)  # first eccentricity squared
SECOND_ECCENTRICITY_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2)
GM = 3.986004418e14  # m^3/s^2, atmosphere included
OMEGA = 7.292115e-5  # rad/s

# Zonal harmonics, unnormalised: J_n = -sqrt(2 n + 1) C_n0. C_20 of WGS-84; C_30 and C_40 of EGM96.
J2 = math.sqrt(5.0) * 0.484166774985e-3
J3 = -math.sqrt(7.0) * 0.957254173792e-6
J4 = -3.0 * 0.539873863789e-6


@jit
def gravity_point(x: Any, y: Any, z: Any) -> Any:
    """Return the gravitation (gx, gy, gz) in m/s^2 of a point mass, in the axes of the position.

    Parameters
    ----------
    x, y, z : m, position relative to the Earth's centre; any axes
    """
    r2 = x * x + y * y + z * z
    k = GM / (r2 * sqrt(r2))
    return -(k * x), -(k * y), -(k * z)


@jit
def gravity_j2(x: Any, y: Any, z: Any) -> Any:
    """Return the gravitation (gx, gy, gz) in m/s^2 with J2, in the axes of the position.

    g = -GM / r^3 (x (1 - c (5 s^2 - 1)), y (1 - c (5 s^2 - 1)), z (1 - c (5 s^2 - 3))), c = 3/2 J2 (a/r)^2, s = z/r
    (Groves, 2nd ed., chapter 2).

    Parameters
    ----------
    x, y, z : m, position relative to the Earth's centre, z along the polar axis
    """
    r2 = x * x + y * y + z * z
    k = GM / (r2 * sqrt(r2))
    c2 = 1.5 * J2 * SEMI_MAJOR * SEMI_MAJOR / r2
    s2 = z * z / r2
    horizontal = k * (1.0 - c2 * (5.0 * s2 - 1.0))
    vertical = k * (1.0 - c2 * (5.0 * s2 - 3.0))
    return -(horizontal * x), -(horizontal * y), -(vertical * z)


@jit
def gravity_j4(x: Any, y: Any, z: Any) -> Any:
    """Return the gravitation (gx, gy, gz) in m/s^2 with J2, J3 and J4, in the axes of the position.

    Gradient of GM/r (1 - sum J_n (a/r)^n P_n(z/r)); with P'_(n+1) = (n+1) P_n + s P'_n it splits into a part along the
    radius, factor 1 - sum J_n (a/r)^n P'_(n+1)(s), and a part along the polar axis, factor sum J_n (a/r)^n P'_n(s).

    Parameters
    ----------
    x, y, z : m, position relative to the Earth's centre, z along the polar axis
    """
    r2 = x * x + y * y + z * z
    r = sqrt(r2)
    s = z / r
    s2 = s * s
    q = SEMI_MAJOR / r
    q2 = q * q
    c2 = J2 * q2
    c3 = J3 * (q2 * q)
    c4 = J4 * (q2 * q2)
    # slope3: P'_3, and so on
    slope3 = 7.5 * s2 - 1.5
    slope4 = (17.5 * s2 - 7.5) * s
    slope5 = (39.375 * s2 - 26.25) * s2 + 1.875
    k = GM / r2
    slope2 = 3.0 * s
    radial_sum = 1.0 - c2 * slope3 - c3 * slope4 - c4 * slope5
    polar_sum = c2 * slope2 + c3 * slope3 + c4 * slope4
    radial = k * radial_sum / r
    polar = k * polar_sum
    return -(radial * x), -(radial * y), -(radial * z) - polar


@jit
def gravity_gradient(x: Any, y: Any, z: Any) -> Any:
    """Return the gradient (xx, xy, xz, yy, yz, zz) in 1/s^2 of `gravity_j2`, in the axes of the position.

    Without J2 it is GM / r^3 (3 u u' - I), with u the unit vector of the position.

    Parameters
    ----------
    x, y, z : m, position relative to the Earth's centre, z along the polar axis
    """
    r2 = x * x + y * y + z * z
    x2 = x * x / r2
    y2 = y * y / r2
    z2 = z * z / r2
    k = GM / (r2 * sqrt(r2))
    c = 1.5 * J2 * SEMI_MAJOR * SEMI_MAJOR / r2
    level_factor = 3.0 + c * (5.0 - 35.0 * z2)  # factor of the products of horizontal coordinates
    inner_factor = 1.0 - c * (5.0 * z2 - 1.0)
    steep_factor = 3.0 + c * (15.0 - 35.0 * z2)  # factor of the products with z
    tilt_factor = k * steep_factor / r2
    polar = 30.0 * z2 - 3.0 - 35.0 * z2 * z2
    xx = k * (level_factor * x2 - inner_factor)
    yy = k * (level_factor * y2 - inner_factor)
    zz = k * (3.0 * z2 - 1.0 + c * polar)
    xy = k * level_factor * x * y / r2
    xz = tilt_factor * x * z
    yz = tilt_factor * y * z
    return xx, xy, xz, yy, yz, zz


@jit
def height_and_normal(x: Any, y: Any, z: Any) -> Any:
    """Return the height over the ellipsoid and the upward normal of the ellipsoid.

    One step of Bowring's latitude (Survey Review 23, 1976) without a division by the distance from the polar axis. The
    height does not depend on the latitude's error to first order; it is accurate to 1e-6 m up to 100 km.

    Parameters
    ----------
    x, y, z : m, position relative to the Earth's centre, z along the polar axis

    Returns
    -------
    height : m
    ux, uy, uz : unit vector of the normal, in the axes of the position
    """
    p2 = x * x + y * y
    s = z * (SEMI_MAJOR / SEMI_MINOR)
    n2 = p2 + s * s
    n3 = n2 * sqrt(n2)
    k = 1.0 - ECCENTRICITY_2 * SEMI_MAJOR * p2 / n3
    polar = z + SECOND_ECCENTRICITY_2 * SEMI_MINOR * (s * s * s) / n3
    scale = 1.0 / sqrt(p2 * (k * k) + polar * polar)
    level = k * scale
    sine = polar * scale  # of the latitude
    # distance of the surface from the centre along the normal
    surface = SEMI_MAJOR * sqrt(1.0 - ECCENTRICITY_2 * (sine * sine))
    height = p2 * level + z * sine - surface
    return height, x * level, y * level, sine


@array_jit
def gravity_along(r: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `gravity_j4` at positions r (n, 3) in m, frame i or e, as (n, 3) in m/s^2, the same frame."""
    g = np.empty_like(r)
    for k in range(r.shape[0]):
        gx, gy, gz = gravity_j4(r[k, 0], r[k, 1], r[k, 2])
        g[k, 0] = gx
        g[k, 1] = gy
        g[k, 2] = gz
    return g
