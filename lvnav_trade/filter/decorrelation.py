"""Decorrelation of a receiver solution by its reported covariance: its six scalars become independent measurements."""

from lvnav_trade.filter.policies.delay import carry_on
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.whitening import whiten


@jit
def _fill_reported(reported, receiver, signals, epoch):
    """Set the reported covariance (6, 6) of a solution: that of the receiver (Receiver), or of a simulated solution
    (None) the variances of the filter model.
    """
    for i in range(6):
        for j in range(6):
            if receiver is not None:
                scale = signals.scale[epoch, i] * signals.scale[epoch, j]
                reported[i, j] = receiver.covariance[i, j] * scale
            else:
                variance = signals.variance[epoch, i] if i == j else 0.0
                reported[i, j] = like(reported[0, 0], variance)


@jit
def _add_spread(reported, sigma_points):
    """Add the variance that the regression over sigma points (SigmaPoints, or None) does not explain to the noise."""
    if sigma_points is not None:
        for i in range(6):
            reported[i, i] = reported[i, i] + sigma_points.spread[i]


@jit
def _extrapolate(work, state_history, late, epoch):
    """Extrapolate a delayed solution to the present, if the filter is so configured (DelayProcessing, or None)."""
    if late is not None and late.extrapolated:
        carry_on(work.z, work.reported, state_history, work.P, late, epoch)


@jit
def _whiten(work, gains, model):
    """Decorrelate the rows of a solution. Stored gains (StoredGains, or None) are for correlated rows, which then
    stay.
    """
    if gains is None:
        separate(work.reported, model)
        whiten(work.reported, work.z, work.H, 6, work.H.shape[1])


@jit
def decorrelate(work, parts, case, receiver, late, epoch):
    """Decorrelate the rows of a solution by its reported covariance, so that they can be processed as scalars.

    With R = L L' the rows become L^-1 z and L^-1 H, with unit variance.

    Parameters
    ----------
    receiver : Receiver, whose solution reports a covariance; None for a simulated solution
    late : DelayProcessing, whose extrapolation correlates position with velocity; None without delay compensation
    """
    if receiver is None and late is None:
        return
    if case.model.has_covariance:
        _fill_reported(work.reported, receiver, case.signals, epoch)
        _add_spread(work.reported, parts.sigma_points)
        _extrapolate(work, parts.state_history, late, epoch)
        _whiten(work, case.options.gains, case.model)


@jit
def separate(covariance, model):
    """Set the covariance (6, 6) of position with velocity to zero if the filter does not process position.

    Position comes first in the Cholesky factor, so a filter without velocity needs no change.
    """
    if not model.measured[0]:
        for i in range(3):
            zero = 0.0 * covariance[i, i]
            for j in range(3, 6):
                covariance[i, j] = zero
                covariance[j, i] = zero
