"""Ranges less that of a reference satellite, without off-diagonal noise: its measurement determines the clock.

What the other satellites measure less that of the reference has the noise of the reference in common. The same results
from making the clock's state what the reference measures (an update with the gain one for that state, zero for others):
the state's error is then the reference's, and other satellites are ordinary rows. Of a difference of two epochs it is
the clock at the earlier one, a clone, with the gain minus one. So nothing is known of the clock but what an epoch
measures.
"""

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import where


@jit
def is_reference(model, signals, epoch, row):
    """Return whether a row is of the satellite that others are differenced with."""
    return signals.reference[epoch, row % model.n_kind] == row // model.n_kind


@jit
def leave_out(z, starts, delayed, model, row):
    """Let a difference of two epochs be no number where the filter starts at the later one (lanes, or None): of the
    earlier one it knows nothing.
    """
    if starts is not None and delayed is not None and delayed.difference[row % model.n_kind]:
        z[row] = where(starts, np.nan, z[row])
