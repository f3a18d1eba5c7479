"""Decorrelation of a receiver solution by its reported covariance: its six scalars become independent measurements."""

from lvnav_trade.filter.policies.delay import extrapolate_solution
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.whitening import whiten


@jit
def _fill_reported_covariance(covariance, receiver, signals, epoch):
    """Set the reported covariance (6, 6) of a solution: that of the receiver (Receiver), or of a simulated solution
    (None) the variances of the filter model.
    """
    for i in range(6):
        for j in range(6):
            if receiver is not None:
                scale = signals.scale[epoch, i] * signals.scale[epoch, j]
                covariance[i, j] = receiver.covariance[i, j] * scale
            else:
                variance = signals.variance[epoch, i] if i == j else 0.0
                covariance[i, j] = number_like(covariance[0, 0], variance)


@jit
def _add_residual_variance(covariance, sigma_points):
    """Add the variance that the regression over sigma points (SigmaPoints, or None) does not explain to the noise."""
    if sigma_points is not None:
        for i in range(6):
            covariance[i, i] = covariance[i, i] + sigma_points.residual_variance[i]


@jit
def _extrapolate(work, state_history, delays, epoch):
    """Extrapolate a delayed solution to the present, if the filter is so configured (DelayProcessing, or None)."""
    if delays is not None and delays.is_extrapolated:
        extrapolate_solution(work.z, work.reported_covariance, state_history, work.P, delays, epoch)


@jit
def _whiten(work, gains, model):
    """Decorrelate the rows of a solution. Stored gains (StoredGains, or None) are for correlated rows, which then
    stay.
    """
    if gains is None:
        separate(work.reported_covariance, model)
        whiten(work.reported_covariance, work.z, work.H, 6, work.H.shape[1])


@jit
def decorrelate(work, optional_state, case, receiver, delays, epoch):
    """Decorrelate the rows of a solution by its reported covariance, so that they can be processed as scalars.

    With R = L L' the rows become L^-1 z and L^-1 H, with unit variance.

    Parameters
    ----------
    receiver : Receiver, whose solution reports a covariance; None for a simulated solution
    delays : DelayProcessing, whose extrapolation correlates position with velocity; None without delay compensation
    """
    if receiver is None and delays is None:
        return
    if case.model.has_reported_covariance:
        _fill_reported_covariance(work.reported_covariance, receiver, case.signals, epoch)
        _add_residual_variance(work.reported_covariance, optional_state.sigma_points)
        _extrapolate(work, optional_state.state_history, delays, epoch)
        _whiten(work, case.options.gains, case.model)


@jit
def separate(covariance, model):
    """Set the covariance (6, 6) of position with velocity to zero if the filter does not process position.

    Position comes first in the Cholesky factor, so a filter without velocity needs no change.
    """
    if not model.is_processed[0]:
        for i in range(3):
            zero = 0.0 * covariance[i, i]
            for j in range(3, 6):
                covariance[i, j] = zero
                covariance[j, i] = zero
