"""Results of the forward pass at a history time: covariances, means, budget, samples."""

from lvnav_trade.covariance.imu_array import samples_of_units
from lvnav_trade.kernels.covariance import variance_along
from lvnav_trade.kernels.groups import group, total_of, whole
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.transition import ATT, POS, VEL, sensed_driver
from lvnav_trade.kernels.vehicle import N_SAMPLE


@jit
def write(out, hist, formal, state, scratch, true, axes_att, axes):
    """Write covariances, mean and error budget at a history time.

    Parameters
    ----------
    out : PassResults, updated in place
    hist : history time
    formal : (n, n) covariance of the filter
    state, scratch, true : JointCovariance, Scratch, Components
    axes_att, axes : (3, 3) rotations from frame i to body axes and to the reporting axes, for the budget
    """
    n = formal.shape[0]
    for i in range(n):
        out.mean[hist, i] = state.mean[i]
        for j in range(i, n):
            out.formal[hist, i, j], out.formal[hist, j, i] = formal[i, j], formal[i, j]
            sum_of = whole(scratch.spread)
            sum_of[0] = group(state.sources, 0)[i, j]
            for g in range(1, true.n_slot.shape[0]):
                sum_of[0] = sum_of[0] + group(state.sources, g)[i, j]
            total = total_of(scratch.spread)
            out.true[hist, i, j], out.true[hist, j, i] = total, total
    for g in range(true.n_slot.shape[0]):
        P, budget = group(state.sources, g), group(scratch.budget, g)
        for i in range(3):
            budget[ATT + i, 0] = variance_along(P, ATT, axes_att[i, 0], axes_att[i, 1], axes_att[i, 2])
            budget[VEL + i, 0] = variance_along(P, VEL, axes[i, 0], axes[i, 1], axes[i, 2])
            budget[POS + i, 0] = variance_along(P, POS, axes[i, 0], axes[i, 1], axes[i, 2])
        for i in range(9, n):
            budget[i, 0] = P[i, i]
    for source in range(true.group.shape[0]):
        budget = scratch.budget[true.group[source], ..., true.lane[source]]
        for i in range(n):
            out.budget[hist, source, i] = budget[i, 0]


@jit
def write_samples(out, hist, state, true, units, samples, tick, dt):
    """Write the error variance of IMU samples without their noise by source: raw, and corrected by the estimated bias.

    units : Units of an IMU array, or None; samples : Samples; tick, dt : last tick, s
    """
    _write_biases(out, hist, state, true, samples)
    if units is None:
        _write_components(out, hist, state, true, samples, tick)
    else:
        samples_of_units(out, hist, state, true, units, samples, tick, dt)


@jit
def _write_biases(out, hist, state, true, samples):
    for source in range(true.group.shape[0]):
        P = state.sources[true.group[source], ..., true.lane[source]]
        for r in range(N_SAMPLE):
            at = samples.bias[r]
            if at >= 0:
                out.samples[hist, source, 6 + r] += P[at, at]


@jit
def _write_components(out, hist, state, true, samples, tick):
    """Add the variance of IMU error components to those of raw and corrected samples, for one IMU."""
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 or true.driver[j] < 0:
            continue
        u = sensed_driver(true.sensor[j], true.driver[j], samples.rate[tick], samples.force[tick])
        for axis in range(3):
            r, c = 3 * true.sensor[j] + axis, true.first[j] + axis
            source, k, at = true.source[c], true.slot[c], samples.bias[r]
            g, lane = true.group[source], true.lane[source]
            variance = u[axis] * u[axis] * state.variance[g, k, 0, lane]
            out.samples[hist, source, r] += variance
            if at < 0:
                out.samples[hist, source, 6 + r] += variance
            elif true.state_from[c] == true.state_from[c + 1] or true.states[true.state_from[c]] != at:
                shared = 2.0 * u[axis] * state.cross[g, k, at, lane]
                out.samples[hist, source, 6 + r] += variance + shared


@jit
def write_solution(out, hist):
    """Write mean and covariance of the receiver's last solution at a history time."""
    for i in range(out.held_mean.shape[0]):
        out.receiver_mean[hist, i] = out.held_mean[i]
        for j in range(out.held_mean.shape[0]):
            for source in range(out.held.shape[0]):
                out.receiver[hist, source, i, j] = out.held[source, i, j]
