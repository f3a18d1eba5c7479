"""Ranges less that of a reference satellite, without off-diagonal noise: its measurement stands in for the clock.

What the other satellites measure less that of the reference has the noise of the reference in common. The same results
from making the clock's state what the reference measures (an update with the gain one for that state, zero for others):
the state's error is then the reference's, and other satellites are ordinary rows. Of a difference of two epochs it is
the clock at the earlier one, a clone, with the gain minus one. So nothing is known of the clock but what an epoch
measures.
"""

import numpy as np

from lvnav_trade.filters.integrity.state import permitted
from lvnav_trade.kernels.covariance import update_with_gain
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where


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


@jit
def take_reference(work, own, delayed, model, signals, epoch, n_row, limit, starts):
    """Make bias and drift of the clock, and its bias at the earlier epoch of differences, what measurements of a
    reference satellite say, and forget what was known of them.

    The other rows less the reference's follow: their clock is the reference's error, which all of them share. This is
    the difference of measurements, with the noise that differences have in common in the clock's state in place of
    off-diagonal terms to be whitened. limit: below zero where nothing is taken. Runs that exclude the reference (own:
    Monitor, or None) keep what the clock's model predicts.
    """
    for k in range(signals.reference.shape[1]):
        if n_row > 0 and signals.reference[epoch, k] >= 0:
            slot = signals.reference[epoch, k]
            row, channel = model.n_kind * slot + k, model.n_kind * signals.used[epoch, slot] + k
            if model.measured[channel]:
                leave_out(work.z, starts, delayed, model, row)
                n = model.n_entry[channel]
                update_with_gain(
                    work.P, work.x, work.K, work.H[row], model.entry[channel, :n], model.column[channel, :n],
                    model.clock_gain[k], work.z[row], like(work.x[0], signals.variance[epoch, channel]),
                    permitted(own, channel, limit), model.n_state,
                )  # fmt: skip
