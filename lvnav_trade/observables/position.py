"""One axis of the receiver's position solution, frame i."""

from __future__ import annotations

from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL


@jit
def row(h, at, axis):
    """Set the row and return the predicted antenna position (m) along an axis of frame i; h (13,), at (21,)."""
    zero = 0.0 * at[0]
    for i in range(3):
        h[H_POS + i], h[H_VEL + i], h[H_RATE + i] = zero, zero, zero
    h[H_POS + axis] = zero + 1.0
    # the antenna moves by att x lever arm
    h[H_ATT + axis] = zero
    h[H_ATT + (axis + 1) % 3] = at[6 + (axis + 2) % 3]
    h[H_ATT + (axis + 2) % 3] = -at[6 + (axis + 1) % 3]
    h[H_CLOCK] = zero
    return at[axis]


@jit
def observe(true_position, sigma, normal):
    """Return the solution's position (m) along an axis: the true one plus white noise of one-sigma `sigma`."""
    return true_position + sigma * normal
