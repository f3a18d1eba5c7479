"""Pseudorange and range rate (Doppler): distance to the satellite at transmission, and its rate, plus the clock.

A carrier phase, in metres, is a range plus a constant ambiguity (Trigo and Theil, eq. 8 times the wavelength). The
Jacobian row of a difference of two epochs (eq. 9) is that of the later range minus that of the earlier range.
"""

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import jit
from lvnav_trade.sensors.jacobian_row import D_ATT, D_CLOCK, D_POS, H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def range_row(h, antenna_state, ux, uy, uz, distance, clock_bias):
    """Set the Jacobian row of a pseudorange and return the predicted pseudorange (m).

    Parameters
    ----------
    h : (13,)
        Jacobian row, set here.
    antenna_state : (21,)
        Antenna state, as `line_of_sight.antenna` sets it.
    ux, uy, uz : float
        Unit vector from antenna to satellite, frame i.
    distance : float
        Distance of antenna and satellite (m).
    clock_bias : float
        Estimated clock bias (m).
    """
    h[H_POS] = -ux
    h[H_POS + 1] = -uy
    h[H_POS + 2] = -uz
    # a small rotation phi moves the antenna by phi x l: -u . (phi x l) = phi . (u x l)
    h[H_ATT], h[H_ATT + 1], h[H_ATT + 2] = cross(ux, uy, uz, antenna_state[6], antenna_state[7], antenna_state[8])
    zero = 0.0 * ux
    for i in range(3):
        h[H_VEL + i] = zero
        h[H_RATE + i] = zero
    h[H_CLOCK] = zero + 1.0
    return distance + clock_bias


@jit
def subtract_earlier(h, first, antenna_state, ux, uy, uz, distance, clock_bias):
    """Set the Jacobian entries of a difference for its earlier epoch, and return the predicted earlier range (m).

    Parameters
    ----------
    h : (n_entry,)
        Jacobian row; seven entries from `first` on are set.
    first : int
        Index of the first entry of the earlier epoch.
    antenna_state : (21,)
        Antenna state at the earlier epoch.
    ux, uy, uz, distance, clock_bias : float
        As in `range_row`, at the earlier epoch.
    """
    position = first + D_POS
    attitude = first + D_ATT
    h[position] = ux
    h[position + 1] = uy
    h[position + 2] = uz
    h[attitude], h[attitude + 1], h[attitude + 2] = cross(
        antenna_state[6], antenna_state[7], antenna_state[8], ux, uy, uz
    )
    h[first + D_CLOCK] = 0.0 * ux - 1.0
    return distance + clock_bias


@jit
def rate_row(h, antenna_state, satellite_velocity, ux, uy, uz, distance, clock_drift):
    """Set the Jacobian row of a range rate and return the predicted range rate (m/s).

    Parameters
    ----------
    h : (13,)
        Jacobian row, set here.
    antenna_state : (21,)
        Antenna state, as `line_of_sight.antenna` sets it.
    satellite_velocity : (3,) m/s, frame i
        Derivative of the satellite's position at transmission with respect to reception time.
    ux, uy, uz, distance : float
        Line of sight, as in `range_row`.
    clock_drift : float
        Estimated clock drift (m/s).
    """
    # velocity of the satellite relative to the antenna, and its component along the line of sight
    wx = satellite_velocity[0] - antenna_state[3]
    wy = satellite_velocity[1] - antenna_state[4]
    wz = satellite_velocity[2] - antenna_state[5]
    along = ux * wx + uy * wy + uz * wz
    # derivative by position: minus the velocity across the line over the distance
    scale = -1.0 / distance
    across_x = wx - along * ux
    across_y = wy - along * uy
    across_z = wz - along * uz
    px = scale * across_x
    py = scale * across_y
    pz = scale * across_z
    h[H_POS] = px
    h[H_POS + 1] = py
    h[H_POS + 2] = pz
    # a small rotation changes position and velocity of the antenna: arms antenna_state[6:9] and antenna_state[9:12]
    position_x, position_y, position_z = cross(antenna_state[6], antenna_state[7], antenna_state[8], px, py, pz)
    velocity_x, velocity_y, velocity_z = cross(ux, uy, uz, antenna_state[9], antenna_state[10], antenna_state[11])
    h[H_ATT] = position_x + velocity_x
    h[H_ATT + 1] = position_y + velocity_y
    h[H_ATT + 2] = position_z + velocity_z
    h[H_VEL] = -ux
    h[H_VEL + 1] = -uy
    h[H_VEL + 2] = -uz
    for i in range(3):
        rate_partial = ux * antenna_state[12 + i] + uy * antenna_state[15 + i] + uz * antenna_state[18 + i]
        h[H_RATE + i] = -rate_partial
    h[H_CLOCK] = 0.0 * ux + 1.0
    return along + clock_drift


@jit
def observe(true_value, clock, sigma, normal):
    """Return a measured pseudorange (m), range rate (m/s) or carrier phase (m).

    Parameters
    ----------
    true_value : float
        True value, with the correlated errors.
    clock : float
        Clock bias (m), or drift (m/s) for a range rate.
    sigma : float
        Standard deviation of the white noise.
    normal : float
        Standard normal draw.
    """
    return true_value + clock + sigma * normal
