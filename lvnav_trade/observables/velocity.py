"""One axis of the receiver's velocity solution, frame i."""

from __future__ import annotations

from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def row(h, at, axis):
    """Set the row and return the predicted antenna velocity (m/s) along an axis of frame i; h (13,), at (21,)."""
    zero = 0.0 * at[0]
    for i in range(3):
        h[H_POS + i], h[H_VEL + i] = zero, zero
    h[H_VEL + axis] = zero + 1.0
    # the antenna swings by att x the lever arm's rate
    h[H_ATT + axis] = zero
    h[H_ATT + (axis + 1) % 3] = at[9 + (axis + 2) % 3]
    h[H_ATT + (axis + 2) % 3] = -at[9 + (axis + 1) % 3]
    for i in range(3):
        h[H_RATE + i] = at[12 + 3 * axis + i]
    h[H_CLOCK] = zero
    return at[3 + axis]


@jit
def observe(true_velocity, sigma, normal):
    """Return the solution's velocity (m/s) along an axis: the true one plus white noise of one-sigma `sigma`."""
    return true_velocity + sigma * normal
