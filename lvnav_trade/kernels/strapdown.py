"""Strapdown integration over a window of IMU ticks: coning and sculling compensation, inertial or Earth-fixed axes.

It is called by `mechanisation.mechanise`, which all others call.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise
from lvnav_trade.kernels.earth import OMEGA, gravity_j2, gravity_j4, gravity_point
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like

Floats = NDArray[np.float64]

# Offsets in the navigation state: attitude quaternion, velocity, position. Offsets in the integrals over a window that
# the transition needs: attitude matrix (9), velocity gained (3), angle (3) and velocity (3) increments.
Q, V, R = 0, 4, 7
N_NAV = 10
SUM_C, SUM_V, SUM_TH, SUM_F = 0, 9, 12, 15
N_SUM = 18

POINT, J2, J4 = 0, 1, 2


@jit
def gravity(kind, x, y, z):
    """Return the gravitation (m/s^2) at x, y, z (m), same frame, by the model of a code: POINT, J2 or J4."""
    if kind == POINT:
        return gravity_point(x, y, z)
    if kind == J2:
        return gravity_j2(x, y, z)
    return gravity_j4(x, y, z)


class StrapdownExtensions(NamedTuple):
    """Extensions of the strapdown algorithm: local geographic axes, products of all pairs of increments.

    local : Code of the local geographic axes of the integration: NED or ENU; 0 for other axes.
    pairs : (subsamples, subsamples). Weights of the product of two increments of a step, earlier by later; they
        compensate coning and sculling in place of `weights`. Empty without. With them, the product across steps is that
        of the last increment of one step and the first of the next, and the velocity increment is rotated by the full
        series.
    """

    local: int
    pairs: Floats


class Strapdown(NamedTuple):
    """Strapdown algorithm: integration of increments to attitude, velocity and position.

    gravity : Code of the gravity model: POINT, J2 or J4.
    subsamples : Number of increments in a step.
    weights : (subsamples - 1,). Weights of all increments but the last; their weighted sum times the last increment
        compensates coning and sculling. Empty without this product.
    across : Weight of the product of the sums of the previous step and of this step.
    at_end : Whether nothing is compensated and the velocity increment has the attitude at the end of the step.
    rotating : Whether integration is in Earth-fixed axes.
    angle : rad. Angle from frame i to the Earth-fixed axes at tick 0.
    origin : (3,) m. Origin of the Earth-fixed axes.
    further : Local axes and products of pairs. None without; their code is then not compiled.
    general : Whether the algorithm differs from `full_rate`.
    counted : Whether linear covariance includes the algorithm's error on the nominal flight.
    """

    gravity: int
    subsamples: int
    weights: Floats
    across: float
    at_end: bool
    rotating: bool
    angle: float
    origin: Floats
    further: StrapdownExtensions | None
    general: bool
    counted: bool


def full_rate(gravity: int) -> Strapdown:
    """Return the two-sample algorithm with one increment per step, in the inertial frame."""
    return Strapdown(gravity, 1, np.zeros(0), 1.0 / 12.0, False, False, 0.0, np.zeros(3), None, False, False)


@inlined
def within(increments, first, algorithm):
    """Return coning (3) rad and sculling (3) m/s by the increments of a step, which begin at row `first`.

    The weighted sum of all increments but the last is multiplied by the last.
    """
    last = first + algorithm.subsamples - 1
    px = py = pz = ux = uy = uz = like(increments[last, 0], 0.0)
    for j in range(algorithm.weights.shape[0]):
        weight, at = algorithm.weights[j], first + j
        px, py, pz = px + weight * increments[at, 0], py + weight * increments[at, 1], pz + weight * increments[at, 2]
        ux, uy, uz = ux + weight * increments[at, 3], uy + weight * increments[at, 4], uz + weight * increments[at, 5]
    wx, wy, wz = increments[last, 0], increments[last, 1], increments[last, 2]
    cx, cy, cz = cross(px, py, pz, wx, wy, wz)
    ax, ay, az = cross(px, py, pz, increments[last, 3], increments[last, 4], increments[last, 5])
    bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
    return cx, cy, cz, ax + bx, ay + by, az + bz


@inlined
def fictitious(x, y, vx, vy):
    """Return the sum of centrifugal and Coriolis acceleration (m/s^2) along the Earth-fixed x and y axes.

    x, y m, vx, vy m/s, Earth-fixed axes. The component along the polar axis is zero.
    """
    return OMEGA * OMEGA * x + 2.0 * OMEGA * vy, OMEGA * OMEGA * y - 2.0 * OMEGA * vx


@jit
def to_earth_fixed(nav, algorithm, angle):
    """Transform a navigation state (10,) from the inertial frame to Earth-fixed axes with origin `algorithm.origin`.

    angle : rad, from frame i to the Earth-fixed axes
    """
    c, s, ch, sh = math.cos(angle), math.sin(angle), math.cos(0.5 * angle), math.sin(0.5 * angle)
    rx, ry = nav[R], nav[R + 1]
    # velocity relative to the rotating Earth, v - w x r, before the rotation about the polar axis
    vx, vy = nav[V] + OMEGA * ry, nav[V + 1] - OMEGA * rx
    nav[V], nav[V + 1] = c * vx + s * vy, c * vy - s * vx
    nav[R], nav[R + 1] = c * rx + s * ry - algorithm.origin[0], c * ry - s * rx - algorithm.origin[1]
    nav[R + 2] = nav[R + 2] - algorithm.origin[2]
    q = multiply(ch, 0.0, 0.0, -sh, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = q


@jit
def to_inertial(nav, algorithm, angle):
    """Transform a navigation state (10,) from Earth-fixed axes back to the inertial frame, the inverse of
    `to_earth_fixed`.
    """
    c, s, ch, sh = math.cos(angle), math.sin(angle), math.cos(0.5 * angle), math.sin(0.5 * angle)
    x, y, vx, vy = nav[R] + algorithm.origin[0], nav[R + 1] + algorithm.origin[1], nav[V], nav[V + 1]
    nav[R], nav[R + 1], nav[R + 2] = c * x - s * y, s * x + c * y, nav[R + 2] + algorithm.origin[2]
    nav[V], nav[V + 1] = c * vx - s * vy - OMEGA * nav[R + 1], s * vx + c * vy + OMEGA * nav[R]
    q = multiply(ch, 0.0, 0.0, sh, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = q


@jit
def turn_sums(sums, angle):
    """Rotate the integral of the attitude and the velocity gained from Earth-fixed axes to frame i; angle (rad)."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        x, y = sums[SUM_C + i], sums[SUM_C + 3 + i]
        sums[SUM_C + i], sums[SUM_C + 3 + i] = c * x - s * y, s * x + c * y
    x, y = sums[SUM_V], sums[SUM_V + 1]
    sums[SUM_V], sums[SUM_V + 1] = c * x - s * y, s * x + c * y


@inlined
def integrate(nav, sums, previous, increments, n_step, dt, algorithm, general):
    """Integrate the steps of a window in the frame of `nav`; the parameters are those of `mechanise`.

    general : whether `algorithm` may differ from `full_rate`. Callers pass a constant, so that the compiler removes
        the branches they do not need. Long because its state stays in registers over the loop.
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
    half, turned = 0.5 * dt, 0.5 * OMEGA * dt
    rotating, at_end, n_sample, across = False, False, 1, 1.0 / 12.0
    if general:
        rotating, at_end, n_sample, across = (
            algorithm.rotating,
            algorithm.at_end,
            algorithm.subsamples,
            algorithm.across,
        )
    for k in range(n_step):
        first = k * n_sample
        wx, wy, wz = increments[first, 0], increments[first, 1], increments[first, 2]
        fx, fy, fz = increments[first, 3], increments[first, 4], increments[first, 5]
        for at in range(first + 1, first + n_sample):
            wx, wy, wz = wx + increments[at, 0], wy + increments[at, 1], wz + increments[at, 2]
            fx, fy, fz = fx + increments[at, 3], fy + increments[at, 4], fz + increments[at, 5]
        coning_x, coning_y, coning_z = cross(px, py, pz, wx, wy, wz)
        coning_x, coning_y, coning_z = across * coning_x, across * coning_y, across * coning_z
        ax, ay, az = cross(px, py, pz, fx, fy, fz)
        bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
        sx, sy, sz = across * (ax + bx), across * (ay + by), across * (az + bz)
        if general and algorithm.weights.shape[0] > 0:
            ix, iy, iz, jx, jy, jz = within(increments, first, algorithm)
            coning_x, coning_y, coning_z = coning_x + ix, coning_y + iy, coning_z + iz
            sx, sy, sz = sx + jx, sy + jy, sz + jz
        e0, e1, e2, e3 = from_rotation(wx + coning_x, wy + coning_y, wz + coning_z)
        if at_end:
            b0, b1, b2, b3, b4, b5, b6, b7, b8 = matrix(e0, e1, e2, e3)
            dx, dy, dz = b0 * fx + b1 * fy + b2 * fz, b3 * fx + b4 * fy + b5 * fz, b6 * fx + b7 * fy + b8 * fz
        else:
            rotation_x, rotation_y, rotation_z = cross(wx, wy, wz, fx, fy, fz)
            dx, dy, dz = fx + 0.5 * rotation_x + sx, fy + 0.5 * rotation_y + sy, fz + 0.5 * rotation_z + sz
        sx, sy, sz = c0 * dx + c1 * dy + c2 * dz, c3 * dx + c4 * dy + c5 * dz, c6 * dx + c7 * dy + c8 * dz
        if rotating:
            # the axes rotate by half a step until the middle of the step; the Coriolis term uses the mean velocity
            sx, sy = sx + turned * sy, sy - turned * sx
            x, y = algorithm.origin[0] + rx + half * vx, algorithm.origin[1] + ry + half * vy
            gx, gy, gz = gravity(algorithm.gravity, x, y, algorithm.origin[2] + rz + half * vz)
            kx, ky = fictitious(x, y, vx, vy)
            kx, ky = fictitious(x, y, vx + 0.5 * (sx + dt * (gx + kx)), vy + 0.5 * (sy + dt * (gy + ky)))
            gx, gy = gx + kx, gy + ky
            q0, q1, q2, q3 = multiply(1.0 - 0.5 * turned * turned, 0.0, 0.0, -turned, q0, q1, q2, q3)
        else:
            gx, gy, gz = gravity(algorithm.gravity, rx + half * vx, ry + half * vy, rz + half * vz)
        nx, ny, nz = vx + sx + dt * gx, vy + sy + dt * gy, vz + sz + dt * gz
        rx, ry, rz = rx + half * (vx + nx), ry + half * (vy + ny), rz + half * (vz + nz)
        vx, vy, vz = nx, ny, nz
        gained_x += sx
        gained_y += sy
        gained_z += sz
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, e0, e1, e2, e3)
        # mean of C over the step by the trapezoidal rule, because a spinning body rotates by up to 0.2 rad in a step
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
    """Set a navigation state (10,) to the true motion (Reference) at a tick."""
    for i in range(4):
        nav[Q + i] = reference.q_b_i[tick, i]
    for i in range(3):
        nav[V + i], nav[R + i] = reference.v_i[tick, i], reference.r_i[tick, i]
