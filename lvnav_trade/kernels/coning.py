"""Coning and sculling within a step: products of the increments, and rotation of the velocity increment."""

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like


@inlined
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


@inlined
def within(increments, first, algorithm):
    """Return coning (3) rad and sculling (3) m/s by the increments of a step, body axes.

    The weighted sum of all increments but the last is multiplied by the last (Ignagni, J. Guidance 19, 1996).

    Parameters
    ----------
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    algorithm : Strapdown, with `subsamples` and `weights`
    """
    last = first + algorithm.subsamples - 1
    px = py = pz = ux = uy = uz = like(increments[last, 0], 0.0)
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
    # coning p x w, sculling p x f + u x w; p, u: weighted sums of angles and velocities, w, f: the last increments
    cx, cy, cz = cross(px, py, pz, wx, wy, wz)
    ax, ay, az = cross(px, py, pz, increments[last, 3], increments[last, 4], increments[last, 5])
    bx, by, bz = cross(ux, uy, uz, wx, wy, wz)
    return cx, cy, cz, ax + bx, ay + by, az + bz


@jit
def pair_products(increments, first, further):
    """Return coning (3) rad and sculling (3) m/s by the weighted products of all pairs of increments of a step.

    With the weights b_jk, coning is the sum over j < k of b_jk w_j x w_k, and sculling that of
    b_jk (w_j x f_k + f_j x w_k).

    Parameters
    ----------
    increments : (n, 6) angle (rad) and velocity (m/s) increments, body axes
    first : index of the first increment of the step
    further : StrapdownExtensions, with the weights `pairs`
    """
    zero = like(increments[first, 0], 0.0)
    cx = cy = cz = zero
    sx = sy = sz = zero
    for k in range(1, further.pairs.shape[0]):
        px = py = pz = zero
        ux = uy = uz = zero
        for j in range(k):
            weight = further.pairs[j, k]
            row = first + j
            px += weight * increments[row, 0]
            py += weight * increments[row, 1]
            pz += weight * increments[row, 2]
            ux += weight * increments[row, 3]
            uy += weight * increments[row, 4]
            uz += weight * increments[row, 5]
        later = first + k
        wx = increments[later, 0]
        wy = increments[later, 1]
        wz = increments[later, 2]
        dx, dy, dz = cross(px, py, pz, wx, wy, wz)
        ax, ay, az = cross(px, py, pz, increments[later, 3], increments[later, 4], increments[later, 5])
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
    first = 0.5 + square * (-1.0 / 24.0 + square * (1.0 / 720.0 - square * (1.0 / 40320.0)))
    second = 1.0 / 6.0 + square * (-1.0 / 120.0 + square * (1.0 / 5040.0 - square * (1.0 / 362880.0)))
    ax, ay, az = cross(wx, wy, wz, fx, fy, fz)
    bx, by, bz = cross(wx, wy, wz, ax, ay, az)
    return first * ax + second * bx, first * ay + second * by, first * az + second * bz
