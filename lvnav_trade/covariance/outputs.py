"""Additional outputs of linear covariance after the states: IMU samples, receiver solution, backup strapdown."""

import numpy as np

from lvnav_trade.covariance.components import Components
from lvnav_trade.covariance.workspace import PassResults
from lvnav_trade.filter.receivers import receiver
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase

N_SOLUTION = 8  # velocity, position, clock bias and drift of a receiver's solution


def append_sample_outputs(
    prepared_case: PreparedCase, components: Components, history: CovHistory, results: PassResults
) -> CovHistory:
    """Append the errors of IMU samples, raw and corrected by the estimated bias, to a history.

    Without reported samples the history is returned unchanged. Covariances with other outputs are not computed and are
    zero.

    Parameters
    ----------
    prepared_case, components
        Prepared case, and its error components.
    history
        History to extend.
    results
        Results of the forward pass.
    """
    samples = prepared_case.options.reported_samples
    if samples is None:
        return history
    # the noise is in the raw and in the corrected sample
    variance = results.samples + np.tile(components.sample_noise, 2)
    n_hist = len(history.t)
    # errors are truth minus sample, so the mean error of a sample is minus its profile
    mean_error = -_profiles(prepared_case)
    mean = np.zeros((n_hist, 2 * N_SAMPLE))
    mean[:, :N_SAMPLE] = mean_error
    mean[:, N_SAMPLE:] = mean_error
    formal = np.tile(samples.raw, (n_hist, 2))
    for i, state in enumerate(samples.bias.tolist()):
        if state >= 0:
            corrected_column = N_SAMPLE + i
            mean[:, corrected_column] = -results.mean[:, state]
            formal[:, corrected_column] = results.formal[:, state, state] + samples.variance[i]
    total = variance.sum(axis=1)
    return append_outputs(history, variance, mean, _diagonal(formal), _diagonal(total))


def _profiles(prepared_case: PreparedCase) -> Floats:
    """Return the deterministic errors (n_hist, 6) of IMU samples at the history times, rad/s and m/s^2."""
    unit = prepared_case.unit
    units = prepared_case.options.imu_array
    reference = prepared_case.reference
    errors = np.zeros((prepared_case.t_hist.size, N_SAMPLE))
    last_tick = len(unit.dtheta) - 1
    ticks = np.clip(prepared_case.hist_tick - 1, 0, last_tick)
    for profile, code in enumerate(unit.profile_sensor.tolist()):
        triad, sensor = divmod(code, 2)
        value = _profile_values(prepared_case, profile)
        if units is None:
            solution_weights = np.eye(3)
            axes = np.eye(3)
            increments = (reference.dtheta, reference.dvel)[sensor]
        else:
            stages = units.stage[ticks]
            solution_weights = units.axis_weights[stages, triad, sensor]
            axes = units.frames[triad, :, 0]
            increments = (units.dtheta, units.dvel)[sensor][triad]
        if unit.profile_driver[profile] != CONSTANT:  # a scale factor multiplies the input along the sensing axis
            value *= increments[ticks] @ axes.T / unit.dt
        first = 3 * sensor
        errors[:, first : first + 3] += np.einsum("...ij,...j->...i", solution_weights, value)
    # error of the bandwidth: sensed minus true increments
    angle_error = (unit.dtheta - reference.dtheta)[ticks]
    velocity_error = (unit.dvel - reference.dvel)[ticks]
    bandwidth_error = np.hstack([angle_error, velocity_error]) / unit.dt
    return errors + bandwidth_error


def _profile_values(prepared_case: PreparedCase, profile: int) -> Floats:
    """Return a profile at the history times, (n_hist, 3) SI."""
    times = prepared_case.record.t
    values = np.empty((len(times), 3))
    for hist, t in enumerate(times):
        for axis in range(3):
            values[hist, axis] = profile_value(prepared_case.unit, profile, axis, t)
    return values


def append_solution_outputs(prepared_case: PreparedCase, history: CovHistory, results: PassResults) -> CovHistory:
    """Append the error of the receiver's last solution to a history.

    Without a reported solution the history is returned unchanged. Covariances with other outputs are not computed and
    are zero.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        History to extend.
    results
        Results of the forward pass.
    """
    report = prepared_case.options.reported_solution
    chain = prepared_case.chain
    if report is None or chain is None:
        return history
    turn = _output_matrices(prepared_case)
    turn_back = np.swapaxes(turn, 1, 2)
    # an epoch without a solution repeats the last one
    epochs = np.arange(len(chain.has_solution))
    last_solved = np.maximum.accumulate(np.where(chain.has_solution, epochs, 0))
    before_first = np.zeros((1, receiver.N_STATE, receiver.N_STATE))  # index -1: no epoch yet
    covariance = np.concatenate([chain.solver_covariance[last_solved], before_first])
    formal = turn @ covariance[last_epoch(prepared_case)] @ turn_back
    source_covariance = np.einsum("hij,hsjk,hlk->hsil", turn, results.receiver, turn)
    diagonal = range(N_SOLUTION)
    budget = source_covariance[:, :, diagonal, diagonal]
    mean = np.einsum("hij,hj->hi", turn, results.receiver_mean)
    true = source_covariance.sum(axis=1)
    return append_outputs(history, budget, mean, formal, true)


def last_epoch(prepared_case: PreparedCase) -> np.ndarray:
    """Return the last epoch before each history time, (n_hist,); -1 before the first epoch."""
    schedule = prepared_case.schedule
    epochs = np.full(prepared_case.t_hist.size, -1, dtype=np.int64)
    has_history = schedule.hist >= 0
    latest = np.maximum.accumulate(schedule.epoch)
    times = schedule.hist[has_history]
    epochs[times] = latest[has_history]
    return epochs


def _output_matrices(prepared_case: PreparedCase) -> Floats:
    """Return the matrices (n_hist, 8, 11) from the receiver-error states, frame i, to the reported outputs."""
    axes = prepared_case.record.axes
    velocity = slice(receiver.VEL, receiver.VEL + 3)
    position = slice(receiver.POS, receiver.POS + 3)
    turn = np.zeros((len(axes), N_SOLUTION, receiver.N_STATE))
    turn[:, 0:3, velocity] = axes
    turn[:, 3:6, position] = axes
    turn[:, 6, receiver.BIAS] = 1.0
    turn[:, 7, receiver.DRIFT] = 1.0
    return turn


def _diagonal(variance: Floats) -> Floats:
    return np.asarray(variance[:, :, None] * np.eye(variance.shape[1]))


def append_outputs(history: CovHistory, budget: Floats, mean: Floats, formal: Floats, true: Floats) -> CovHistory:
    """Append k outputs to a history, uncorrelated with the present outputs.

    Parameters
    ----------
    history
        History to extend.
    budget
        (n_hist, n_source, k) SI squared. Variance by source.
    mean
        (n_hist, k) SI. Mean error.
    formal, true
        (n_hist, k, k) SI squared. Covariance in the filter model, and true covariance.
    """
    k = range(mean.shape[1])
    formal_variance = formal[:, k, k]
    true_variance = np.maximum(0.0, true[:, k, k])
    formal_sigma = np.sqrt(formal_variance)
    true_sigma = np.sqrt(true_variance)
    return history._replace(
        formal_sigma=np.hstack([history.formal_sigma, formal_sigma]),
        true_sigma=np.hstack([history.true_sigma, true_sigma]),
        mean=np.hstack([history.mean, mean]),
        budget=np.concatenate([history.budget, budget], axis=2),
        formal_cov=_block_diagonal(history.formal_cov, formal),
        true_cov=_block_diagonal(history.true_cov, true),
    )


def _block_diagonal(first: Floats, second: Floats) -> Floats:
    """Return block-diagonal matrices (n_hist, n + k, n + k)."""
    n_hist = len(first)
    n = first.shape[1]
    k = second.shape[1]
    matrices = np.zeros((n_hist, n + k, n + k))
    matrices[:, :n, :n] = first
    matrices[:, n:, n:] = second
    return matrices
