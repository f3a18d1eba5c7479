"""Local geographic axes: rotation rate, motion, and transformation from and to Earth-fixed axes.

A *place* is latitude, longitude and height as one vector in Earth-fixed axes: the normal of the ellipsoid, with length
1 + height / semi-major axis. It needs no trigonometric functions, so the same source runs one run or eight lanes. North
and east are undefined at a pole; a trajectory within metres of a pole loses precision.
"""

from lvnav_trade.kernels.attitude import cross, multiply
from lvnav_trade.kernels.earth import ECCENTRICITY_2, OMEGA, SEMI_MAJOR, height_and_up
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt, where

NED, ENU = 1, 2
_ROUNDS = 3  # iterations of the latitude; each reduces the error to 0.7 %


@jit
def place_of(px, py, pz):
    """Return normal (3), height (m) and radii of curvature (m) of meridian and prime vertical at a place."""
    length = sqrt(px * px + py * py + pz * pz)
    ux, uy, uz = px / length, py / length, pz / length
    squash = 1.0 - ECCENTRICITY_2 * (uz * uz)
    prime = SEMI_MAJOR / sqrt(squash)
    return ux, uy, uz, (length - 1.0) * SEMI_MAJOR, prime * (1.0 - ECCENTRICITY_2) / squash, prime


@jit
def position_of(px, py, pz):
    """Return the position (3) m of a place, Earth-fixed axes."""
    ux, uy, uz, height, _, prime = place_of(px, py, pz)
    return (prime + height) * ux, (prime + height) * uy, (prime * (1.0 - ECCENTRICITY_2) + height) * uz


@jit
def axes_of(code, px, py, pz):
    """Return the nine entries, by rows, of the matrix from Earth-fixed to local axes at a place; code: NED or ENU."""
    length = sqrt(px * px + py * py + pz * pz)
    ux, uy, uz = px / length, py / length, pz / length
    level = sqrt(ux * ux + uy * uy)
    ex, ey, ez = -uy / level, ux / level, 0.0 * ux
    nx, ny, nz = -uz * ux / level, -uz * uy / level, level
    if code == NED:
        return nx, ny, nz, ex, ey, ez, -ux, -uy, -uz
    return ex, ey, ez, nx, ny, nz, ux, uy, uz


@jit
def north_east_up(code, x, y, z):
    """Return the north, east and up components of a vector given in local axes; code: NED or ENU."""
    if code == NED:
        return x, y, -z
    return y, x, z


@jit
def local(code, north, east, up):
    """Return a vector in local axes from its north, east and up components; code: NED or ENU."""
    if code == NED:
        return north, east, -up
    return east, north, up


@jit
def transport_rate(code, px, py, pz, vx, vy, vz):
    """Return the transport rate (3) rad/s, local axes: rotation of the local axes relative to the Earth.

    px, py, pz : place; vx, vy, vz : m/s, velocity relative to the Earth, local axes
    """
    ux, uy, uz, height, meridian, prime = place_of(px, py, pz)
    north, east, _ = north_east_up(code, vx, vy, vz)
    along = east / (prime + height)
    return local(code, along, -north / (meridian + height), along * uz / sqrt(ux * ux + uy * uy))


@jit
def earth_rate(code, px, py, pz):
    """Return the Earth rate (3) rad/s in local axes at a place."""
    length = sqrt(px * px + py * py + pz * pz)
    return local(code, OMEGA * sqrt(px * px + py * py) / length, 0.0 * px, OMEGA * pz / length)


@jit
def moving(px, py, pz, code, vx, vy, vz):
    """Return the time derivative (3) 1/s of a place, for a velocity vx, vy, vz (m/s) in local axes."""
    ux, uy, uz, height, meridian, prime = place_of(px, py, pz)
    north, east, up = north_east_up(code, vx, vy, vz)
    level, length = sqrt(ux * ux + uy * uy), 1.0 + height / SEMI_MAJOR
    a, b, c = length * north / (meridian + height), length * east / (prime + height) / level, up / SEMI_MAJOR
    return (
        -a * uz * ux / level - b * uy + c * ux,
        -a * uz * uy / level + b * ux + c * uy,
        a * level + c * uz,
    )


@jit
def falling(code, px, py, pz, vx, vy, vz, gx, gy, gz):
    """Return the derivative of the velocity without specific force (3) m/s^2, local axes.

    It has gravitation and centrifugal acceleration, minus (2 w_ie + w_en) x v: Coriolis and transport terms.

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    vx, vy, vz : m/s, velocity relative to the Earth, local axes
    gx, gy, gz : m/s^2, gravitation, Earth-fixed axes
    """
    x, y, _ = position_of(px, py, pz)
    gx, gy = gx + OMEGA * OMEGA * x, gy + OMEGA * OMEGA * y
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = axes_of(code, px, py, pz)
    ix, iy, iz = earth_rate(code, px, py, pz)
    tx, ty, tz = transport_rate(code, px, py, pz, vx, vy, vz)
    kx, ky, kz = cross(2.0 * ix + tx, 2.0 * iy + ty, 2.0 * iz + tz, vx, vy, vz)
    return (
        c0 * gx + c1 * gy + c2 * gz - kx,
        c3 * gx + c4 * gy + c5 * gz - ky,
        c6 * gx + c7 * gy + c8 * gz - kz,
    )


@jit
def turning(code, px, py, pz, vx, vy, vz):
    """Return the rotation rate (3) rad/s of the local axes in inertial space, local axes: w_ie + w_en."""
    ix, iy, iz = earth_rate(code, px, py, pz)
    tx, ty, tz = transport_rate(code, px, py, pz, vx, vy, vz)
    return ix + tx, iy + ty, iz + tz


@jit
def _quaternion(m0, m1, m2, m3, m4, m5, m6, m7, m8):
    """Return the quaternion of a rotation matrix given by rows, starting from its largest component for accuracy."""
    t0, t1, t2, t3 = 1.0 + m0 + m4 + m8, 1.0 + m0 - m4 - m8, 1.0 - m0 + m4 - m8, 1.0 - m0 - m4 + m8
    a, b, c = m7 - m5, m2 - m6, m3 - m1
    d, e, f = m3 + m1, m2 + m6, m7 + m5
    q0, q1, q2, q3, t = t0, a, b, c, t0
    q0, q1, q2, q3, t = (
        where(t1 > t, a, q0), where(t1 > t, t1, q1), where(t1 > t, d, q2), where(t1 > t, e, q3), where(t1 > t, t1, t),
    )  # fmt: skip
    q0, q1, q2, q3, t = (
        where(t2 > t, b, q0), where(t2 > t, d, q1), where(t2 > t, t2, q2), where(t2 > t, f, q3), where(t2 > t, t2, t),
    )  # fmt: skip
    q0, q1, q2, q3, t = (
        where(t3 > t, c, q0), where(t3 > t, e, q1), where(t3 > t, f, q2), where(t3 > t, t3, q3), where(t3 > t, t3, t),
    )  # fmt: skip
    scale = 0.5 / sqrt(t)
    return scale * q0, scale * q1, scale * q2, scale * q3


@jit
def to_local(nav, code, q, v, r):
    """Transform a navigation state (10,) from Earth-fixed to local axes, and its position to a place.

    q, v, r : offsets of attitude, velocity and position in the state
    """
    x, y, z = nav[r], nav[r + 1], nav[r + 2]
    height, ux, uy, uz = height_and_up(x, y, z)
    # fixed point: the normal is parallel to (x, y, z (N + h) / (N (1 - e^2) + h)), N the radius of the prime vertical
    for _ in range(_ROUNDS):
        prime = SEMI_MAJOR / sqrt(1.0 - ECCENTRICITY_2 * (uz * uz))
        uz = z * (prime + height) / (prime * (1.0 - ECCENTRICITY_2) + height)
        length = sqrt(x * x + y * y + uz * uz)
        ux, uy, uz = x / length, y / length, uz / length
        surface = SEMI_MAJOR * sqrt(1.0 - ECCENTRICITY_2 * (uz * uz))
        height = x * ux + y * uy + z * uz - surface
    length = 1.0 + height / SEMI_MAJOR
    nav[r], nav[r + 1], nav[r + 2] = length * ux, length * uy, length * uz
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = axes_of(code, ux, uy, uz)
    vx, vy, vz = nav[v], nav[v + 1], nav[v + 2]
    nav[v], nav[v + 1] = c0 * vx + c1 * vy + c2 * vz, c3 * vx + c4 * vy + c5 * vz
    nav[v + 2] = c6 * vx + c7 * vy + c8 * vz
    p0, p1, p2, p3 = _quaternion(c0, c1, c2, c3, c4, c5, c6, c7, c8)
    p0, p1, p2, p3 = multiply(p0, p1, p2, p3, nav[q], nav[q + 1], nav[q + 2], nav[q + 3])
    nav[q], nav[q + 1], nav[q + 2], nav[q + 3] = p0, p1, p2, p3


@jit
def from_local(nav, code, q, v, r):
    """Transform a navigation state (10,) from local to Earth-fixed axes, the inverse of `to_local`."""
    px, py, pz = nav[r], nav[r + 1], nav[r + 2]
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = axes_of(code, px, py, pz)
    vx, vy, vz = nav[v], nav[v + 1], nav[v + 2]
    nav[v], nav[v + 1] = c0 * vx + c3 * vy + c6 * vz, c1 * vx + c4 * vy + c7 * vz
    nav[v + 2] = c2 * vx + c5 * vy + c8 * vz
    p0, p1, p2, p3 = _quaternion(c0, c3, c6, c1, c4, c7, c2, c5, c8)
    p0, p1, p2, p3 = multiply(p0, p1, p2, p3, nav[q], nav[q + 1], nav[q + 2], nav[q + 3])
    nav[q], nav[q + 1], nav[q + 2], nav[q + 3] = p0, p1, p2, p3
    x, y, z = position_of(px, py, pz)
    nav[r], nav[r + 1], nav[r + 2] = x, y, z
