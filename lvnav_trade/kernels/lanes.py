"""f64x8: eight runs in one value, so that a kernel written for one run steps eight."""

from __future__ import annotations

import math

from lvnav_trade.kernels.jit import jit


@jit
def sqrt(x):
    """Square root of a value (the lane form is being added)."""
    return math.sqrt(x)
