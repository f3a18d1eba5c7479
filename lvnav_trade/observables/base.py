"""Form of a measurement's row of the Jacobian.

A row is z - z_hat = h . x + v with x = truth minus estimate. Its entries stand for the columns of `COLUMNS`:
position (3), attitude (3), velocity (3), clock (1), body rate (3); a row type uses the first so many of them that it
needs.
"""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, sqrt

_HALVINGS = 3
# Where the entries of a row stand; H_RATE: of the error of the body rate, by the antenna's swing.
H_POS, H_ATT, H_VEL, H_CLOCK, H_RATE, N_ENTRY = 0, 3, 6, 9, 10, 13
# Where those of the earlier epoch of a difference stand, behind all others; its extra states follow.
D_POS, D_ATT, D_CLOCK, D_EXTRA = 0, 3, 6, 7


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


@jit
def turned(c, s, error):
    """Return cosine and sine of an angle, of which they are given, plus an error (rad): exact to 1e-10 below 0.1."""
    square = error * error
    # series to the fifth power
    cosine, sine = 1.0 - 0.5 * square * (1.0 - square / 12.0), error * (1.0 - square / 6.0 * (1.0 - 0.05 * square))
    return c * cosine - s * sine, s * cosine + c * sine


@jit
def angle_of(opposite, adjacent):
    """Return the angle (rad) of a right triangle, -pi/2 to pi/2, where its tangent is below 10 to 1e-8 rad."""
    t = opposite / adjacent
    for _ in range(_HALVINGS):
        t = t / (1.0 + sqrt(1.0 + t * t))
    t2 = t * t
    series = 1.0 - t2 * (1.0 / 3.0 - t2 * (0.2 - t2 * (1.0 / 7.0 - t2 / 9.0)))
    return 2.0**_HALVINGS * t * series
