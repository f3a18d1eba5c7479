"""Errors of a receiver's own solution beside those of the filter that takes it, in both engines.

The receiver does not know the filter, so its part of a run is flown by itself again, on the same draws and by the same
kernels. At a history time stands the error of the last solution, as of the time that it is of; while there is none the
one before stays, before the first one zero. In frame i, brought to the reporting axes of the history time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.inputs import Work
from lvnav_trade.engines.montecarlo import new_work
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.recorded import values_of
from lvnav_trade.engines.sensing import begin, begin_solver, observe
from lvnav_trade.engines.solution import Chain, own_covariance
from lvnav_trade.engines.truth import source_names, true_model
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.receivers.base import (
    ACC,
    ACCELERATION,
    BIAS,
    DRIFT,
    FIX_DRIFT,
    MISSES,
    N_MEMORY,
    N_STATE,
    POS,
    STARTED,
    VEL,
    FilterModel,
    transition,
)
from lvnav_trade.receivers.cascade import FIX_STATES, design, noises
from lvnav_trade.records import CovHistory, Floats, RunBlock
from lvnav_trade.scenario import reported

Ints = NDArray[np.int64]

N_REPORTED = 8
"""Velocity, position, clock bias and drift."""


class _Flown(NamedTuple):
    """Of one run by epochs: error and own sigma's covariance (n_epoch, 11), (n_epoch, 11, 11); innovation (n_epoch,
    n_channel), normalised, in the order in which the rows are taken.
    """

    error: Floats
    covariance: Floats
    innovation: Floats


def beside_runs(prepared: Prepared, seed: int, block: RunBlock) -> RunBlock:
    """Return a block of runs with errors of the solution after the filter's, and the innovations of the receiver's own
    filter after those of the one that takes it; as it is where nothing of the solution is reported.
    """
    if not reported(prepared.scenario):
        return block
    last, turn = _last_epoch(prepared), _turn(prepared)
    n_run, innovations = len(block.err), [block.innovation]
    error, sigma = np.zeros((n_run, block.t.size, N_REPORTED)), np.zeros((n_run, block.t.size, N_REPORTED))
    own = np.full((n_run, block.t_epoch.size, 2 * len(prepared.sky.names)), np.nan)
    for run in range(n_run):
        flown = _fly(prepared, seed, block.first_run + run)
        error[run] = np.einsum("hij,hj->hi", turn, flown.error[last])
        sigma[run] = _sigmas(turn, flown.covariance[last])
        own[run] = flown.innovation
    if prepared.options.solver.filter is not None:
        innovations.append(own)
    return block._replace(
        err=np.concatenate([block.err, error], axis=2),
        sigma=np.concatenate([block.sigma, sigma], axis=2),
        innovation=np.concatenate(innovations, axis=2),
    )


def _last_epoch(prepared: Prepared) -> Ints:
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
    turn = np.zeros((len(axes), N_REPORTED, N_STATE))
    turn[:, 0:3, VEL : VEL + 3] = axes
    turn[:, 3:6, POS : POS + 3] = axes
    turn[:, 6, BIAS] = turn[:, 7, DRIFT] = 1.0
    return turn


def _sigmas(turn: Floats, covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(0.0, np.einsum("hij,hjk,hik->hi", turn, covariance, turn)))


def _fly(prepared: Prepared, seed: int, run: int) -> _Flown:
    """Fly the receiver of one run; one more epoch of zeros stands at the end."""
    solver, signals, chain = prepared.options.solver, prepared.signals, prepared.chain
    assert chain is not None
    k0, k1 = seed_words(seed)
    work = new_work(prepared, lanes=False)
    work.run[0] = run
    given = np.flatnonzero(signals.shared.given)
    if given.size:
        work.shared[given] = values_of(prepared.recorded, seed, np.array([run], dtype=np.uint64))[:, 0]
    begin(work, prepared.unit, signals, prepared.start, prepared.belief, k0, k1)
    begin_solver(work, solver)
    n_epoch = prepared.t_epoch.size
    flown = _Flown(
        np.zeros((n_epoch + 1, N_STATE)), np.zeros((n_epoch + 1, N_STATE, N_STATE)),
        np.full((n_epoch, 2 * len(prepared.sky.names)), np.nan),
    )  # fmt: skip
    before = np.zeros(N_STATE), np.zeros((N_STATE, N_STATE)), np.zeros(N_MEMORY)
    for epoch in range(n_epoch):
        for kept, now in zip(before, (work.rx.nav, work.rx.P, work.rx.memory), strict=True):
            kept[:] = now
        observe(work, solver, signals, False, epoch, k0, k1)
        if solver.filter is not None and before[2][STARTED] > 0.0:
            _innovate(flown.innovation[epoch], prepared, work, solver.filter, epoch, *before)
        if np.isfinite(work.rx.solution[0]):
            flown.error[epoch], flown.covariance[epoch] = _error(prepared, work, chain.point[epoch])
        elif epoch:
            flown.error[epoch], flown.covariance[epoch] = flown.error[epoch - 1], flown.covariance[epoch - 1]
    return flown


def _error(prepared: Prepared, work: Work, point: Floats) -> tuple[Floats, Floats]:
    """Return error (11,) and own covariance (11, 11) of the solution that the receiver has just handed out."""
    solver, rx = prepared.options.solver, work.rx
    truth, found = np.zeros(N_STATE), np.zeros(N_STATE)
    truth[POS : POS + 3], truth[VEL : VEL + 3] = point[:3], point[3:]
    truth[BIAS], truth[DRIFT] = work.clock
    if solver.filter is not None:
        found[ACC + 3 :] = truth[ACC + 3 :] - rx.nav[ACC + 3 :]
        return found, rx.P.copy()
    found[FIX_STATES] = truth[FIX_STATES] - rx.fix[: FIX_DRIFT + 1]
    P = np.zeros((N_STATE, N_STATE))
    places, speeds = [*range(POS, POS + 3), BIAS], [*range(VEL, VEL + 3), DRIFT]
    P[np.ix_(places, places)] = solver.point.range_variance * rx.inverse
    P[np.ix_(speeds, speeds)] = solver.point.rate_variance * rx.inverse
    return found, P


def _innovate(
    out: Floats, prepared: Prepared, work: Work, model: FilterModel, epoch: int, nav: Floats, P: Floats, memory: Floats
) -> None:
    """Set the normalised innovations of the receiver's filter at an epoch, whose state was nav, P and memory before.

    Rows that are taken one after the other, linearised at one point, have the innovations L^-1 y, where L L' is the
    covariance of all rows together. Where the filter has just begun again there are none.
    """
    signals = prepared.signals
    use = signals.used[epoch, : signals.n_used[epoch]]
    began = memory[MISSES] > 0.0 and work.rx.memory[MISSES] == 0.0 and memory[MISSES] + 1.0 >= model.restart
    if not use.size or began:
        return
    phi = transition(model)
    state = phi @ nav
    satellite, moving = signals.satellite[epoch, use], signals.satellite_velocity[epoch, use]
    line = satellite - state[POS : POS + 3]
    distance = np.linalg.norm(line, axis=1)
    rate = np.sum(line * (moving - state[VEL : VEL + 3]), axis=1) / distance
    rows = design(state[POS : POS + 3], state[VEL : VEL + 3], satellite, moving)
    y = work.ranges[: use.size] - np.stack([distance + state[BIAS], rate + state[DRIFT]], axis=1)
    noise, variance = noises(model, work.rx.memory[ACCELERATION : ACCELERATION + 3], len(rows))
    S = rows @ (phi @ P @ phi.T + noise) @ rows.T + np.diag(variance)
    normalised = np.linalg.solve(np.linalg.cholesky(S), y.ravel())
    out[2 * use], out[2 * use + 1] = normalised[0::2], normalised[1::2]


class _Spread(NamedTuple):
    """Of the solution's error by epochs, the last entry zero: by source (n_epoch + 1, n_source, 11, 11), mean."""

    sources: Floats
    mean: Floats


def beside_covariance(prepared: Prepared, history: CovHistory) -> CovHistory:
    """Return linear covariance with that of the solution's error after the filter's; as it is where nothing of the
    solution is reported. Between the two no covariance is told: it stands as zero.
    """
    if not reported(prepared.scenario):
        return history
    names, solver, chain = source_names(prepared), prepared.options.solver, prepared.chain
    assert chain is not None
    last, turn = _last_epoch(prepared), _turn(prepared)
    spread = _carry(prepared, chain, names)
    own = np.concatenate([own_covariance(solver, prepared.signals, chain.point), np.zeros((1, N_STATE, N_STATE))])
    for epoch in range(1, len(chain.solved)):
        if not chain.solved[epoch]:
            own[epoch] = own[epoch - 1]
    by_source = np.einsum("hij,hsjk,hlk->hsil", turn, spread.sources[last], turn)
    true, formal = by_source.sum(axis=1), turn @ own[last] @ np.swapaxes(turn, 1, 2)
    diagonal = range(N_REPORTED)
    return history._replace(
        formal=np.hstack([history.formal, np.sqrt(formal[:, diagonal, diagonal])]),
        true_sigma=np.hstack([history.true_sigma, np.sqrt(np.maximum(0.0, true[:, diagonal, diagonal]))]),
        mean=np.hstack([history.mean, np.einsum("hij,hj->hi", turn, spread.mean[last])]),
        budget=np.concatenate([history.budget, by_source[:, :, diagonal, diagonal]], axis=2),
        formal_cov=_bordered(history.formal_cov, formal),
        true_cov=_bordered(history.true_cov, true),
    )


def _carry(prepared: Prepared, chain: Chain, names: list[str]) -> _Spread:
    """Carry the covariance of the solution's error over the epochs by source."""
    true, shared, n_epoch = true_model(prepared, names), prepared.signals.shared, len(chain.solved)
    found = _Spread(np.zeros((n_epoch + 1, len(names), N_STATE, N_STATE)), np.zeros((n_epoch + 1, N_STATE)))
    P, mean = np.zeros((len(names), N_STATE, N_STATE)), np.zeros(N_STATE)
    cross, variance = np.zeros((shared.start.size, N_STATE)), shared.start**2
    for epoch in range(n_epoch):
        A, W = chain.move[epoch], chain.white[epoch]
        P, mean = A @ P @ A.T, A @ mean + chain.push[epoch]
        cross, variance = (shared.decay[:, None] * cross) @ A.T, shared.decay**2 * variance + shared.walk**2
        for source in np.unique(true.chain_source):
            part = W[:, true.chain_source == source]
            P[source] += (part * chain.variance[epoch, true.chain_source == source]) @ part.T
        for c, source in enumerate(true.shared_source.tolist()):
            b = chain.shared[epoch, :, c]
            P[source] += np.outer(b, cross[c]) + np.outer(cross[c], b) + variance[c] * np.outer(b, b)
            cross[c] += variance[c] * b
        held = not chain.solved[epoch]
        found.sources[epoch] = found.sources[epoch - 1] if held else P
        found.mean[epoch] = found.mean[epoch - 1] if held else mean
    return found


def _bordered(inner: Floats, outer: Floats) -> Floats:
    """Return matrices (n_hist, n + k, n + k) of two on the diagonal."""
    n, k = inner.shape[1], outer.shape[1]
    full = np.zeros((len(inner), n + k, n + k))
    full[:, :n, :n], full[:, n:, n:] = inner, outer
    return full
