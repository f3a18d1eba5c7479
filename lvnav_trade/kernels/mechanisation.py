"""Mechanisation over a window: choice of the integration by algorithm and axes.

Most algorithms use `strapdown.integrate`. Products of all pairs of increments and local geographic axes are compiled
only for cases that use them.
"""

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.local_level import axes_of, falling, from_local, moving, position_of, to_local, turning
from lvnav_trade.kernels.strapdown import (
    N_SUM,
    SUM_C,
    SUM_F,
    SUM_TH,
    SUM_V,
    Q,
    R,
    V,
    fictitious,
    gravity,
    integrate,
    to_earth_fixed,
    to_inertial,
    turn_sums,
    within,
)


@jit
def _by_pairs(increments, first, further):
    """Return coning (3) and sculling (3) by the weighted products of all pairs of increments of a step."""
    zero = like(increments[first, 0], 0.0)
    cx, cy, cz, sx, sy, sz = zero, zero, zero, zero, zero, zero
    for k in range(1, further.pairs.shape[0]):
        px, py, pz, ux, uy, uz = zero, zero, zero, zero, zero, zero
        for j in range(k):
            weight, at = further.pairs[j, k], first + j
            px, py = px + weight * increments[at, 0], py + weight * increments[at, 1]
            ux, uy = ux + weight * increments[at, 3], uy + weight * increments[at, 4]
            pz, uz = pz + weight * increments[at, 2], uz + weight * increments[at, 5]
        wx, wy, wz = increments[first + k, 0], increments[first + k, 1], increments[first + k, 2]
        dx, dy, dz = cross(px, py, pz, wx, wy, wz)
        ax, ay, az = cross(px, py, pz, increments[first + k, 3], increments[first + k, 4], increments[first + k, 5])
        bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
        cx, cy, cz = cx + dx, cy + dy, cz + dz
        sx, sy, sz = sx + (ax + bx), sy + (ay + by), sz + (az + bz)
    return cx, cy, cz, sx, sy, sz


@jit
def _turned(wx, wy, wz, fx, fy, fz):
    """Return the change of a velocity increment f by a simultaneous rotation w at constant rates.

    It is (1 - cos a) / a^2 w x f + (a - sin a) / a^3 w x (w x f), a the magnitude of w, by series in a^2.
    """
    square = wx * wx + wy * wy + wz * wz
    first = 0.5 + square * (-1.0 / 24.0 + square * (1.0 / 720.0 - square * (1.0 / 40320.0)))
    second = 1.0 / 6.0 + square * (-1.0 / 120.0 + square * (1.0 / 5040.0 - square * (1.0 / 362880.0)))
    ax, ay, az = cross(wx, wy, wz, fx, fy, fz)
    bx, by, bz = cross(wx, wy, wz, ax, ay, az)
    return first * ax + second * bx, first * ay + second * by, first * az + second * bz


@jit
def _local_step(further, algorithm, dt, px, py, pz, vx, vy, vz, sx, sy, sz):
    """Integrate one step in local geographic axes by the midpoint rule.

    Parameters
    ----------
    further, algorithm : StrapdownExtensions, Strapdown
    dt : s, of a step
    px, py, pz : place at the start, see `local_level`
    vx, vy, vz : m/s, velocity at the start, local axes
    sx, sy, sz : m/s, velocity gained over the step, local axes at the start

    Returns
    -------
    place (3), velocity (3) at the end; velocity gained (3) in the axes of mid-step; rotation of the axes (3), rad
    """
    code, half = further.local, 0.5 * dt
    x, y, z = position_of(px, py, pz)
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    ax, ay, az = falling(code, px, py, pz, vx, vy, vz, gx, gy, gz)
    mx, my, mz = vx + 0.5 * (sx + dt * ax), vy + 0.5 * (sy + dt * ay), vz + 0.5 * (sz + dt * az)
    dx, dy, dz = moving(px, py, pz, code, vx, vy, vz)
    qx, qy, qz = px + half * dx, py + half * dy, pz + half * dz
    wx, wy, wz = turning(code, qx, qy, qz, mx, my, mz)
    kx, ky, kz = cross(half * wx, half * wy, half * wz, sx, sy, sz)
    sx, sy, sz = sx - kx, sy - ky, sz - kz
    x, y, z = position_of(qx, qy, qz)
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    ax, ay, az = falling(code, qx, qy, qz, mx, my, mz, gx, gy, gz)
    nx, ny, nz = vx + sx + dt * ax, vy + sy + dt * ay, vz + sz + dt * az
    dx, dy, dz = moving(qx, qy, qz, code, 0.5 * (vx + nx), 0.5 * (vy + ny), 0.5 * (vz + nz))
    px, py, pz = px + dt * dx, py + dt * dy, pz + dt * dz
    return px, py, pz, nx, ny, nz, sx, sy, sz, dt * wx, dt * wy, dt * wz


@jit
def _compensated(further, previous, increments, first, algorithm):
    """Return rotation vector (3), velocity gained (3) and summed increments (6) of a step, body axes at its start.

    first : first row of the step in `increments`; previous : as in `mechanise`, updated in place
    """
    n = algorithm.subsamples
    wx, wy, wz = increments[first, 0], increments[first, 1], increments[first, 2]
    fx, fy, fz = increments[first, 3], increments[first, 4], increments[first, 5]
    for at in range(first + 1, first + n):
        wx, wy, wz = wx + increments[at, 0], wy + increments[at, 1], wz + increments[at, 2]
        fx, fy, fz = fx + increments[at, 3], fy + increments[at, 4], fz + increments[at, 5]
    tx, ty, tz, ux, uy, uz = wx, wy, wz, fx, fy, fz
    if further.pairs.shape[0] > 0:
        tx, ty, tz = increments[first, 0], increments[first, 1], increments[first, 2]
        ux, uy, uz = increments[first, 3], increments[first, 4], increments[first, 5]
    px, py, pz = algorithm.across * previous[0], algorithm.across * previous[1], algorithm.across * previous[2]
    cx, cy, cz = cross(px, py, pz, tx, ty, tz)
    ax, ay, az = cross(px, py, pz, ux, uy, uz)
    bx, by, bz = cross(previous[3], previous[4], previous[5], tx, ty, tz)
    sx, sy, sz = ax + algorithm.across * bx, ay + algorithm.across * by, az + algorithm.across * bz
    if algorithm.weights.shape[0] > 0:
        ix, iy, iz, jx, jy, jz = within(increments, first, algorithm)
        cx, cy, cz, sx, sy, sz = cx + ix, cy + iy, cz + iz, sx + jx, sy + jy, sz + jz
    if further.pairs.shape[0] > 0:
        ix, iy, iz, jx, jy, jz = _by_pairs(increments, first, further)
        cx, cy, cz, sx, sy, sz = cx + ix, cy + iy, cz + iz, sx + jx, sy + jy, sz + jz
        ax, ay, az = _turned(wx, wy, wz, fx, fy, fz)
    else:
        ax, ay, az = cross(0.5 * wx, 0.5 * wy, 0.5 * wz, fx, fy, fz)
    last = first + n - 1
    for i in range(6):
        previous[i] = increments[last, i]
    if further.pairs.shape[0] == 0:
        previous[0], previous[1], previous[2], previous[3], previous[4], previous[5] = wx, wy, wz, fx, fy, fz
    dx, dy, dz = fx + ax + sx, fy + ay + sy, fz + az + sz
    if algorithm.at_end:
        b0, b1, b2, b3, b4, b5, b6, b7, b8 = matrix(*from_rotation(wx, wy, wz))
        dx, dy, dz = b0 * fx + b1 * fy + b2 * fz, b3 * fx + b4 * fy + b5 * fz, b6 * fx + b7 * fy + b8 * fz
    return wx + cx, wy + cy, wz + cz, dx, dy, dz, wx, wy, wz, fx, fy, fz


@jit
def _fixed_step(algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz):
    """Integrate one step as `_local_step` does, in the inertial frame or in Earth-fixed axes, with position (m)."""
    half, turned = 0.5 * dt, 0.0
    x, y, z = (
        algorithm.origin[0] + rx + half * vx,
        algorithm.origin[1] + ry + half * vy,
        algorithm.origin[2] + rz + half * vz,
    )
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    if algorithm.rotating:
        turned = 0.5 * OMEGA * dt
        sx, sy = sx + turned * sy, sy - turned * sx
        kx, ky = fictitious(x, y, vx, vy)
        kx, ky = fictitious(x, y, vx + 0.5 * (sx + dt * (gx + kx)), vy + 0.5 * (sy + dt * (gy + ky)))
        gx, gy = gx + kx, gy + ky
    nx, ny, nz = vx + sx + dt * gx, vy + sy + dt * gy, vz + sz + dt * gz
    rx, ry, rz = rx + half * (vx + nx), ry + half * (vy + ny), rz + half * (vz + nz)
    return rx, ry, rz, nx, ny, nz, sx, sy, sz, 0.0 * sx, 0.0 * sx, like(sx, 2.0 * turned)


@jit
def _integrate_further(further, nav, sums, previous, increments, n_step, dt, algorithm):
    """Integrate the steps of a window with every form of compensation, in any axes; slower than `integrate`."""
    for i in range(N_SUM):
        sums[i] = like(nav[Q], 0.0)
    half = 0.5 * dt
    for k in range(n_step):
        x, y, z, dx, dy, dz, wx, wy, wz, fx, fy, fz = _compensated(
            further, previous, increments, k * algorithm.subsamples, algorithm
        )
        sx, sy, sz = _add_attitude(nav, sums, half, dx, dy, dz)
        rx, ry, rz, vx, vy, vz = nav[R], nav[R + 1], nav[R + 2], nav[V], nav[V + 1], nav[V + 2]
        if further.local > 0:
            rx, ry, rz, vx, vy, vz, sx, sy, sz, tx, ty, tz = _local_step(
                further, algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz
            )
        else:
            rx, ry, rz, vx, vy, vz, sx, sy, sz, tx, ty, tz = _fixed_step(
                algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz
            )
        nav[R], nav[R + 1], nav[R + 2], nav[V], nav[V + 1], nav[V + 2] = rx, ry, rz, vx, vy, vz
        h0, h1, h2, h3 = from_rotation(-tx, -ty, -tz)
        q0, q1, q2, q3 = multiply(h0, h1, h2, h3, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
        h0, h1, h2, h3 = from_rotation(x, y, z)
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, h0, h1, h2, h3)
        nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = q0, q1, q2, q3
        _add_attitude(nav, sums, half, dx, dy, dz)
        sums[SUM_V], sums[SUM_V + 1], sums[SUM_V + 2] = sums[SUM_V] + sx, sums[SUM_V + 1] + sy, sums[SUM_V + 2] + sz
        sums[SUM_TH], sums[SUM_TH + 1] = sums[SUM_TH] + wx, sums[SUM_TH + 1] + wy
        sums[SUM_TH + 2], sums[SUM_F] = sums[SUM_TH + 2] + wz, sums[SUM_F] + fx
        sums[SUM_F + 1], sums[SUM_F + 2] = sums[SUM_F + 1] + fy, sums[SUM_F + 2] + fz
    q0, q1, q2, q3 = normalise(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = q0, q1, q2, q3


@jit
def _add_attitude(nav, sums, half, x, y, z):
    """Add `half` (s) times the attitude matrix to its integral; return the vector x, y, z rotated from body axes."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    sums[0], sums[1], sums[2] = sums[0] + half * c0, sums[1] + half * c1, sums[2] + half * c2
    sums[3], sums[4], sums[5] = sums[3] + half * c3, sums[4] + half * c4, sums[5] + half * c5
    sums[6], sums[7], sums[8] = sums[6] + half * c6, sums[7] + half * c7, sums[8] + half * c8
    return c0 * x + c1 * y + c2 * z, c3 * x + c4 * y + c5 * z, c6 * x + c7 * y + c8 * z


@jit
def _sums_to_earth_fixed(sums, code, px, py, pz):
    """Rotate the integral of the attitude and the velocity gained from local axes at a place to Earth-fixed axes."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = axes_of(code, px, py, pz)
    for i in range(4):
        at, step = (SUM_C + i, 3) if i < 3 else (SUM_V, 1)
        x, y, z = sums[at], sums[at + step], sums[at + 2 * step]
        sums[at] = c0 * x + c3 * y + c6 * z
        sums[at + step] = c1 * x + c4 * y + c7 * z
        sums[at + 2 * step] = c2 * x + c5 * y + c8 * z


@jit
def _is_further(further):
    """Return whether an algorithm has local axes or products of pairs."""
    return further is not None


@jit
def _mechanise_further(further, nav, sums, previous, increments, n_step, dt, algorithm, seconds):
    """Advance the navigation state as `mechanise` does, in local axes or with products of all pairs of increments."""
    if further is None:
        return
    end = algorithm.angle + OMEGA * (seconds + n_step * dt)
    if algorithm.rotating:
        to_earth_fixed(nav, algorithm, algorithm.angle + OMEGA * seconds)
    if further.local > 0:
        to_local(nav, further.local, Q, V, R)
        px, py, pz = nav[R], nav[R + 1], nav[R + 2]
        _integrate_further(further, nav, sums, previous, increments, n_step, dt, algorithm)
        px, py, pz = px + nav[R], py + nav[R + 1], pz + nav[R + 2]  # direction of the place at mid-window
        _sums_to_earth_fixed(sums, further.local, px, py, pz)
        from_local(nav, further.local, Q, V, R)
    else:
        _integrate_further(further, nav, sums, previous, increments, n_step, dt, algorithm)
    if algorithm.rotating:
        to_inertial(nav, algorithm, end)
        turn_sums(sums, end - OMEGA * 0.5 * n_step * dt)


@jit
def mechanise(nav, sums, previous, increments, n_step, dt, algorithm, seconds):
    """Advance the navigation state over the first `n_step` steps of increments.

    Coning and sculling are compensated as `algorithm` specifies (Savage 1998, parts 1 and 2; Ignagni 1996). Gravity is
    evaluated at the middle of each step. For rotating axes the state is transformed to them, integrated with
    centrifugal and Coriolis acceleration, and transformed back.

    Parameters
    ----------
    nav : (10,) quaternion b to i, velocity (m/s), position (m), frame i; updated in place
    sums : (18,) set to the integral of C_b_i dt over the window (9, s), velocity gained (3, m/s, frame i), and the sums
        of angle (3, rad) and velocity (3, m/s) increments, body axes
    previous : (6,) summed increments of the previous step, updated in place
    increments : (n, 6) compensated angle (rad) and velocity (m/s) increments, body axes
    n_step : number of steps
    dt : s, of a step
    algorithm : Strapdown
    seconds : s, from tick 0 to the first step
    """
    if not algorithm.general and not algorithm.rotating:
        integrate(nav, sums, previous, increments, n_step, dt, algorithm, False)
        return
    if _is_further(algorithm.further):
        _mechanise_further(algorithm.further, nav, sums, previous, increments, n_step, dt, algorithm, seconds)
        return
    if algorithm.rotating:
        to_earth_fixed(nav, algorithm, algorithm.angle + OMEGA * seconds)
    integrate(nav, sums, previous, increments, n_step, dt, algorithm, True)
    if algorithm.rotating:
        end = algorithm.angle + OMEGA * (seconds + n_step * dt)
        to_inertial(nav, algorithm, end)
        turn_sums(sums, end - OMEGA * 0.5 * n_step * dt)
