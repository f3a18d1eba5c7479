"""Pseudorange: distance to the satellite at transmission plus the receiver's clock bias."""

from __future__ import annotations

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def row(h, at, ux, uy, uz, distance, clock_bias):
    """Set the row and return the predicted pseudorange (m).

    h (13,) set; at (21,) antenna state; ux, uy, uz line of sight from antenna to satellite, frame i; clock_bias in m.
    """
    h[H_POS], h[H_POS + 1], h[H_POS + 2] = -ux, -uy, -uz
    h[H_ATT], h[H_ATT + 1], h[H_ATT + 2] = cross(ux, uy, uz, at[6], at[7], at[8])
    for i in range(3):
        h[H_VEL + i], h[H_RATE + i] = 0.0 * ux, 0.0 * ux
    h[H_CLOCK] = 0.0 * ux + 1.0
    return distance + clock_bias


@jit
def observe(true_range, clock_bias, sigma, normal):
    """Return the measured pseudorange (m): true range and clock bias (m) plus white noise of one-sigma `sigma`."""
    return true_range + clock_bias + sigma * normal
