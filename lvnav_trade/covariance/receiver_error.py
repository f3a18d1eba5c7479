"""Joint states after the estimation error: error of the receiver's solution, and clones of earlier states.

The joint vector is [e, s, k]: estimation error e, error s of the receiver's solution (see
`solution.SolutionErrorModel`), and clones k. For each delayed measurement, a clone has the navigation error at its
time of validity, and an earlier velocity error. Copies and combinations at an epoch are linear, so they apply to every
source separately, forwards and backwards.
"""

from lvnav_trade.filter.policies.delay import place_of
from lvnav_trade.kernels.covariance import enter
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, like, whole
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.simulation.epoch.joint import N_CLONE, N_NAV

N_SOLUTION_ENTRY = 12
"""Jacobian entries of a solution after those of the filter: its own error (6), and the velocities of an extrapolation
(6)."""


@jit
def _move_vector(y, work, A, at):
    """Replace the states y[at:at + m] by A (m, m) times them."""
    m = A.shape[0]
    for i in range(m):
        total = like(y[0], 0.0)
        for j in range(m):
            total = total + A[i, j] * y[at + j]
        work[i] = total
    for i in range(m):
        y[at + i] = work[i]


@jit
def _move_covariance(P, work, A, at):
    """Replace the covariance P by that of the states moved by A from `at` on."""
    n, m = P.shape[0], A.shape[0]
    for j in range(n):
        for i in range(m):
            total = like(P[0, 0], 0.0)
            for k in range(m):
                total = total + A[i, k] * P[at + k, j]
            work[i] = total
        for i in range(m):
            P[at + i, j] = work[i]
    for i in range(n):
        _move_vector(P[i], work, A, at)


@jit
def advance_solution(joint, scratch, chain, true, epoch):
    """Propagate the receiver-error states to an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    scratch, true : Scratch, Components
    chain : SolutionErrorModel of a solution, or SuccessiveErrors
    epoch : index
    """
    A, at, m = chain.move[epoch], true.solution, chain.move.shape[1]
    for g in range(true.n_slot.shape[0]):
        work = whole(scratch.y)
        _move_covariance(group(joint.sources, g), work, A, at)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                _move_vector(group(joint.cross, g)[k], work, A, at)
    _move_vector(joint.mean, scratch.receiver, A, at)
    # s+ = A s + W w + B c + d: deterministic part d, white noise by source, correlated errors by component
    for i in range(m):
        joint.mean[at + i] += chain.push[epoch, i]
    for q in range(chain.kind.shape[0]):
        source, variance = true.solution_source[q], chain.variance[epoch, q]
        P = joint.sources[true.group[source], ..., true.lane[source]]
        for i in range(m):
            for j in range(m):
                P[at + i, at + j] += chain.white[epoch, i, q] * variance * chain.white[epoch, j, q]
    for c in range(true.first_shared, true.source.shape[0]):
        source, k = true.source[c], true.slot[c]
        g, lane = true.group[source], true.lane[source]
        P, y = joint.sources[g, ..., lane], joint.cross[g, ..., lane]
        variance = joint.variance[g, k, 0, lane]
        enter(P, y[k], variance, chain.shared[epoch, :, c - true.first_shared], at)


@jit
def solution_back(back, work, chain, true, epoch, time_bin):
    """Propagate the adjoint backwards through `advance_solution`, and add the contribution of its noise."""
    A, at, m = chain.move[epoch], true.solution, chain.move.shape[1]
    for metric in range(back.e.shape[0]):
        y = back.e[metric]
        for q in range(chain.kind.shape[0]):
            through = 0.0
            for i in range(m):
                through += y[at + i] * chain.white[epoch, i, q]
            source = true.solution_source[q]
            back.contribution[metric, source, time_bin] += through * through * chain.variance[epoch, q]
        for c in range(chain.shared.shape[2]):
            for i in range(m):
                back.c[metric, true.first_shared + c] += y[at + i] * chain.shared[epoch, i, c]
        _move_vector(y, work, A.T, at)


@jit
def _copy_vector(y, to, first, n):
    for i in range(n):
        y[to + i] = y[first + i]


@jit
def _copy_covariance(P, to, first, n):
    for j in range(P.shape[0]):
        for i in range(n):
            P[to + i, j] = P[first + i, j]
    for i in range(P.shape[0]):
        _copy_vector(P[i], to, first, n)


@jit
def clone_states(joint, true, to, first, n):
    """Copy n states of the joint vector from `first` to `to`, in every source and in the mean."""
    for g in range(true.n_slot.shape[0]):
        _copy_covariance(group(joint.sources, g), to, first, n)
        for k in range(true.n_slot[g]):
            if true.followed[g, k]:
                _copy_vector(group(joint.cross, g)[k], to, first, n)
    _copy_vector(joint.mean, to, first, n)


@jit
def clone_error(joint, true, late, window):
    """Clone the navigation error at the end of a window, as `filter.policies.delay.keep` stores the state.

    The error by motion within a tick is neglected; it is below a millimetre.
    """
    if late is not None:
        for line in range(late.n_ring.shape[0]):
            for epoch in range(late.early[line, window, 0], late.early[line, window, 1]):
                clone_states(joint, true, true.clone + N_CLONE * place_of(late, line, epoch) + N_NAV, VEL, 3)
            for epoch in range(late.valid[line, window, 0], late.valid[line, window, 1]):
                clone_states(joint, true, true.clone + N_CLONE * place_of(late, line, epoch), 0, N_NAV)


@jit
def _line_back(y, true, late, line, window):
    """Add the adjoint of the clones of a line to that of the states that they copy, and reset it."""
    for epoch in range(late.valid[line, window, 0], late.valid[line, window, 1]):
        at = true.clone + N_CLONE * place_of(late, line, epoch)
        for i in range(N_NAV):
            y[i] += y[at + i]
            y[at + i] = 0.0
    for epoch in range(late.early[line, window, 0], late.early[line, window, 1]):
        at = true.clone + N_CLONE * place_of(late, line, epoch) + N_NAV
        for i in range(3):
            y[VEL + i] += y[at + i]
            y[at + i] = 0.0


@jit
def clone_back(back, true, late, window):
    """Propagate the adjoint backwards through `clone_error`."""
    if late is not None:
        for m in range(back.e.shape[0]):
            for line in range(late.n_ring.shape[0]):
                _line_back(back.e[m], true, late, line, window)


@jit
def complete_rows(H, late, epoch):
    """Set the Jacobian entries of a solution for its own error, and for the clones of an extrapolation.

    The innovation depends on the error of the solution with -1. An extrapolation over the delay d with the acceleration
    from two velocities, b apart, depends on them with -d in position, and -d / b and d / b in velocity.
    """
    solution = H.shape[1] - N_SOLUTION_ENTRY
    velocity = solution + 6
    for i in range(6):
        for j in range(6):
            H[i, solution + j] = -1.0 if i == j else 0.0
            H[i, velocity + j] = 0.0
    if late is not None and late.extrapolated:
        slope = late.delay[epoch] / late.base[epoch]
        for i in range(3):
            H[i, velocity + i] = -late.delay[epoch]
            H[3 + i, velocity + i], H[3 + i, velocity + 3 + i] = -slope, slope
