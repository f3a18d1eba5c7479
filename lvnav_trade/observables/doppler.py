"""Range rate from Doppler: relative velocity along the line of sight plus the receiver's clock drift."""

from __future__ import annotations

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def row(h, at, satellite_velocity, ux, uy, uz, distance, clock_drift):
    """Set the row and return the predicted range rate (m/s).

    As `pseudorange.row`; satellite_velocity (3,) is the derivative of the satellite's position at transmission with
    respect to reception time, frame i.
    """
    wx = satellite_velocity[0] - at[3]
    wy = satellite_velocity[1] - at[4]
    wz = satellite_velocity[2] - at[5]
    along = ux * wx + uy * wy + uz * wz
    scale = -1.0 / distance
    px, py, pz = scale * (wx - along * ux), scale * (wy - along * uy), scale * (wz - along * uz)
    h[H_POS], h[H_POS + 1], h[H_POS + 2] = px, py, pz
    ax, ay, az = cross(at[6], at[7], at[8], px, py, pz)
    bx, by, bz = cross(ux, uy, uz, at[9], at[10], at[11])
    h[H_ATT], h[H_ATT + 1], h[H_ATT + 2] = ax + bx, ay + by, az + bz
    h[H_VEL], h[H_VEL + 1], h[H_VEL + 2] = -ux, -uy, -uz
    for i in range(3):
        h[H_RATE + i] = -(ux * at[12 + i] + uy * at[15 + i] + uz * at[18 + i])
    h[H_CLOCK] = 0.0 * ux + 1.0
    return along + clock_drift


@jit
def observe(true_rate, clock_drift, sigma, normal):
    """Return the measured range rate (m/s): true rate and clock drift plus white noise of one-sigma `sigma`."""
    return true_rate + clock_drift + sigma * normal
