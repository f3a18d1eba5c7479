"""Outputs beside the filter's states in linear covariance: errors of IMU samples and of the receiver's solution."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.lincov.workspace import Recorded
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.setup.solution import own_covariance
from lvnav_trade.engines.simulate.sensing import profile_value
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.receivers.base import BIAS, DRIFT, N_STATE, POS, VEL
from lvnav_trade.records import CovHistory, Floats

N_SOLUTION = 8
"""Velocity, position, clock bias and drift of a receiver's solution."""


def sample_outputs(prepared: Prepared, names: list[str], history: CovHistory, out: Recorded) -> CovHistory:
    """Return the history with errors of the IMU's samples, raw and corrected by the estimated bias, behind the states;
    as it is where they are not reported. The covariance between the two is not computed: it stands as zero.
    """
    samples = prepared.options.samples
    if samples is None:
        return history
    imu, noise = prepared.scenario.imu, np.zeros((len(names), N_SAMPLE))
    noise[names.index("gyro random walk"), :3] = imu.gyro.random_walk**2 * imu.rate
    noise[names.index("accelerometer random walk"), 3:] = imu.accel.random_walk**2 * imu.rate
    variance = out.samples + np.tile(noise, 2)
    n_hist = len(history.t)
    mean = np.zeros((n_hist, 2 * N_SAMPLE))
    mean[:, :N_SAMPLE] = mean[:, N_SAMPLE:] = -_profiles(prepared)
    formal = np.tile(samples.raw, (n_hist, 2))
    for i, state in enumerate(samples.bias.tolist()):
        if state >= 0:
            mean[:, N_SAMPLE + i] = -out.mean[:, state]
            formal[:, N_SAMPLE + i] = out.formal[:, state, state] + samples.variance[i]
    return _behind(history, variance, mean, _diagonal(formal), _diagonal(variance.sum(axis=1)))


def _profiles(prepared: Prepared) -> Floats:
    """Return the biases (n_hist, 6) that are the same in every run at the history times."""
    found, unit = np.zeros((prepared.t_hist.size, N_SAMPLE)), prepared.unit
    for profile, sensor in enumerate(unit.profile_sensor.tolist()):
        for axis in range(3):
            found[:, 3 * sensor + axis] += [profile_value(unit, profile, axis, t) for t in prepared.t_hist]
    return found


def solution_outputs_of(prepared: Prepared, history: CovHistory, out: Recorded) -> CovHistory:
    """Return the history with the error of the receiver's last solution behind the rest; as it is where nothing of it
    is reported. The covariance between the two is not computed: it stands as zero.
    """
    report, chain = prepared.options.report, prepared.chain
    if report is None or chain is None:
        return history
    turn = _turn(prepared)
    own = own_covariance(prepared.options.solver, prepared.signals, chain.point)
    for epoch in range(1, len(chain.solved)):
        if not chain.solved[epoch]:
            own[epoch] = own[epoch - 1]
    last = _last_epoch(prepared)
    formal = turn @ np.concatenate([own, np.zeros((1, N_STATE, N_STATE))])[last] @ np.swapaxes(turn, 1, 2)
    by_source = np.einsum("hij,hsjk,hlk->hsil", turn, out.receiver, turn)
    diagonal = range(N_SOLUTION)
    mean = np.einsum("hij,hj->hi", turn, out.receiver_mean)
    return _behind(history, by_source[:, :, diagonal, diagonal], mean, formal, by_source.sum(axis=1))


def _last_epoch(prepared: Prepared) -> np.ndarray:
    """Return the epoch (n_hist,) that was last at each history time; -1, an entry of zeros at the end, before any."""
    schedule = prepared.schedule
    latest = np.maximum.accumulate(schedule.epoch)
    found = np.full(prepared.t_hist.size, -1, dtype=np.int64)
    at = schedule.hist >= 0
    found[schedule.hist[at]] = latest[at]
    return found


def _turn(prepared: Prepared) -> Floats:
    """Return the matrices (n_hist, 8, 11) from the error of a solution, frame i, to what is reported of it."""
    axes = prepared.record.axes
    turn = np.zeros((len(axes), N_SOLUTION, N_STATE))
    turn[:, 0:3, VEL : VEL + 3] = axes
    turn[:, 3:6, POS : POS + 3] = axes
    turn[:, 6, BIAS] = turn[:, 7, DRIFT] = 1.0
    return turn


def _diagonal(variance: Floats) -> Floats:
    """Return diagonal matrices (n, k, k) of variances (n, k)."""
    return np.asarray(variance[:, :, None] * np.eye(variance.shape[1]))


def _behind(history: CovHistory, budget: Floats, mean: Floats, formal: Floats, true: Floats) -> CovHistory:
    """Return the history with further outputs behind: budget (n_hist, n_source, k), mean (n_hist, k), covariances
    (n_hist, k, k).
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
    """Return matrices (n_hist, n + k, n + k) of two on the diagonal."""
    n, k = inner.shape[1], outer.shape[1]
    full = np.zeros((len(inner), n + k, n + k))
    full[:, :n, :n], full[:, n:, n:] = inner, outer
    return full
