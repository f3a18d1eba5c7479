"""Local geographic axes: rotation rate, motion, and transformation from and to Earth-fixed axes.

A *place* is latitude, longitude and height as one vector in Earth-fixed axes: the normal of the ellipsoid, with length
1 + height / semi-major axis. It needs no trigonometric functions, so the same source runs one run or eight lanes. North
and east are undefined at a pole; a trajectory within metres of a pole loses precision.
"""

from lvnav_trade.kernels.attitude import cross, multiply, rotate, rotate_back
from lvnav_trade.kernels.earth import ECCENTRICITY_2, OMEGA, SEMI_MAJOR, height_and_normal
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt, where

NED, ENU = 1, 2
_ROUNDS = 3  # iterations of the latitude; each reduces the error to 0.7 %


@jit
def place_geometry(px, py, pz):
    """Return normal, height and radii of curvature at a place.

    N = a / sqrt(1 - e^2 sin^2 L), M = N (1 - e^2) / (1 - e^2 sin^2 L), L the latitude (Groves, 2nd ed., chapter 2).

    Parameters
    ----------
    px, py, pz : place, as the module defines it, Earth-fixed axes

    Returns
    -------
    ux, uy, uz : normal of the ellipsoid, Earth-fixed axes
    height : m, over the ellipsoid
    meridian, prime : m, radii of curvature M of the meridian and N of the prime vertical
    """
    length = sqrt(px * px + py * py + pz * pz)
    ux = px / length
    uy = py / length
    uz = pz / length
    height = (length - 1.0) * SEMI_MAJOR
    squash = 1.0 - ECCENTRICITY_2 * (uz * uz)  # the normal's z component is the sine of the latitude
    prime = SEMI_MAJOR / sqrt(squash)
    meridian = prime * (1.0 - ECCENTRICITY_2) / squash
    return ux, uy, uz, height, meridian, prime


@jit
def place_position(px, py, pz):
    """Return the position (3) m of a place, Earth-fixed axes: ((N + h) u_x, (N + h) u_y, (N (1 - e^2) + h) u_z).

    Parameters
    ----------
    px, py, pz : place, Earth-fixed axes
    """
    ux, uy, uz, height, _, prime = place_geometry(px, py, pz)
    radius = prime + height
    polar = prime * (1.0 - ECCENTRICITY_2) + height
    return radius * ux, radius * uy, polar * uz


@jit
def local_axes(code, px, py, pz):
    """Return the nine entries, by rows, of the matrix from Earth-fixed to local axes at a place.

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    """
    length = sqrt(px * px + py * py + pz * pz)
    ux = px / length
    uy = py / length
    uz = pz / length
    cos_latitude = sqrt(ux * ux + uy * uy)
    ex = -uy / cos_latitude
    ey = ux / cos_latitude
    ez = 0.0 * ux
    nx = -uz * ux / cos_latitude
    ny = -uz * uy / cos_latitude
    nz = cos_latitude
    if code == NED:
        dx = -ux
        dy = -uy
        dz = -uz
        return nx, ny, nz, ex, ey, ez, dx, dy, dz
    return ex, ey, ez, nx, ny, nz, ux, uy, uz


@jit
def north_east_up(code, x, y, z):
    """Return the north, east and up components of a vector.

    Parameters
    ----------
    code : NED or ENU
    x, y, z : components in these local axes
    """
    if code == NED:
        return x, y, -z
    return y, x, z


@jit
def local_components(code, north, east, up):
    """Return the components of a vector in local axes, the inverse of `north_east_up`.

    Parameters
    ----------
    code : NED or ENU
    north, east, up : components of the vector
    """
    if code == NED:
        return north, east, -up
    return east, north, up


@jit
def transport_rate(code, px, py, pz, vx, vy, vz):
    """Return the transport rate (3) rad/s, local axes: rotation of the local axes relative to the Earth.

    Its north, east and up components are v_E / (N + h), -v_N / (M + h) and v_E tan L / (N + h).

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    vx, vy, vz : m/s, velocity relative to the Earth, local axes
    """
    ux, uy, uz, height, meridian, prime = place_geometry(px, py, pz)
    north, east, _ = north_east_up(code, vx, vy, vz)
    rate_north = east / (prime + height)
    rate_east = -north / (meridian + height)
    level = sqrt(ux * ux + uy * uy)  # cosine of the latitude
    rate_up = rate_north * uz / level
    return local_components(code, rate_north, rate_east, rate_up)


@jit
def earth_rate(code, px, py, pz):
    """Return the Earth rate (3) rad/s in local axes: w_ie cos L to the north, w_ie sin L up.

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    """
    length = sqrt(px * px + py * py + pz * pz)
    level = sqrt(px * px + py * py)
    rate_north = OMEGA * level / length
    rate_up = OMEGA * pz / length
    return local_components(code, rate_north, 0.0 * px, rate_up)


@jit
def place_rate(px, py, pz, code, vx, vy, vz):
    """Return the time derivative (3) 1/s of a place, Earth-fixed axes.

    The place is p = (1 + h/a) u. Its derivative has the components (1 + h/a) v_N / (M + h) to the north,
    (1 + h/a) v_E / (N + h) to the east and v_U / a up.

    Parameters
    ----------
    px, py, pz : place
    code : NED or ENU
    vx, vy, vz : m/s, velocity relative to the Earth, local axes
    """
    ux, uy, uz, height, meridian, prime = place_geometry(px, py, pz)
    north, east, up = north_east_up(code, vx, vy, vz)
    level = sqrt(ux * ux + uy * uy)
    length = 1.0 + height / SEMI_MAJOR
    north_rate = length * north / (meridian + height)
    east_rate = length * east / (prime + height) / level  # times (-u_y, u_x, 0), which has the length `level`
    up_rate = up / SEMI_MAJOR
    dx = -north_rate * uz * ux / level - east_rate * uy + up_rate * ux
    dy = -north_rate * uz * uy / level + east_rate * ux + up_rate * uy
    dz = north_rate * level + up_rate * uz
    return dx, dy, dz


@jit
def free_fall_acceleration(code, px, py, pz, vx, vy, vz, gx, gy, gz):
    """Return the derivative of the velocity without specific force (3) m/s^2, local axes.

    It has gravitation and centrifugal acceleration, minus (2 w_ie + w_en) x v: Coriolis and transport terms.

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    vx, vy, vz : m/s, velocity relative to the Earth, local axes
    gx, gy, gz : m/s^2, gravitation, Earth-fixed axes
    """
    x, y, _ = place_position(px, py, pz)
    gx += OMEGA * OMEGA * x
    gy += OMEGA * OMEGA * y
    lx, ly, lz = rotate(local_axes(code, px, py, pz), gx, gy, gz)
    ix, iy, iz = earth_rate(code, px, py, pz)
    tx, ty, tz = transport_rate(code, px, py, pz, vx, vy, vz)
    # 2 w_ie + w_en
    wx = 2.0 * ix + tx
    wy = 2.0 * iy + ty
    wz = 2.0 * iz + tz
    kx, ky, kz = cross(wx, wy, wz, vx, vy, vz)
    return lx - kx, ly - ky, lz - kz


@jit
def axes_rate(code, px, py, pz, vx, vy, vz):
    """Return the rotation rate (3) rad/s of the local axes in inertial space, local axes: w_ie + w_en.

    Parameters
    ----------
    code : NED or ENU
    px, py, pz : place
    vx, vy, vz : m/s, velocity relative to the Earth, local axes
    """
    ix, iy, iz = earth_rate(code, px, py, pz)
    tx, ty, tz = transport_rate(code, px, py, pz, vx, vy, vz)
    return ix + tx, iy + ty, iz + tz


@jit
def _quaternion(m):
    """Return the quaternion of a rotation matrix, nine entries by rows, from its largest component for accuracy.

    The matrix 4 q q' has the diagonal t_k = 4 q_k^2. The quaternion is the row with the largest t, divided by 2 sqrt(t)
    (Shepperd, J. Guidance and Control 1, 1978).
    """
    t0 = 1.0 + m[0] + m[4] + m[8]
    t1 = 1.0 + m[0] - m[4] - m[8]
    t2 = 1.0 - m[0] + m[4] - m[8]
    t3 = 1.0 - m[0] - m[4] + m[8]
    # 4 q_0 q_1, 4 q_0 q_2, 4 q_0 q_3, 4 q_1 q_2, 4 q_1 q_3, 4 q_2 q_3
    p01 = m[7] - m[5]
    p02 = m[2] - m[6]
    p03 = m[3] - m[1]
    p12 = m[3] + m[1]
    p13 = m[2] + m[6]
    p23 = m[7] + m[5]
    q0 = t0
    q1 = p01
    q2 = p02
    q3 = p03
    t = t0
    q0, q1, q2, q3, t = _larger(p01, t1, p12, p13, t1, q0, q1, q2, q3, t)
    q0, q1, q2, q3, t = _larger(p02, p12, t2, p23, t2, q0, q1, q2, q3, t)
    q0, q1, q2, q3, t = _larger(p03, p13, p23, t3, t3, q0, q1, q2, q3, t)
    scale = 0.5 / sqrt(t)
    return scale * q0, scale * q1, scale * q2, scale * q3


@jit
def _larger(p0, p1, p2, p3, s, q0, q1, q2, q3, t):
    """Return p and s if s > t, otherwise q and t.

    Parameters
    ----------
    p0, p1, p2, p3, s : first vector of four, and its size
    q0, q1, q2, q3, t : second vector of four, and its size
    """
    is_first_larger = s > t
    larger_0 = where(is_first_larger, p0, q0)
    larger_1 = where(is_first_larger, p1, q1)
    larger_2 = where(is_first_larger, p2, q2)
    larger_3 = where(is_first_larger, p3, q3)
    size = where(is_first_larger, s, t)
    return larger_0, larger_1, larger_2, larger_3, size


@jit
def to_local(nav, code, q, v, r):
    """Transform a navigation state from Earth-fixed to local axes, and its position to a place.

    Parameters
    ----------
    nav : (10,) quaternion body to Earth-fixed axes, velocity (m/s) relative to the Earth and position (m), Earth-fixed
        axes; updated in place to quaternion body to local axes, velocity in local axes, and place
    code : NED or ENU
    q, v, r : offsets of attitude, velocity and position in the state
    """
    x = nav[r]
    y = nav[r + 1]
    z = nav[r + 2]
    height, ux, uy, uz = height_and_normal(x, y, z)
    # fixed point: the normal is parallel to (x, y, z (N + h) / (N (1 - e^2) + h)), N the radius of the prime vertical
    for _ in range(_ROUNDS):
        prime = SEMI_MAJOR / sqrt(1.0 - ECCENTRICITY_2 * (uz * uz))
        level = prime + height
        polar = prime * (1.0 - ECCENTRICITY_2) + height
        uz = z * level / polar
        length = sqrt(x * x + y * y + uz * uz)
        ux = x / length
        uy = y / length
        uz = uz / length
        # h = r . u - a sqrt(1 - e^2 sin^2 L)
        surface = SEMI_MAJOR * sqrt(1.0 - ECCENTRICITY_2 * (uz * uz))
        height = x * ux + y * uy + z * uz - surface
    length = 1.0 + height / SEMI_MAJOR
    nav[r] = length * ux
    nav[r + 1] = length * uy
    nav[r + 2] = length * uz
    c = local_axes(code, ux, uy, uz)
    vx, vy, vz = rotate(c, nav[v], nav[v + 1], nav[v + 2])
    nav[v] = vx
    nav[v + 1] = vy
    nav[v + 2] = vz
    p0, p1, p2, p3 = _quaternion(c)
    p0, p1, p2, p3 = multiply(p0, p1, p2, p3, nav[q], nav[q + 1], nav[q + 2], nav[q + 3])
    nav[q] = p0
    nav[q + 1] = p1
    nav[q + 2] = p2
    nav[q + 3] = p3


@jit
def from_local(nav, code, q, v, r):
    """Transform a navigation state from local to Earth-fixed axes, the inverse of `to_local`.

    Parameters
    ----------
    nav : state as from `to_local`, updated in place
    code : NED or ENU
    q, v, r : offsets of attitude, velocity and position in the state
    """
    px = nav[r]
    py = nav[r + 1]
    pz = nav[r + 2]
    c = local_axes(code, px, py, pz)
    vx, vy, vz = rotate_back(c, nav[v], nav[v + 1], nav[v + 2])
    nav[v] = vx
    nav[v + 1] = vy
    nav[v + 2] = vz
    inverse_matrix = (c[0], c[3], c[6], c[1], c[4], c[7], c[2], c[5], c[8])
    p0, p1, p2, p3 = _quaternion(inverse_matrix)
    p0, p1, p2, p3 = multiply(p0, p1, p2, p3, nav[q], nav[q + 1], nav[q + 2], nav[q + 3])
    nav[q] = p0
    nav[q + 1] = p1
    nav[q + 2] = p2
    nav[q + 3] = p3
    x, y, z = place_position(px, py, pz)
    nav[r] = x
    nav[r + 1] = y
    nav[r + 2] = z
