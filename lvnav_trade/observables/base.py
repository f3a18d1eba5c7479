"""Geometry that every GNSS row needs: the antenna, the line of sight, and a row's form.

A row is z - z_hat = h . x + v with x = truth minus estimate. Its entries stand for the columns of `COLUMNS`:
position (3), attitude (3), velocity (3), clock (1), body rate (3); a row type uses the first so many of them that it
needs.
"""

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, sqrt
from lvnav_trade.kernels.strapdown import Q, R, V

# Where the entries of a row stand; H_RATE: of the error of the body rate, by the antenna's swing.
H_POS, H_ATT, H_VEL, H_CLOCK, H_RATE, N_ENTRY = 0, 3, 6, 9, 10, 13
# Where those of the earlier epoch of a difference stand, behind all others; its extra states follow.
D_POS, D_ATT, D_CLOCK, D_EXTRA = 0, 3, 6, 7


@jit
def antenna(out, nav, rate, lever, sign):
    """Set the estimated antenna state: out (21,) position (m), velocity (m/s), lever arm and its rate, all in frame i,
    and the velocity by each component of what the body rate is known by (m), 3 x 3.

    nav (10,) navigation state; rate (3,) body rate (rad/s); lever (3,) antenna from the unit, body frame (m); sign of
    the body rate's error in the state that it is known by: 1 for the rate itself, -1 for a gyro bias.
    """
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    sx, sy, sz = cross(rate[0], rate[1], rate[2], lever[0], lever[1], lever[2])
    for i in range(3):
        row = 3 * i
        arm = c[row] * lever[0] + c[row + 1] * lever[1] + c[row + 2] * lever[2]
        swing = c[row] * sx + c[row + 1] * sy + c[row + 2] * sz
        out[i], out[3 + i] = nav[R + i] + arm, nav[V + i] + swing
        out[6 + i], out[9 + i] = arm, swing
        out[12 + row] = sign * (c[row + 2] * lever[1] - c[row + 1] * lever[2])
        out[13 + row] = sign * (c[row] * lever[2] - c[row + 2] * lever[0])
        out[14 + row] = sign * (c[row + 1] * lever[0] - c[row] * lever[1])


@jit
def line_of_sight(satellite, at):
    """Return unit vector from antenna to satellite and their distance; satellite (3,) m, frame i; `at` as of
    `antenna`.
    """
    dx, dy, dz = satellite[0] - at[0], satellite[1] - at[1], satellite[2] - at[2]
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / distance
    return dx * scale, dy * scale, dz * scale, distance


@jit
def add(out, truth, e0, e1, e2):
    """Set out[:3] to what a sensor measures of up to three quantities: the true ones, truth[:3], plus errors."""
    out[0], out[1], out[2] = truth[0] + e0, truth[1] + e1, truth[2] + e2


@jit
def clear(h):
    """Set the entries of a Jacobian row (10,) to zero, those of extra states apart."""
    zero = like(h[0], 0.0)
    for i in range(N_ENTRY):
        h[i] = zero
