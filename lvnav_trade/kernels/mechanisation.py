"""Mechanisation over a window: choice of the integration by algorithm and axes.

Most algorithms use `strapdown.integrate`. Products of all pairs of increments and local geographic axes are compiled
only for cases that use them.
"""

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise, rotate, rotate_back
from lvnav_trade.kernels.coning import compensate_step
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.local_level import (
    axes_rate,
    free_fall_acceleration,
    from_local,
    local_axes,
    place_position,
    place_rate,
    to_local,
)
from lvnav_trade.kernels.strapdown import (
    N_SUM,
    SUM_C,
    SUM_F,
    SUM_TH,
    SUM_V,
    Q,
    R,
    V,
    gravity,
    integrate,
    mean_fictitious_acceleration,
    to_earth_fixed,
    to_inertial,
    turn_sums,
)


@jit
def _local_step(extensions, algorithm, dt, px, py, pz, vx, vy, vz, sx, sy, sz):
    """Integrate one step in local geographic axes by the midpoint rule.

    With s the velocity gained, w the rotation rate of the axes, p the place and a(p, v) the acceleration without
    specific force:

        v_mid = v + (s + dt a(p, v)) / 2,   p_mid = p + dt/2 dp/dt(p, v)
        s_mid = s - (dt/2 w_mid) x s,       v+ = v + s_mid + dt a(p_mid, v_mid)
        p+ = p + dt dp/dt(p_mid, (v + v+) / 2)

    Parameters
    ----------
    extensions, algorithm : StrapdownExtensions, Strapdown
    dt : s, of a step
    px, py, pz : place at the start, see `local_level`
    vx, vy, vz : m/s, velocity at the start, local axes
    sx, sy, sz : m/s, velocity gained over the step, local axes at the start

    Returns
    -------
    place (3), velocity (3) at the end; velocity gained (3) in the axes of mid-step; rotation of the axes (3), rad
    """
    code = extensions.local
    half = 0.5 * dt
    x, y, z = place_position(px, py, pz)
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    ax, ay, az = free_fall_acceleration(code, px, py, pz, vx, vy, vz, gx, gy, gz)
    mid_vx = vx + 0.5 * (sx + dt * ax)
    mid_vy = vy + 0.5 * (sy + dt * ay)
    mid_vz = vz + 0.5 * (sz + dt * az)
    dx, dy, dz = place_rate(px, py, pz, code, vx, vy, vz)
    mid_px = px + half * dx
    mid_py = py + half * dy
    mid_pz = pz + half * dz
    wx, wy, wz = axes_rate(code, mid_px, mid_py, mid_pz, mid_vx, mid_vy, mid_vz)
    half_turn_x = half * wx
    half_turn_y = half * wy
    half_turn_z = half * wz
    kx, ky, kz = cross(half_turn_x, half_turn_y, half_turn_z, sx, sy, sz)
    sx -= kx
    sy -= ky
    sz -= kz
    x, y, z = place_position(mid_px, mid_py, mid_pz)
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    ax, ay, az = free_fall_acceleration(code, mid_px, mid_py, mid_pz, mid_vx, mid_vy, mid_vz, gx, gy, gz)
    nx = vx + sx + dt * ax
    ny = vy + sy + dt * ay
    nz = vz + sz + dt * az
    mean_vx = 0.5 * (vx + nx)
    mean_vy = 0.5 * (vy + ny)
    mean_vz = 0.5 * (vz + nz)
    dx, dy, dz = place_rate(mid_px, mid_py, mid_pz, code, mean_vx, mean_vy, mean_vz)
    px += dt * dx
    py += dt * dy
    pz += dt * dz
    turn_x = dt * wx
    turn_y = dt * wy
    turn_z = dt * wz
    return px, py, pz, nx, ny, nz, sx, sy, sz, turn_x, turn_y, turn_z


@jit
def _fixed_step(algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz):
    """Integrate one step in the inertial frame or in Earth-fixed axes, with gravitation at the middle of the step.

    Parameters
    ----------
    algorithm : Strapdown
    dt : s, of a step
    rx, ry, rz : m, position at the start, relative to `algorithm.origin`
    vx, vy, vz : m/s, velocity at the start
    sx, sy, sz : m/s, velocity gained by specific force over the step, axes at the start

    Returns
    -------
    position (3) m and velocity (3) m/s at the end; velocity gained (3) in the axes of mid-step; rotation of the axes
    (3), rad
    """
    half = 0.5 * dt
    half_turn = 0.0
    x = algorithm.origin[0] + rx + half * vx
    y = algorithm.origin[1] + ry + half * vy
    z = algorithm.origin[2] + rz + half * vz
    gx, gy, gz = gravity(algorithm.gravity, x, y, z)
    if algorithm.is_rotating:
        # the axes rotate by half a step until the middle of the step
        half_turn = 0.5 * OMEGA * dt
        turned_x = sx + half_turn * sy
        turned_y = sy - half_turn * sx
        sx, sy = turned_x, turned_y
        kx, ky = mean_fictitious_acceleration(x, y, vx, vy, sx, sy, gx, gy, dt)
        gx += kx
        gy += ky
    nx = vx + sx + dt * gx
    ny = vy + sy + dt * gy
    nz = vz + sz + dt * gz
    rx += half * (vx + nx)
    ry += half * (vy + ny)
    rz += half * (vz + nz)
    zero = 0.0 * sx
    turn = number_like(sx, 2.0 * half_turn)
    return rx, ry, rz, nx, ny, nz, sx, sy, sz, zero, zero, turn


@jit
def _integrate_extended(extensions, nav, sums, previous, increments, n_step, dt, algorithm):
    """Integrate the steps of a window with every form of compensation, in any axes; slower than `integrate`.

    Parameters
    ----------
    extensions : StrapdownExtensions
    nav, sums, previous, increments, n_step, dt, algorithm : as in `mechanise`; nav is in the axes of the integration
    """
    for i in range(N_SUM):
        sums[i] = number_like(nav[Q], 0.0)
    half = 0.5 * dt
    for k in range(n_step):
        first = k * algorithm.subsamples
        x, y, z, dx, dy, dz, wx, wy, wz, fx, fy, fz = compensate_step(
            extensions, previous, increments, first, algorithm
        )
        sx, sy, sz = _add_attitude(nav, sums, half, dx, dy, dz)
        rx = nav[R]
        ry = nav[R + 1]
        rz = nav[R + 2]
        vx = nav[V]
        vy = nav[V + 1]
        vz = nav[V + 2]
        if extensions.local > 0:
            rx, ry, rz, vx, vy, vz, sx, sy, sz, tx, ty, tz = _local_step(
                extensions, algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz
            )
        else:
            rx, ry, rz, vx, vy, vz, sx, sy, sz, tx, ty, tz = _fixed_step(
                algorithm, dt, rx, ry, rz, vx, vy, vz, sx, sy, sz
            )
        nav[R] = rx
        nav[R + 1] = ry
        nav[R + 2] = rz
        nav[V] = vx
        nav[V + 1] = vy
        nav[V + 2] = vz
        _rotate_attitude(nav, x, y, z, tx, ty, tz)
        _add_attitude(nav, sums, half, dx, dy, dz)
        sums[SUM_V] += sx
        sums[SUM_V + 1] += sy
        sums[SUM_V + 2] += sz
        sums[SUM_TH] += wx
        sums[SUM_TH + 1] += wy
        sums[SUM_TH + 2] += wz
        sums[SUM_F] += fx
        sums[SUM_F + 1] += fy
        sums[SUM_F + 2] += fz
    q0, q1, q2, q3 = normalise(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q] = q0
    nav[Q + 1] = q1
    nav[Q + 2] = q2
    nav[Q + 3] = q3


@inline_jit
def _rotate_attitude(nav, x, y, z, tx, ty, tz):
    """Advance the attitude over a step: q+ = q(-t) q q(rotation vector).

    Parameters
    ----------
    nav : (10,) navigation state, updated in place
    x, y, z : rad, rotation vector of the body, body axes at the start of the step
    tx, ty, tz : rad, rotation t of the axes of the integration
    """
    q0 = nav[Q]
    q1 = nav[Q + 1]
    q2 = nav[Q + 2]
    q3 = nav[Q + 3]
    e0, e1, e2, e3 = from_rotation(-tx, -ty, -tz)
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, q0, q1, q2, q3)
    e0, e1, e2, e3 = from_rotation(x, y, z)
    q0, q1, q2, q3 = multiply(q0, q1, q2, q3, e0, e1, e2, e3)
    nav[Q] = q0
    nav[Q + 1] = q1
    nav[Q + 2] = q2
    nav[Q + 3] = q3


@jit
def _add_attitude(nav, sums, half, x, y, z):
    """Add the attitude matrix over half a step to its integral.

    Parameters
    ----------
    nav : (10,) navigation state
    sums : (18,) integrals of the window, updated in place
    half : s, half of a step
    x, y, z : vector in body axes

    Returns
    -------
    tuple of 3
        The vector in the axes of the integration.
    """
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(9):
        sums[SUM_C + i] += half * c[i]
    return rotate(c, x, y, z)


@jit
def _rotate_sums(sums, code, px, py, pz):
    """Rotate the integral of the attitude and the velocity gained from local axes to Earth-fixed axes.

    Parameters
    ----------
    sums : (18,) integrals of a window, updated in place
    code : NED or ENU
    px, py, pz : place of the local axes; only its direction matters
    """
    c = local_axes(code, px, py, pz)
    for column in range(3):
        first = SUM_C + column
        second = SUM_C + 3 + column
        third = SUM_C + 6 + column
        x, y, z = rotate_back(c, sums[first], sums[second], sums[third])
        sums[first] = x
        sums[second] = y
        sums[third] = z
    vx, vy, vz = rotate_back(c, sums[SUM_V], sums[SUM_V + 1], sums[SUM_V + 2])
    sums[SUM_V] = vx
    sums[SUM_V + 1] = vy
    sums[SUM_V + 2] = vz


@jit
def _has_extensions(extensions):
    """Return whether an algorithm has local axes or products of pairs."""
    return extensions is not None


@jit
def _mechanise_extended(extensions, nav, sums, previous, increments, n_step, dt, algorithm, seconds):
    """Advance the navigation state as `mechanise` does, in local axes or with products of all pairs of increments.

    Parameters
    ----------
    extensions : StrapdownExtensions; nothing is done if None
    nav, sums, previous, increments, n_step, dt, algorithm, seconds : as in `mechanise`
    """
    if extensions is None:
        return
    start = algorithm.angle + OMEGA * seconds
    end = algorithm.angle + OMEGA * (seconds + n_step * dt)
    if algorithm.is_rotating:
        to_earth_fixed(nav, algorithm, start)
    if extensions.local > 0:
        to_local(nav, extensions.local, Q, V, R)
        px = nav[R]
        py = nav[R + 1]
        pz = nav[R + 2]
        _integrate_extended(extensions, nav, sums, previous, increments, n_step, dt, algorithm)
        # the sum of the places at start and end has the direction of the place at mid-window
        mid_px = px + nav[R]
        mid_py = py + nav[R + 1]
        mid_pz = pz + nav[R + 2]
        _rotate_sums(sums, extensions.local, mid_px, mid_py, mid_pz)
        from_local(nav, extensions.local, Q, V, R)
    else:
        _integrate_extended(extensions, nav, sums, previous, increments, n_step, dt, algorithm)
    if algorithm.is_rotating:
        to_inertial(nav, algorithm, end)
        middle = end - OMEGA * 0.5 * n_step * dt
        turn_sums(sums, middle)


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
    if not algorithm.is_general and not algorithm.is_rotating:
        integrate(nav, sums, previous, increments, n_step, dt, algorithm, False)
        return
    if _has_extensions(algorithm.extensions):
        _mechanise_extended(algorithm.extensions, nav, sums, previous, increments, n_step, dt, algorithm, seconds)
        return
    if algorithm.is_rotating:
        start = algorithm.angle + OMEGA * seconds
        to_earth_fixed(nav, algorithm, start)
    integrate(nav, sums, previous, increments, n_step, dt, algorithm, True)
    if algorithm.is_rotating:
        end = algorithm.angle + OMEGA * (seconds + n_step * dt)
        to_inertial(nav, algorithm, end)
        middle = end - OMEGA * 0.5 * n_step * dt
        turn_sums(sums, middle)
