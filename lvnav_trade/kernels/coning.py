"""Compensation of coning and sculling: products of increments, and rotation of the velocity increment."""

from lvnav_trade.kernels.attitude import cross, from_rotation, matrix, rotate
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like


@inline_jit
def increment_sums(increments, first, subsamples):
    """Return the sums of angle (3) rad and velocity (3) m/s increments of a step, body axes.

    Parameters
    ----------
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    subsamples : number of increments of the step
    """
    wx = increments[first, 0]
    wy = increments[first, 1]
    wz = increments[first, 2]
    fx = increments[first, 3]
    fy = increments[first, 4]
    fz = increments[first, 5]
    for row in range(first + 1, first + subsamples):
        wx += increments[row, 0]
        wy += increments[row, 1]
        wz += increments[row, 2]
        fx += increments[row, 3]
        fy += increments[row, 4]
        fz += increments[row, 5]
    return wx, wy, wz, fx, fy, fz


@inline_jit
def products_within_step(increments, first, algorithm):
    """Return coning (3) rad and sculling (3) m/s by the increments of a step, body axes.

    The weighted sum of all increments but the last is multiplied by the last (Ignagni, J. Guidance 19, 1996).

    Parameters
    ----------
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    algorithm : Strapdown, with `subsamples` and `weights`
    """
    last = first + algorithm.subsamples - 1
    px = py = pz = ux = uy = uz = number_like(increments[last, 0], 0.0)
    for j in range(algorithm.weights.shape[0]):
        weight = algorithm.weights[j]
        row = first + j
        px += weight * increments[row, 0]
        py += weight * increments[row, 1]
        pz += weight * increments[row, 2]
        ux += weight * increments[row, 3]
        uy += weight * increments[row, 4]
        uz += weight * increments[row, 5]
    wx = increments[last, 0]
    wy = increments[last, 1]
    wz = increments[last, 2]
    fx = increments[last, 3]
    fy = increments[last, 4]
    fz = increments[last, 5]
    # coning p x w, sculling p x f + u x w; p, u: weighted sums of angles and velocities, w, f: the last increments
    cx, cy, cz = cross(px, py, pz, wx, wy, wz)
    ax, ay, az = cross(px, py, pz, fx, fy, fz)
    bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
    sculling_x = ax + bx
    sculling_y = ay + by
    sculling_z = az + bz
    return cx, cy, cz, sculling_x, sculling_y, sculling_z


@jit
def pair_products(increments, first, extensions):
    """Return coning (3) rad and sculling (3) m/s by the weighted products of all pairs of increments of a step.

    With the weights b_jk, coning is the sum over j < k of b_jk w_j x w_k, and sculling that of
    b_jk (w_j x f_k + f_j x w_k).

    Parameters
    ----------
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    extensions : StrapdownExtensions, with the weights `pairs`
    """
    zero = number_like(increments[first, 0], 0.0)
    cx = cy = cz = zero
    sx = sy = sz = zero
    for k in range(1, extensions.pairs.shape[0]):
        px = py = pz = zero
        ux = uy = uz = zero
        for j in range(k):
            weight = extensions.pairs[j, k]
            row = first + j
            px += weight * increments[row, 0]
            py += weight * increments[row, 1]
            pz += weight * increments[row, 2]
            ux += weight * increments[row, 3]
            uy += weight * increments[row, 4]
            uz += weight * increments[row, 5]
        later_row = first + k
        wx = increments[later_row, 0]
        wy = increments[later_row, 1]
        wz = increments[later_row, 2]
        fx = increments[later_row, 3]
        fy = increments[later_row, 4]
        fz = increments[later_row, 5]
        dx, dy, dz = cross(px, py, pz, wx, wy, wz)
        ax, ay, az = cross(px, py, pz, fx, fy, fz)
        bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
        cx += dx
        cy += dy
        cz += dz
        sx += ax + bx
        sy += ay + by
        sz += az + bz
    return cx, cy, cz, sx, sy, sz


@jit
def velocity_rotation(wx, wy, wz, fx, fy, fz):
    """Return the change (3) m/s of a velocity increment by a simultaneous rotation at constant rates.

    It is (1 - cos a) / a^2 w x f + (a - sin a) / a^3 w x (w x f), a the magnitude of w, by series in a^2 (Savage,
    J. Guidance 21, 1998, part 2).

    Parameters
    ----------
    wx, wy, wz : rad, angle increment w of the step, body axes
    fx, fy, fz : m/s, velocity increment f of the step, body axes
    """
    square = wx * wx + wy * wy + wz * wz
    # (1 - cos a) / a^2 = 1/2! - a^2/4! + a^4/6! - ..., (a - sin a) / a^3 = 1/3! - a^2/5! + a^4/7! - ...
    first = 1.0 / 720.0 - square * (1.0 / 40320.0)
    first = -1.0 / 24.0 + square * first
    first = 0.5 + square * first
    second = 1.0 / 5040.0 - square * (1.0 / 362880.0)
    second = -1.0 / 120.0 + square * second
    second = 1.0 / 6.0 + square * second
    ax, ay, az = cross(wx, wy, wz, fx, fy, fz)
    bx, by, bz = cross(wx, wy, wz, ax, ay, az)
    change_x = first * ax + second * bx
    change_y = first * ay + second * by
    change_z = first * az + second * bz
    return change_x, change_y, change_z


@inline_jit
def _products_across(previous, weight, wx, wy, wz, fx, fy, fz):
    """Return coning (3) rad and sculling (3) m/s by the products of two successive steps, body axes.

    With p and u of the step before and the weight a, coning is a p x w, and sculling a (p x f + u x w).

    Parameters
    ----------
    previous : (6,) angle (rad) and velocity (m/s) increments p, u of the step before
    weight : weight of the products
    wx, wy, wz : rad, angle increments w of the step
    fx, fy, fz : m/s, velocity increments f of the step
    """
    px = weight * previous[0]
    py = weight * previous[1]
    pz = weight * previous[2]
    cx, cy, cz = cross(px, py, pz, wx, wy, wz)
    ax, ay, az = cross(px, py, pz, fx, fy, fz)
    bx, by, bz = cross(previous[3], previous[4], previous[5], wx, wy, wz)
    sx = ax + weight * bx
    sy = ay + weight * by
    sz = az + weight * bz
    return cx, cy, cz, sx, sy, sz


@inline_jit
def _store_increments(previous, wx, wy, wz, fx, fy, fz):
    """Store the sums of angle (3) rad and velocity (3) m/s increments of a step in `previous` (6,)."""
    previous[0] = wx
    previous[1] = wy
    previous[2] = wz
    previous[3] = fx
    previous[4] = fy
    previous[5] = fz


@jit
def compensate_step(extensions, previous, increments, first, algorithm):
    """Return rotation vector (3), velocity gained (3) and summed increments (6) of a step, body axes at its start.

    The equations are those of `strapdown.integrate`. With products of pairs, the product across steps is that of the
    last increment of one step and the first of the next.

    Parameters
    ----------
    extensions : StrapdownExtensions
    previous : (6,) as in `mechanise`, updated in place
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    algorithm : Strapdown
    """
    n = algorithm.subsamples
    wx, wy, wz, fx, fy, fz = increment_sums(increments, first, n)
    tx, ty, tz = wx, wy, wz
    ux, uy, uz = fx, fy, fz
    if extensions.pairs.shape[0] > 0:
        tx, ty, tz, ux, uy, uz = increment_sums(increments, first, 1)
    cx, cy, cz, sx, sy, sz = _products_across(previous, algorithm.previous_step_weight, tx, ty, tz, ux, uy, uz)
    if algorithm.weights.shape[0] > 0:
        ax, ay, az, bx, by, bz = products_within_step(increments, first, algorithm)
        cx = cx + ax
        cy = cy + ay
        cz = cz + az
        sx = sx + bx
        sy = sy + by
        sz = sz + bz
    if extensions.pairs.shape[0] > 0:
        ax, ay, az, bx, by, bz = pair_products(increments, first, extensions)
        cx = cx + ax
        cy = cy + ay
        cz = cz + az
        sx = sx + bx
        sy = sy + by
        sz = sz + bz
        ax, ay, az = velocity_rotation(wx, wy, wz, fx, fy, fz)
    else:
        half_x = 0.5 * wx
        half_y = 0.5 * wy
        half_z = 0.5 * wz
        ax, ay, az = cross(half_x, half_y, half_z, fx, fy, fz)
    last = first + n - 1
    for i in range(6):
        previous[i] = increments[last, i]
    if extensions.pairs.shape[0] == 0:
        _store_increments(previous, wx, wy, wz, fx, fy, fz)
    dx = fx + ax + sx
    dy = fy + ay + sy
    dz = fz + az + sz
    if algorithm.has_end_attitude:
        e0, e1, e2, e3 = from_rotation(wx, wy, wz)
        c = matrix(e0, e1, e2, e3)
        dx, dy, dz = rotate(c, fx, fy, fz)
    x = wx + cx
    y = wy + cy
    z = wz + cz
    return x, y, z, dx, dy, dz, wx, wy, wz, fx, fy, fz
