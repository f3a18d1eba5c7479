"""Measurement update by one scalar measurement, with the noise variance of the filter model."""

from lvnav_trade.kernels.covariance import update_scalar, update_with_gain
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, where


@jit
def has_reported_covariance(model, channel):
    """Return whether a channel belongs to a solution with a reported covariance, whose rows are decorrelated together
    (with stored gains they are not).
    """
    return model.has_reported_covariance and channel < model.n_receiver


@jit
def _add_residual_variance(variance, sigma_points, row):
    """Return a variance plus that which the regression over sigma points (SigmaPoints, or None) does not explain."""
    if sigma_points is None:
        return variance
    return variance + sigma_points.residual_variance[row]


@jit
def _reported_variance(work, gains, row):
    """Return the noise variance of a scalar of a solution with a reported covariance: 1 after decorrelation; with
    stored gains (StoredGains, or None) the reported variance, because the rows are not decorrelated.
    """
    if gains is None:
        return number_like(work.x[0], 1.0)
    return work.reported_covariance[row, row]


@jit
def noise_variance(work, sigma_points, case, epoch, row, channel):
    """Return the noise variance of a scalar measurement in the filter model.

    Parameters
    ----------
    sigma_points : SigmaPoints of an unscented filter, whose regression adds variance; None with Jacobians
    case : FilterCase
    epoch, row, channel : indices
    """
    if has_reported_covariance(case.model, channel):
        return _reported_variance(work, case.options.gains, row)
    assumed_variance = number_like(work.x[0], case.signals.variance[epoch, channel])
    return _add_residual_variance(assumed_variance, sigma_points, row)


@inline_jit
def update_state(work, case, gains, variance, epoch, row, channel, gate_squared):
    """Update error state `work.x` and covariance `work.P` by one scalar measurement.

    Parameters
    ----------
    work : arrays of the run; row `row` of H and z is filled
    case : FilterCase
    gains : StoredGains; None: the gain follows from the covariance
    variance : noise variance of the measurement
    epoch, row, channel : indices
    gate_squared : largest square of the normalised innovation that is accepted

    Returns
    -------
    normalised_innovation : innovation divided by its standard deviation
    weight : inverse of the innovation variance; 0 if the measurement is rejected
    """
    model = case.model
    beta = case.signals.beta[epoch, channel]  # under-weighting
    n = model.n_entry[channel]
    entries = model.entry[channel, :n]
    columns = model.column[channel, :n]
    if gains is None:
        return update_scalar(
            work.P,
            work.x,
            work.K,
            work.H[row],
            entries,
            columns,
            work.z[row],
            variance,
            gate_squared,
            model.n_estimated,
            model.joseph,
            beta,
        )
    return update_with_gain(
        work.P,
        work.x,
        work.K,
        work.H[row],
        entries,
        columns,
        gains.gain[epoch, channel],
        work.z[row],
        variance,
        gate_squared,
        model.n_estimated,
        beta,
    )


@inline_jit
def update_and_count(work, sigma_points, case, epoch, row, channel, gate_squared):
    """Update by one scalar measurement, store its innovation and count it as accepted or rejected.

    Arguments are those of `noise_variance` and `update_state`. Returns the weight: 0 if the gate rejects the
    measurement or its innovation is not a number.
    """
    variance = noise_variance(work, sigma_points, case, epoch, row, channel)
    normalised_innovation, weight = update_state(
        work,
        case,
        case.options.gains,
        variance,
        epoch,
        row,
        channel,
        gate_squared,
    )
    work.innovation[epoch, channel] = normalised_innovation
    is_accepted = weight > 0.0
    is_measured = normalised_innovation == normalised_innovation  # not-a-number: there is no measurement
    is_rejected = is_measured & (weight == 0.0)
    work.nis[epoch] = work.nis[epoch] + where(is_accepted, normalised_innovation * normalised_innovation, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(is_accepted, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(is_rejected, 1.0, 0.0)
    return weight
