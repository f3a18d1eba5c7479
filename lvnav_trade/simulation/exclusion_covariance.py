"""Covariance of the filter after an IMU is excluded: additional noise and biases of the mean of the remaining IMUs."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.transition import ATT, CONSTANT, GYRO, VEL


@jit
def inform(P, work, units, model, seconds):
    """Inflate the covariance of the filter for excluded IMUs over a window.

    The mean of the remaining IMUs has more noise than that of all IMUs, which the filter model assumes.

    Parameters
    ----------
    P : (n, n) covariance, updated in place
    work, units : ImuArrayWork and ImuArray; None for one IMU
    model : FilterModel
    seconds : s, length of the window
    """
    if units is not None:
        _inform(P, work.redundant, units, units.redundant, model, seconds)


@jit
def _inform(P, work, units, redundancy, model, seconds):
    """Inflate the covariance as `inform` does, and store the weights it is informed of (RedundancyWork, or None)."""
    if work is not None:
        grow(
            P, work.axis_weights, work.filter_weights, work.reduction_flag[0], units.n_axis, redundancy, model, seconds
        )
        is_reduced = work.reduction_flag[0] > 0.0
        for k in range(work.axis_weights.shape[0]):
            for sensor in range(2):
                for i in range(3):
                    for c in range(3):
                        last = work.filter_weights[k, sensor, i, c]
                        present = work.axis_weights[k, sensor, i, c]
                        work.filter_weights[k, sensor, i, c] = where(is_reduced, present, last)


@jit
def grow(P, weights, initial_weights, reduction_flag, n_axis, redundancy, model, seconds):
    """Inflate a covariance over a window for the additional errors of the mean of some IMUs.

    White noise and random walk of the biases exceed those of the mean of all IMUs. When the weights change, the
    combined bias changes once.

    Parameters
    ----------
    P : (n, n) covariance, updated in place
    weights, initial_weights : (n_triad, 2, 3, 3) weights of the axes in the mean now, and at the start of the window
    reduction_flag : 1 in the runs with excluded IMUs
    n_axis, redundancy, model : number of axes of each triad, ImuRedundancy, FilterModel
    seconds : s, length of the window
    """
    for sensor in range(2):
        first = ATT if sensor == GYRO else VEL
        total = number_like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                noise = redundancy.noise[sensor, k, c]
                for i in range(3):
                    weight = weights[k, sensor, i, c]
                    all_units = redundancy.mean[0, k, sensor, i, c]
                    excess = weight * weight - all_units * all_units
                    total = total + excess * noise
        is_increase = (reduction_flag > 0.0) & (total > 0.0)
        total = where(is_increase, total * (seconds / 3.0), 0.0)  # mean over the three axes
        for i in range(3):
            state = first + i
            P[state, state] = P[state, state] + total
    weight_pair = (weights, initial_weights)
    for b in range(model.par_offset.shape[0]):
        if model.par_driver[b] == CONSTANT:
            sensor = model.par_sensor[b]
            first = model.par_offset[b]
            if redundancy.uses_prime:
                _renew_bias(P, weight_pair, reduction_flag, n_axis, redundancy, sensor, first)
            _grow_bias(P, weight_pair, reduction_flag, n_axis, redundancy, sensor, first, seconds)


@jit
def _renew_bias(P, weight_pair, reduction_flag, n_axis, redundancy, sensor, first):
    """Reset the filter's bias states after a hand-over: uncorrelated, with the variance -P.

    The estimate is unchanged, and its error is b2 - b1 + e with e = b1 less the estimate. The estimate of a filter that
    models all errors is uncorrelated with e, so Cov(b1, e) = P and, of any other error x, Cov(x, b1) = Cov(x, e). The
    new variance is s1^2 + s2^2 - P, at least s2^2, and the covariances with other errors are zero. `_grow_bias` adds
    s1^2 + s2^2.

    Parameters
    ----------
    P : (n, n) covariance, updated in place
    weight_pair : (n_triad, 2, 3, 3) twice, weights of the axes in the mean now, and at the start of the window
    reduction_flag : 1 in the runs with excluded IMUs
    n_axis : (n_triad,) number of axes
    redundancy : ImuRedundancy
    sensor : GYRO or ACCEL
    first : first state of the bias
    """
    weights, initial_weights = weight_pair
    for i in range(3):
        state = first + i
        change = number_like(P[0, 0], 0.0)
        new_variance = number_like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                weight = weights[k, sensor, i, c]
                step = weight - initial_weights[k, sensor, i, c]
                variance = redundancy.spread[sensor, k, c]
                step_variance = step * step * variance
                present_variance = weight * weight * variance
                change = change + step_variance
                new_variance = new_variance + present_variance
        formal = P[state, state]
        is_handed_over = (reduction_flag > 0.0) & (change > 0.0)
        for j in range(P.shape[0]):
            P[state, j] = where(is_handed_over, 0.0, P[state, j])
            P[j, state] = where(is_handed_over, 0.0, P[j, state])
        largest_reduction = change - new_variance  # at least the variance of the new bias remains
        reduction = where(formal < largest_reduction, formal, largest_reduction)
        P[state, state] = where(is_handed_over, -reduction, formal)


@jit
def _grow_bias(P, weight_pair, reduction_flag, n_axis, redundancy, sensor, first, seconds):
    """Inflate the variances of a bias, as `grow` describes.

    Parameters
    ----------
    P, weight_pair, reduction_flag, n_axis, redundancy, sensor, first : as in `_renew_bias`
    seconds : s, length of the window
    """
    weights, initial_weights = weight_pair
    for i in range(3):
        total = number_like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                weight = weights[k, sensor, i, c]
                all_units = redundancy.mean[0, k, sensor, i, c]
                step = weight - initial_weights[k, sensor, i, c]
                excess = weight * weight - all_units * all_units
                variance = redundancy.spread[sensor, k, c]
                variance_rate = redundancy.walk[sensor, k, c]
                total = total + step * step * variance
                total = total + excess * variance_rate * seconds
        state = first + i
        is_increase = (reduction_flag > 0.0) & (total > 0.0)
        increase = where(is_increase, total, 0.0)
        P[state, state] = P[state, state] + increase
