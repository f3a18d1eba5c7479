"""Ranges differenced with a reference satellite, processed without correlated noise.

Ranges of other satellites minus that of the reference have the noise of the reference in common. The equivalent used
here: the reference satellite determines the clock state, by an update with gain 1 for that state and 0 for all others.
The error of the clock state is then that of the reference measurement, and the other satellites are ordinary scalar
measurements. For a difference of two epochs the state is the clock at the earlier epoch, a clone, and the gain is -1.
The clock estimate has no memory: each epoch determines it anew.
"""

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import where


@jit
def is_reference(model, signals, epoch, row):
    """Return whether a row is a measurement of the reference satellite."""
    return signals.reference[epoch, row % model.n_observable] == row // model.n_observable


@jit
def clear_first_difference(z, is_starting, differences, model, row):
    """Set a difference of two epochs to not-a-number where the filter starts at the later epoch.

    The filter has no estimate of the earlier epoch then. is_starting : condition by lane, or None without a mode logic.
    """
    if is_starting is not None and differences is not None and differences.is_difference[row % model.n_observable]:
        z[row] = where(is_starting, np.nan, z[row])
