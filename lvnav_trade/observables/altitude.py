"""Height over the ellipsoid as a radar altimeter measures it, less the mean height of the ground that is known."""

from __future__ import annotations

from lvnav_trade.kernels.earth import height_and_up
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_VEL


@jit
def row(h, nav):
    """Set the row and return the predicted height (m); h (10,), nav (10,) navigation state, frame i."""
    height, ux, uy, uz = height_and_up(nav[R], nav[R + 1], nav[R + 2])
    h[H_POS], h[H_POS + 1], h[H_POS + 2] = ux, uy, uz
    for i in range(3):
        h[H_ATT + i], h[H_VEL + i] = 0.0 * ux, 0.0 * ux
    h[H_CLOCK] = 0.0 * ux
    return height


@jit
def observe(true_height, sigma, normal):
    """Return the measured height (m): the true one plus white noise of one-sigma `sigma`."""
    return true_height + sigma * normal
