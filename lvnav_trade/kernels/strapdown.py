"""Inertial-frame strapdown over a window of IMU ticks, with coning and sculling compensation."""

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise
from lvnav_trade.kernels.earth import gravity_j2, gravity_j4, gravity_point
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like

# Offsets in the navigation state and in the sums over a window that the transition needs.
Q, V, R = 0, 4, 7
N_NAV = 10
SUM_C, SUM_V, SUM_TH, SUM_F = 0, 9, 12, 15
N_SUM = 18

POINT, J2, J4 = 0, 1, 2


@jit
def gravity(kind, x, y, z):
    """Return gravitation (m/s^2, frame i) by the model of a kind code."""
    if kind == POINT:
        return gravity_point(x, y, z)
    if kind == J2:
        return gravity_j2(x, y, z)
    return gravity_j4(x, y, z)


@jit
def mechanise(nav, sums, previous, increments, n_tick, dt, kind):
    """Advance the navigation state over the first `n_tick` increments.

    Two-sample coning and sculling with the previous tick (Savage 1998, parts 1 and 2); gravity at the middle of each
    tick. Long because its state stays in registers over the loop.

    Parameters
    ----------
    nav : (10,) quaternion b to i, velocity (m/s), position (m), frame i; updated
    sums : (18,) set to the window's integral of C_b_i dt (9), velocity gained (3), angle (3) and specific-force (3)
        increments summed
    previous : (6,) increments of the tick before; updated
    increments : (n, 6) compensated angle (rad) and velocity (m/s) increments, body frame
    """
    q0, q1, q2, q3 = nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3]
    vx, vy, vz = nav[V], nav[V + 1], nav[V + 2]
    rx, ry, rz = nav[R], nav[R + 1], nav[R + 2]
    px, py, pz, ux, uy, uz = previous[0], previous[1], previous[2], previous[3], previous[4], previous[5]
    zero = like(q0, 0.0)
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = matrix(q0, q1, q2, q3)
    m0, m1, m2, m3, m4, m5, m6, m7, m8 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    gained_x, gained_y, gained_z = zero, zero, zero
    th_x, th_y, th_z, f_x, f_y, f_z = zero, zero, zero, zero, zero, zero
    half, twelfth = 0.5 * dt, 1.0 / 12.0
    for k in range(n_tick):
        wx, wy, wz = increments[k, 0], increments[k, 1], increments[k, 2]
        fx, fy, fz = increments[k, 3], increments[k, 4], increments[k, 5]
        coning_x, coning_y, coning_z = cross(px, py, pz, wx, wy, wz)
        rotation_x, rotation_y, rotation_z = cross(wx, wy, wz, fx, fy, fz)
        ax, ay, az = cross(px, py, pz, fx, fy, fz)
        bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
        dx = fx + 0.5 * rotation_x + twelfth * (ax + bx)
        dy = fy + 0.5 * rotation_y + twelfth * (ay + by)
        dz = fz + 0.5 * rotation_z + twelfth * (az + bz)
        sx, sy, sz = c0 * dx + c1 * dy + c2 * dz, c3 * dx + c4 * dy + c5 * dz, c6 * dx + c7 * dy + c8 * dz
        gx, gy, gz = gravity(kind, rx + half * vx, ry + half * vy, rz + half * vz)
        nx, ny, nz = vx + sx + dt * gx, vy + sy + dt * gy, vz + sz + dt * gz
        rx, ry, rz = rx + half * (vx + nx), ry + half * (vy + ny), rz + half * (vz + nz)
        vx, vy, vz = nx, ny, nz
        gained_x += sx
        gained_y += sy
        gained_z += sz
        e0, e1, e2, e3 = from_rotation(wx + twelfth * coning_x, wy + twelfth * coning_y, wz + twelfth * coning_z)
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, e0, e1, e2, e3)
        # the mean of C over the tick by the trapezoidal rule: a body that spins turns by 0.2 rad in a tick
        m0, m1, m2 = m0 + c0, m1 + c1, m2 + c2
        m3, m4, m5 = m3 + c3, m4 + c4, m5 + c5
        m6, m7, m8 = m6 + c6, m7 + c7, m8 + c8
        c0, c1, c2, c3, c4, c5, c6, c7, c8 = matrix(q0, q1, q2, q3)
        m0, m1, m2 = m0 + c0, m1 + c1, m2 + c2
        m3, m4, m5 = m3 + c3, m4 + c4, m5 + c5
        m6, m7, m8 = m6 + c6, m7 + c7, m8 + c8
        th_x, th_y, th_z = th_x + wx, th_y + wy, th_z + wz
        f_x, f_y, f_z = f_x + fx, f_y + fy, f_z + fz
        px, py, pz, ux, uy, uz = wx, wy, wz, fx, fy, fz
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = normalise(q0, q1, q2, q3)
    nav[V], nav[V + 1], nav[V + 2] = vx, vy, vz
    nav[R], nav[R + 1], nav[R + 2] = rx, ry, rz
    previous[0], previous[1], previous[2], previous[3], previous[4], previous[5] = px, py, pz, ux, uy, uz
    sums[0], sums[1], sums[2] = half * m0, half * m1, half * m2
    sums[3], sums[4], sums[5] = half * m3, half * m4, half * m5
    sums[6], sums[7], sums[8] = half * m6, half * m7, half * m8
    sums[SUM_V], sums[SUM_V + 1], sums[SUM_V + 2] = gained_x, gained_y, gained_z
    sums[SUM_TH], sums[SUM_TH + 1], sums[SUM_TH + 2] = th_x, th_y, th_z
    sums[SUM_F], sums[SUM_F + 1], sums[SUM_F + 2] = f_x, f_y, f_z


@jit
def place(nav, reference, tick):
    """Set a navigation state to the true motion (Reference) at a tick; nav updated."""
    for i in range(4):
        nav[Q + i] = reference.q_b_i[tick, i]
    for i in range(3):
        nav[V + i], nav[R + i] = reference.v_i[tick, i], reference.r_i[tick, i]
