"""The six scalars of the receiver's solution, frame i: position x, y, z (0 to 2) and velocity x, y, z (3 to 5)."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def row(h, antenna_state, scalar):
    """Set the Jacobian row of a scalar of the solution and return its prediction (m or m/s) at the antenna.

    Parameters
    ----------
    h : (13,)
        Jacobian row, set here.
    antenna_state : (21,)
        Antenna state, as `line_of_sight.antenna` sets it.
    scalar : int
        Index of the scalar, 0 to 5.
    """
    zero = 0.0 * antenna_state[0]
    axis = scalar % 3
    second = (axis + 1) % 3
    third = (axis + 2) % 3
    is_velocity = scalar >= 3
    for i in range(3):
        h[H_POS + i] = zero
        h[H_VEL + i] = zero
        h[H_RATE + i] = antenna_state[12 + 3 * axis + i] if is_velocity else zero
    h[(H_VEL if is_velocity else H_POS) + axis] = zero + 1.0
    # a small rotation phi moves the antenna by phi x l, and changes its velocity by phi x (w x l)
    arm = 9 if is_velocity else 6
    h[H_ATT + axis] = zero
    h[H_ATT + second] = antenna_state[arm + third]
    h[H_ATT + third] = -antenna_state[arm + second]
    h[H_CLOCK] = zero
    return antenna_state[scalar]


@jit
def observe(true_value, sigma, normal):
    """Return a measured scalar of the solution (m or m/s).

    Parameters
    ----------
    true_value : float
        True value, with the correlated errors.
    sigma : float
        Standard deviation of the white noise.
    normal : float
        Standard normal draw.
    """
    return true_value + sigma * normal
