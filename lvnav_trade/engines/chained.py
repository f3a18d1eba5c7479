"""States that the linear covariance carries behind the filter's error: a solution's error, and a state that was kept.

The joint vector is [e, s, k]: e the filter's error, s that of the receiver's solution (see `solution.Chain`), k the
navigation error of the time that late measurements are of, and the velocity error a while before. What is copied or
mixed at an epoch is linear, so every source goes through it by itself, forwards and backwards.
"""

from __future__ import annotations

from lvnav_trade.filters.late import carry_on
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.observables.base import N_ENTRY
from lvnav_trade.receivers.whiten import whiten

# Rows of a solution have entries for its own error, and where it is carried on for the velocities that do it.
CHAINED, CARRIED, N_JUDGED = N_ENTRY, N_ENTRY + 6, N_ENTRY + 12
N_NAV, N_KEPT_STATE = 9, 12


@jit
def _through(y, work, A, at):
    """Replace the states y[at:at + m] by A (m, m) times them."""
    m = A.shape[0]
    for i in range(m):
        total = 0.0
        for j in range(m):
            total += A[i, j] * y[at + j]
        work[i] = total
    for i in range(m):
        y[at + i] = work[i]


@jit
def _move(P, work, A, at):
    """Replace the covariance P by that of the states moved by A from `at` on."""
    for j in range(P.shape[0]):
        _through(P[:, j], work, A, at)
    for i in range(P.shape[0]):
        _through(P[i], work, A, at)


@jit
def _share(P, y, b, variance, at):
    """Let a component c enter the states from `at` on by b (m,): P and y = Cov(e, c) updated."""
    n, m = y.shape[0], b.shape[0]
    for i in range(m):
        if b[i] != 0.0:
            for j in range(n):
                P[at + i, j] += b[i] * y[j]
                P[j, at + i] += b[i] * y[j]
            for j in range(m):
                P[at + i, at + j] += b[i] * variance * b[j]
    for i in range(m):
        y[at + i] += b[i] * variance


@jit
def advance(joint, work, chain, true, epoch):
    """Carry the error of the receiver's solution to an epoch, in every source and in the mean."""
    A, at, m = chain.move[epoch], true.chain, chain.move.shape[1]
    for s in range(joint.sources.shape[0]):
        _move(joint.sources[s], work, A, at)
    for j in range(joint.cross.shape[0]):
        for axis in range(3):
            _through(joint.cross[j, axis], work, A, at)
    for c in range(joint.shared_cross.shape[0]):
        _through(joint.shared_cross[c], work, A, at)
    _through(joint.mean, work, A, at)
    for i in range(m):
        joint.mean[at + i] += chain.push[epoch, i]
    for q in range(chain.kind.shape[0]):
        P, variance = joint.sources[true.chain_source[q]], chain.variance[epoch, q]
        for i in range(m):
            for j in range(m):
                P[at + i, at + j] += chain.white[epoch, i, q] * variance * chain.white[epoch, j, q]
    for c in range(joint.shared_cross.shape[0]):
        P = joint.sources[true.shared_source[c]]
        _share(P, joint.shared_cross[c], chain.shared[epoch, :, c], joint.shared_variance[c], at)


@jit
def go_back(back, work, chain, true, epoch, time_bin):
    """Go back through `advance`: what its noise put in, and the multipliers before it."""
    A, at, m = chain.move[epoch], true.chain, chain.move.shape[1]
    for metric in range(back.e.shape[0]):
        y = back.e[metric]
        for q in range(chain.kind.shape[0]):
            through = 0.0
            for i in range(m):
                through += y[at + i] * chain.white[epoch, i, q]
            back.contribution[metric, true.chain_source[q], time_bin] += through * through * chain.variance[epoch, q]
        for c in range(back.shared.shape[1]):
            for i in range(m):
                back.shared[metric, c] += y[at + i] * chain.shared[epoch, i, c]
        _through(y, work, A.T, at)


@jit
def _copy(y, to, first, n):
    for i in range(n):
        y[to + i] = y[first + i]


@jit
def _copy_both(P, to, first, n):
    for j in range(P.shape[0]):
        _copy(P[:, j], to, first, n)
    for i in range(P.shape[0]):
        _copy(P[i], to, first, n)


@jit
def keep_states(joint, to, first, n):
    """Copy n states of the joint vector from `first` to `to`, in every source and in the mean."""
    for s in range(joint.sources.shape[0]):
        _copy_both(joint.sources[s], to, first, n)
    for j in range(joint.cross.shape[0]):
        for axis in range(3):
            _copy(joint.cross[j, axis], to, first, n)
    for c in range(joint.shared_cross.shape[0]):
        _copy(joint.shared_cross[c], to, first, n)
    _copy(joint.mean, to, first, n)


@inlined
def keep_error(joint, true, late, window):
    """Keep the error that the unit's own solution has at the end of a window, as `filters.late.keep` keeps the state.

    The error of less than a tick's motion is left out: below a millimetre.
    """
    if late is not None:
        if late.early[window] >= 0:
            keep_states(joint, true.kept + N_NAV, VEL, 3)
        if late.valid[window] >= 0:
            keep_states(joint, true.kept, 0, N_NAV)


@inlined
def unkeep(back, true, late, window):
    """Go back through `keep_error`."""
    if late is not None:
        at = true.kept
        for m in range(back.e.shape[0]):
            y = back.e[m]
            if late.valid[window] >= 0:
                for i in range(N_NAV):
                    y[i] += y[at + i]
                    y[at + i] = 0.0
            if late.early[window] >= 0:
                for i in range(3):
                    y[VEL + i] += y[at + N_NAV + i]
                    y[at + N_NAV + i] = 0.0


@jit
def judged_rows(nominal, formal, chain, late, epoch):
    """Complete the rows of a solution with what of its own error and of kept velocities is in them, and mix them so
    that they are independent with variance one, as the filter does.
    """
    z, H, told = nominal.z, nominal.H, nominal.told
    for i in range(6):
        for j in range(6):
            told[i, j] = chain.told[epoch, i, j]
            H[i, CHAINED + j] = -1.0 if i == j else 0.0
            H[i, CARRIED + j] = 0.0
    if late is not None and late.extrapolated:
        slope = late.delay[epoch] / late.base[epoch]
        for i in range(3):
            H[i, CARRIED + i] = -late.delay[epoch]
            H[3 + i, CARRIED + i], H[3 + i, CARRIED + 3 + i] = -slope, slope
        carry_on(z, told, nominal.past, formal, late, epoch)
    whiten(told, z, H, 6, H.shape[1])


def kept_column(column: int, kept: int, buffered: bool) -> int:
    """Return the state of the joint vector that a filter's state stands for in a row: navigation errors of a buffered
    measurement are the kept ones.
    """
    return kept + column if buffered and column < POS + 3 else column
