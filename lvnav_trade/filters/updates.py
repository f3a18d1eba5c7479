"""The filter's update by one scalar measurement, and the noise that it assumes of it."""

from lvnav_trade.kernels.covariance import update_scalar, update_with_gain
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where


@jit
def has_reported_covariance(model, channel):
    """Return whether a channel is of a solution that comes with a covariance. Its rows are decorrelated together; with
    stored gains they stay as they are.
    """
    return model.has_covariance and channel < model.n_receiver


@jit
def _with_spread(variance, points, row):
    """Add what points (Points, or None) leave of a row."""
    return variance if points is None else variance + points.spread[row]


@jit
def _of_reported(work, gains, row):
    """Return the variance of a row of a solution with a covariance: one, since rows are decorrelated; with stored gains
    (Gains, or None) they are not.
    """
    return like(work.x[0], 1.0) if gains is None else work.reported[row, row]


@jit
def noise_variance(work, points, case, epoch, row, channel):
    """Return the variance of a row's noise as the filter assumes it (Points, or None: what points leave of it)."""
    if has_reported_covariance(case.model, channel):
        return _of_reported(work, case.options.gains, row)
    return _with_spread(like(work.x[0], case.signals.variance[epoch, channel]), points, row)


@inlined
def update_state(work, case, gains, variance, epoch, row, channel, gate_squared):
    """Update error state and covariance by one filled row of a channel, with a stored gain (Gains) or, without (None),
    that of the covariance; return its normalised innovation and its weight, 0 where the gate rejects it.
    """
    model, beta = case.model, case.signals.beta[epoch, channel]
    n = model.n_entry[channel]
    entries, columns = model.entry[channel, :n], model.column[channel, :n]
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


@inlined
def update_and_count(work, points, case, epoch, row, channel, gate_squared):
    """Update by one filled row of a channel, store its innovation and count it: accepted, or rejected by the gate;
    return its weight, 0 where it is rejected or no number.
    """
    variance = noise_variance(work, points, case, epoch, row, channel)
    normalised, weight = update_state(work, case, case.options.gains, variance, epoch, row, channel, gate_squared)
    work.innovation[epoch, channel] = normalised
    accepted = weight > 0.0
    rejected = (normalised == normalised) & (weight == 0.0)  # what is not a number is no row
    work.nis[epoch] = work.nis[epoch] + where(accepted, normalised * normalised, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(accepted, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(rejected, 1.0, 0.0)
    return weight
