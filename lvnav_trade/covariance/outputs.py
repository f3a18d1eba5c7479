"""Additional outputs of linear covariance after the states: IMU samples, receiver solution, backup strapdown."""

import numpy as np

from lvnav_trade.covariance.components import Components
from lvnav_trade.covariance.workspace import PassResults
from lvnav_trade.filter.receivers import receiver
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.preparation.prepare import Prepared

N_SOLUTION = 8  # velocity, position, clock bias and drift of a receiver's solution


def sample_outputs(prepared: Prepared, true: Components, history: CovHistory, out: PassResults) -> CovHistory:
    """Append the errors of IMU samples, raw and corrected by the estimated bias, to a history.

    Without reported samples the history is returned unchanged. Covariances with other outputs are not computed and are
    zero.

    Parameters
    ----------
    prepared, true
        Prepared case, and its error components.
    history
        History to extend.
    out
        Results of the forward pass.
    """
    samples = prepared.options.samples
    if samples is None:
        return history
    variance = out.samples + np.tile(true.sample_noise, 2)
    n_hist = len(history.t)
    mean = np.zeros((n_hist, 2 * N_SAMPLE))
    mean[:, :N_SAMPLE] = mean[:, N_SAMPLE:] = -_profiles(prepared)
    formal = np.tile(samples.raw, (n_hist, 2))
    for i, state in enumerate(samples.bias.tolist()):
        if state >= 0:
            mean[:, N_SAMPLE + i] = -out.mean[:, state]
            formal[:, N_SAMPLE + i] = out.formal[:, state, state] + samples.variance[i]
    return append_outputs(history, variance, mean, _diagonal(formal), _diagonal(variance.sum(axis=1)))


def _profiles(prepared: Prepared) -> Floats:
    """Return the deterministic errors (n_hist, 6) of IMU samples at the history times, rad/s and m/s^2."""
    errors, unit = np.zeros((prepared.t_hist.size, N_SAMPLE)), prepared.unit
    units, ref = prepared.options.units, prepared.reference
    ticks = np.clip(prepared.hist_tick - 1, 0, len(unit.dtheta) - 1)
    for profile, code in enumerate(unit.profile_sensor.tolist()):
        triad, sensor = divmod(code, 2)
        solved = np.eye(3) if units is None else units.solved[units.stage[ticks], triad, sensor]
        value = np.array([[profile_value(unit, profile, axis, t) for axis in range(3)] for t in prepared.record.t])
        if unit.profile_driver[profile] != CONSTANT:
            increments = (ref.dtheta, ref.dvel)[sensor] if units is None else (units.dtheta, units.dvel)[sensor][triad]
            value *= increments[ticks] @ (np.eye(3) if units is None else units.frames[triad, :, 0]).T / unit.dt
        errors[:, 3 * sensor : 3 * sensor + 3] += np.einsum("...ij,...j->...i", solved, value)
    bandwidth = (unit.dtheta - ref.dtheta)[ticks], (unit.dvel - ref.dvel)[ticks]
    return errors + np.hstack(bandwidth) / unit.dt


def solution_outputs_of(prepared: Prepared, history: CovHistory, out: PassResults) -> CovHistory:
    """Append the error of the receiver's last solution to a history.

    Without a reported solution the history is returned unchanged. Covariances with other outputs are not computed and
    are zero.
    """
    report, chain = prepared.options.report, prepared.chain
    if report is None or chain is None:
        return history
    turn = _turn(prepared)
    # formal covariance of the last solution at each epoch
    covariance = chain.own[np.maximum.accumulate(np.where(chain.solved, np.arange(len(chain.solved)), 0))]
    last = last_epoch(prepared)
    formal = (
        turn
        @ np.concatenate([covariance, np.zeros((1, receiver.N_STATE, receiver.N_STATE))])[last]
        @ np.swapaxes(turn, 1, 2)
    )
    by_source = np.einsum("hij,hsjk,hlk->hsil", turn, out.receiver, turn)
    diagonal = range(N_SOLUTION)
    mean = np.einsum("hij,hj->hi", turn, out.receiver_mean)
    return append_outputs(history, by_source[:, :, diagonal, diagonal], mean, formal, by_source.sum(axis=1))


def last_epoch(prepared: Prepared) -> np.ndarray:
    """Return the last epoch before each history time, (n_hist,); -1 before the first epoch."""
    schedule = prepared.schedule
    epochs = np.full(prepared.t_hist.size, -1, dtype=np.int64)
    at = schedule.hist >= 0
    epochs[schedule.hist[at]] = np.maximum.accumulate(schedule.epoch)[at]
    return epochs


def _turn(prepared: Prepared) -> Floats:
    """Return the matrices (n_hist, 8, 11) from the receiver-error states, frame i, to the reported outputs."""
    axes = prepared.record.axes
    turn = np.zeros((len(axes), N_SOLUTION, receiver.N_STATE))
    turn[:, 0:3, receiver.VEL : receiver.VEL + 3] = axes
    turn[:, 3:6, receiver.POS : receiver.POS + 3] = axes
    turn[:, 6, receiver.BIAS] = turn[:, 7, receiver.DRIFT] = 1.0
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
    return history._replace(
        formal=np.hstack([history.formal, np.sqrt(formal[:, k, k])]),
        true_sigma=np.hstack([history.true_sigma, np.sqrt(np.maximum(0.0, true[:, k, k]))]),
        mean=np.hstack([history.mean, mean]),
        budget=np.concatenate([history.budget, budget], axis=2),
        formal_cov=_bordered(history.formal_cov, formal),
        true_cov=_bordered(history.true_cov, true),
    )


def _bordered(inner: Floats, outer: Floats) -> Floats:
    """Return block-diagonal matrices (n_hist, n + k, n + k)."""
    n, k = inner.shape[1], outer.shape[1]
    full = np.zeros((len(inner), n + k, n + k))
    full[:, :n, :n], full[:, n:, n:] = inner, outer
    return full
