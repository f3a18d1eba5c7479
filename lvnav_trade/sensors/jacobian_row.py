"""Layout of the Jacobian row of a scalar measurement, and small functions of the measurement kernels.

A scalar measurement is z - z_hat = h . x + v with x = truth minus estimate. The entries of h are the derivatives by
position (3), attitude (3), velocity (3), clock (1) and body rate (3). A measurement uses only the leading entries that
it needs.
"""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, sqrt

_HALVINGS = 3
# Indices of the entries; H_RATE: error of the body rate, through the rotation of the antenna about the IMU.
H_POS, H_ATT, H_VEL, H_CLOCK, H_RATE, N_ENTRY = 0, 3, 6, 9, 10, 13
# Indices of the entries for the earlier epoch of a difference, after all others; its extra states follow.
D_POS, D_ATT, D_CLOCK, D_EXTRA = 0, 3, 6, 7


@jit
def add(out, truth, e0, e1, e2):
    """Set the measured values of up to three quantities: true values plus errors.

    Parameters
    ----------
    out : (4,)
        Measured values; the first three are set.
    truth : (4,)
        Error-free values, SI.
    e0, e1, e2 : float
        Errors, SI.
    """
    out[0] = truth[0] + e0
    out[1] = truth[1] + e1
    out[2] = truth[2] + e2


@jit
def clear(h):
    """Set the entries of a Jacobian row (N_ENTRY,) to zero; entries of extra states do not change."""
    zero = number_like(h[0], 0.0)
    for i in range(N_ENTRY):
        h[i] = zero


@jit
def add_angle_error(c, s, error):
    """Return cosine and sine of an angle plus an error.

    The series is exact to 1e-10 for errors below 0.1 rad.

    Parameters
    ----------
    c, s : float
        Cosine and sine of the angle.
    error : float
        Error of the angle (rad).
    """
    square = error * error
    # series to the fifth power
    cosine = 1.0 - 0.5 * square * (1.0 - square / 12.0)
    sine = error * (1.0 - square / 6.0 * (1.0 - 0.05 * square))
    turned_cosine = c * cosine - s * sine
    turned_sine = s * cosine + c * sine
    return turned_cosine, turned_sine


@jit
def arctangent(opposite, adjacent):
    """Return the angle of a right triangle in rad, -pi/2 to pi/2, to 1e-8 rad for tangents below 10.

    The compiled lanes have no arctangent: halve the angle, then use the series.

    Parameters
    ----------
    opposite, adjacent : float
        Sides of the triangle, in the same unit.
    """
    t = opposite / adjacent
    for _ in range(_HALVINGS):
        t = t / (1.0 + sqrt(1.0 + t * t))  # tangent of half the angle
    t2 = t * t
    series = 1.0 - t2 * (1.0 / 3.0 - t2 * (0.2 - t2 * (1.0 / 7.0 - t2 / 9.0)))
    return 2.0**_HALVINGS * t * series
