"""Strapdown integration over a window of IMU ticks: coning and sculling compensation, inertial or Earth-fixed axes.

It is called by `mechanisation.mechanise`. Others call that, except where the algorithm is always `full_rate`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, multiply, normalise, rotate
from lvnav_trade.kernels.coning import increment_sums, products_within_step
from lvnav_trade.kernels.earth import OMEGA, gravity_j2, gravity_j4, gravity_point
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like

Floats = NDArray[np.float64]

# Offsets in the navigation state: attitude quaternion, velocity, position. Offsets in the integrals over a window that
# the transition needs: attitude matrix (9), velocity gained (3), angle (3) and velocity (3) increments.
Q, V, R = 0, 4, 7
N_NAV = 10
SUM_C, SUM_V, SUM_TH, SUM_F = 0, 9, 12, 15
N_SUM = 18

POINT, J2, J4 = 0, 1, 2


@jit
def gravity(model_code, x, y, z):
    """Return the gravitation (gx, gy, gz) in m/s^2, in the axes of the position.

    Parameters
    ----------
    model_code : code of the gravity model: POINT, J2 or J4
    x, y, z : m, position relative to the Earth's centre, z along the polar axis
    """
    if model_code == POINT:
        return gravity_point(x, y, z)
    if model_code == J2:
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
    previous_step_weight : Weight of the product of the sums of the previous step and of this step.
    has_end_attitude : Whether nothing is compensated and velocity increments are rotated by the attitude at the end of
        the step.
    is_rotating : Whether integration is in Earth-fixed axes.
    angle : rad. Angle from frame i to the Earth-fixed axes at tick 0.
    origin : (3,) m. Origin of the Earth-fixed axes.
    extensions : Local axes and products of pairs. None without; their code is then not compiled.
    is_general : Whether the algorithm differs from `full_rate`.
    is_error_included : Whether linear covariance includes the algorithm's error on the nominal flight.
    """

    gravity: int
    subsamples: int
    weights: Floats
    previous_step_weight: float
    has_end_attitude: bool
    is_rotating: bool
    angle: float
    origin: Floats
    extensions: StrapdownExtensions | None
    is_general: bool
    is_error_included: bool


def full_rate(gravity: int) -> Strapdown:
    """Return the two-sample algorithm with one increment per step, in the inertial frame."""
    return Strapdown(gravity, 1, np.zeros(0), 1.0 / 12.0, False, False, 0.0, np.zeros(3), None, False, False)


@inline_jit
def fictitious_acceleration(x, y, vx, vy):
    """Return the sum of centrifugal and Coriolis acceleration (m/s^2) along the Earth-fixed x and y axes.

    It is -w x (w x r) - 2 w x v. The component along the polar axis is zero.

    Parameters
    ----------
    x, y : m, position relative to the Earth's centre, Earth-fixed axes
    vx, vy : m/s, velocity relative to the Earth, Earth-fixed axes
    """
    ax = OMEGA * OMEGA * x + 2.0 * OMEGA * vy
    ay = OMEGA * OMEGA * y - 2.0 * OMEGA * vx
    return ax, ay


@inline_jit
def mean_fictitious_acceleration(x, y, vx, vy, sx, sy, gx, gy, dt):
    """Return the acceleration of `fictitious_acceleration`, x and y in m/s^2, at the mean velocity of a step.

    Parameters
    ----------
    x, y : m, position at the middle of the step, Earth-fixed axes
    vx, vy : m/s, velocity at the start of the step
    sx, sy : m/s, velocity gained by specific force over the step
    gx, gy : m/s^2, gravitation
    dt : s, of the step
    """
    kx, ky = fictitious_acceleration(x, y, vx, vy)
    gain_x = sx + dt * (gx + kx)
    gain_y = sy + dt * (gy + ky)
    mean_vx = vx + 0.5 * gain_x
    mean_vy = vy + 0.5 * gain_y
    return fictitious_acceleration(x, y, mean_vx, mean_vy)


@inline_jit
def rotate_polar(angle_cos, angle_sin, x, y):
    """Return x and y in axes that are rotated about the polar axis by an angle with this cosine and sine."""
    return angle_cos * x + angle_sin * y, angle_cos * y - angle_sin * x


@jit
def to_earth_fixed(nav, algorithm, angle):
    """Transform a navigation state from the inertial frame to Earth-fixed axes.

    Parameters
    ----------
    nav : (10,) quaternion, velocity (m/s) and position (m), updated in place; the velocity becomes that relative to the
        rotating Earth, and the position counts from `algorithm.origin`
    algorithm : Strapdown, with `origin`
    angle : rad, from frame i to the Earth-fixed axes
    """
    c = math.cos(angle)
    s = math.sin(angle)
    half_c = math.cos(0.5 * angle)
    half_s = math.sin(0.5 * angle)
    rx = nav[R]
    ry = nav[R + 1]
    # velocity relative to the rotating Earth, v - w x r, before the rotation about the polar axis
    vx = nav[V] + OMEGA * ry
    vy = nav[V + 1] - OMEGA * rx
    vx, vy = rotate_polar(c, s, vx, vy)
    nav[V] = vx
    nav[V + 1] = vy
    x, y = rotate_polar(c, s, rx, ry)
    nav[R] = x - algorithm.origin[0]
    nav[R + 1] = y - algorithm.origin[1]
    nav[R + 2] -= algorithm.origin[2]
    q = multiply(half_c, 0.0, 0.0, -half_s, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(4):
        nav[Q + i] = q[i]


@jit
def to_inertial(nav, algorithm, angle):
    """Transform a navigation state from Earth-fixed axes back to the inertial frame, the inverse of `to_earth_fixed`.

    Parameters
    ----------
    nav : (10,) state as from `to_earth_fixed`, updated in place
    algorithm : Strapdown, with `origin`
    angle : rad, from frame i to the Earth-fixed axes
    """
    c = math.cos(angle)
    s = math.sin(angle)
    half_c = math.cos(0.5 * angle)
    half_s = math.sin(0.5 * angle)
    x = nav[R] + algorithm.origin[0]
    y = nav[R + 1] + algorithm.origin[1]
    vx = nav[V]
    vy = nav[V + 1]
    rx = c * x - s * y
    ry = s * x + c * y
    nav[R] = rx
    nav[R + 1] = ry
    nav[R + 2] += algorithm.origin[2]
    # v + w x r, with the position in the inertial frame
    nav[V] = c * vx - s * vy - OMEGA * ry
    nav[V + 1] = s * vx + c * vy + OMEGA * rx
    q = multiply(half_c, 0.0, 0.0, half_s, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(4):
        nav[Q + i] = q[i]


@jit
def turn_sums(sums, angle):
    """Rotate the integral of the attitude and the velocity gained from Earth-fixed axes to frame i; angle (rad)."""
    c = math.cos(angle)
    s = math.sin(angle)
    for column in range(3):
        first = SUM_C + column
        second = SUM_C + 3 + column
        x = sums[first]
        y = sums[second]
        sums[first] = c * x - s * y
        sums[second] = s * x + c * y
    x = sums[SUM_V]
    y = sums[SUM_V + 1]
    sums[SUM_V] = c * x - s * y
    sums[SUM_V + 1] = s * x + c * y


@inline_jit
def integrate(nav, sums, previous, increments, n_step, dt, algorithm, is_general):
    """Integrate the steps of a window in the frame of `nav`; the parameters are those of `mechanise`.

    In a step, w and f are the sums of angle and velocity increments, p and u those of the step before, a the weight
    of products across steps (1/12 at the full rate), and C the attitude at the start of the step:

        rotation vector = w + a p x w + coning within the step
        velocity gained = C (f + w x f / 2 + a (p x f + u x w) + sculling within the step)

    (Savage, J. Guidance 21, 1998, parts 1 and 2). Position is integrated by the trapezoidal rule.

    is_general : whether `algorithm` may differ from `full_rate`. Callers pass a constant, so that the compiler removes
        the branches they do not need. Long because its state stays in registers over the loop.
    """
    q0 = nav[Q]
    q1 = nav[Q + 1]
    q2 = nav[Q + 2]
    q3 = nav[Q + 3]
    vx = nav[V]
    vy = nav[V + 1]
    vz = nav[V + 2]
    rx = nav[R]
    ry = nav[R + 1]
    rz = nav[R + 2]
    px = previous[0]
    py = previous[1]
    pz = previous[2]
    ux = previous[3]
    uy = previous[4]
    uz = previous[5]
    zero = number_like(q0, 0.0)
    c = matrix(q0, q1, q2, q3)
    m0 = m1 = m2 = m3 = m4 = m5 = m6 = m7 = m8 = zero
    gained_x = gained_y = gained_z = zero
    th_x = th_y = th_z = zero
    f_x = f_y = f_z = zero
    half = 0.5 * dt
    half_turn = 0.5 * OMEGA * dt
    is_rotating = False
    has_end_attitude = False
    n_sample = 1
    previous_step_weight = 1.0 / 12.0
    if is_general:
        is_rotating = algorithm.is_rotating
        has_end_attitude = algorithm.has_end_attitude
        n_sample = algorithm.subsamples
        previous_step_weight = algorithm.previous_step_weight
    for k in range(n_step):
        first = k * n_sample
        wx, wy, wz, fx, fy, fz = increment_sums(increments, first, n_sample)

        # coning a p x w and sculling a (p x f + u x w) across steps
        coning_x, coning_y, coning_z = cross(px, py, pz, wx, wy, wz)
        coning_x = previous_step_weight * coning_x
        coning_y = previous_step_weight * coning_y
        coning_z = previous_step_weight * coning_z
        ax, ay, az = cross(px, py, pz, fx, fy, fz)
        bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
        sculling_x = previous_step_weight * (ax + bx)
        sculling_y = previous_step_weight * (ay + by)
        sculling_z = previous_step_weight * (az + bz)
        if is_general and algorithm.weights.shape[0] > 0:
            ax, ay, az, bx, by, bz = products_within_step(increments, first, algorithm)
            coning_x += ax
            coning_y += ay
            coning_z += az
            sculling_x += bx
            sculling_y += by
            sculling_z += bz

        # velocity gained in body axes at the start of the step, then in the axes of integration
        e0, e1, e2, e3 = from_rotation(wx + coning_x, wy + coning_y, wz + coning_z)
        if has_end_attitude:
            dx, dy, dz = rotate(matrix(e0, e1, e2, e3), fx, fy, fz)
        else:
            rotation_x, rotation_y, rotation_z = cross(wx, wy, wz, fx, fy, fz)
            dx = fx + 0.5 * rotation_x + sculling_x
            dy = fy + 0.5 * rotation_y + sculling_y
            dz = fz + 0.5 * rotation_z + sculling_z
        sx, sy, sz = rotate(c, dx, dy, dz)

        # gravitation at the middle of the step
        if is_rotating:
            # the axes rotate by half a step until the middle of the step; the Coriolis term uses the mean velocity
            turned_x = sx + half_turn * sy
            turned_y = sy - half_turn * sx
            sx, sy = turned_x, turned_y
            x = algorithm.origin[0] + rx + half * vx
            y = algorithm.origin[1] + ry + half * vy
            z = algorithm.origin[2] + rz + half * vz
            gx, gy, gz = gravity(algorithm.gravity, x, y, z)
            kx, ky = mean_fictitious_acceleration(x, y, vx, vy, sx, sy, gx, gy, dt)
            gx += kx
            gy += ky
            q0, q1, q2, q3 = multiply(1.0 - 0.5 * half_turn * half_turn, 0.0, 0.0, -half_turn, q0, q1, q2, q3)
        else:
            x = rx + half * vx
            y = ry + half * vy
            z = rz + half * vz
            gx, gy, gz = gravity(algorithm.gravity, x, y, z)
        nx = vx + sx + dt * gx
        ny = vy + sy + dt * gy
        nz = vz + sz + dt * gz
        rx += half * (vx + nx)
        ry += half * (vy + ny)
        rz += half * (vz + nz)
        vx, vy, vz = nx, ny, nz
        gained_x += sx
        gained_y += sy
        gained_z += sz
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, e0, e1, e2, e3)

        # mean of C over the step by the trapezoidal rule, because a spinning body rotates by up to 0.2 rad in a step
        m0 += c[0]
        m1 += c[1]
        m2 += c[2]
        m3 += c[3]
        m4 += c[4]
        m5 += c[5]
        m6 += c[6]
        m7 += c[7]
        m8 += c[8]
        c = matrix(q0, q1, q2, q3)
        m0 += c[0]
        m1 += c[1]
        m2 += c[2]
        m3 += c[3]
        m4 += c[4]
        m5 += c[5]
        m6 += c[6]
        m7 += c[7]
        m8 += c[8]
        th_x += wx
        th_y += wy
        th_z += wz
        f_x += fx
        f_y += fy
        f_z += fz
        px, py, pz = wx, wy, wz
        ux, uy, uz = fx, fy, fz
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = normalise(q0, q1, q2, q3)
    nav[V] = vx
    nav[V + 1] = vy
    nav[V + 2] = vz
    nav[R] = rx
    nav[R + 1] = ry
    nav[R + 2] = rz
    previous[0] = px
    previous[1] = py
    previous[2] = pz
    previous[3] = ux
    previous[4] = uy
    previous[5] = uz
    sums[0] = half * m0
    sums[1] = half * m1
    sums[2] = half * m2
    sums[3] = half * m3
    sums[4] = half * m4
    sums[5] = half * m5
    sums[6] = half * m6
    sums[7] = half * m7
    sums[8] = half * m8
    sums[SUM_V] = gained_x
    sums[SUM_V + 1] = gained_y
    sums[SUM_V + 2] = gained_z
    sums[SUM_TH] = th_x
    sums[SUM_TH + 1] = th_y
    sums[SUM_TH + 2] = th_z
    sums[SUM_F] = f_x
    sums[SUM_F + 1] = f_y
    sums[SUM_F + 2] = f_z


@jit
def set_to_truth(nav, reference, tick):
    """Set a navigation state (10,) to the true motion (Reference) at a tick."""
    for i in range(4):
        nav[Q + i] = reference.q_b_i[tick, i]
    for i in range(3):
        nav[V + i] = reference.v_i[tick, i]
        nav[R + i] = reference.r_i[tick, i]
