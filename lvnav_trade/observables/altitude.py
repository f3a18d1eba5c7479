"""Height over the ellipsoid as a radar altimeter measures it, less the mean height of the ground that is known."""

from __future__ import annotations

from lvnav_trade.kernels.earth import height_and_up
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.observables.base import H_POS, clear


@jit
def row(h, nav):
    """Set the Jacobian row and return the predicted height (m); h (10,), nav (10,) navigation state, frame i."""
    height, ux, uy, uz = height_and_up(nav[R], nav[R + 1], nav[R + 2])
    clear(h)
    h[H_POS], h[H_POS + 1], h[H_POS + 2] = ux, uy, uz
    return height


@jit
def measure(out, truth, error):
    """Set out[0] to the measured height (m): the true one, truth[0], plus an error (m)."""
    out[0] = truth[0] + error
