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
def _multiply_states(y, work, A, first):
    """Replace m states of a vector by A times them.

    Parameters
    ----------
    y : (n,) joint vector, updated in place
    work : (m,) scratch
    A : (m, m)
    first : first of the states
    """
    m = A.shape[0]
    for i in range(m):
        total = like(y[0], 0.0)
        for j in range(m):
            total += A[i, j] * y[first + j]
        work[i] = total
    for i in range(m):
        y[first + i] = work[i]


@jit
def _multiply_covariance(P, work, A, first):
    """Replace a covariance by that of states of which m are multiplied by A: rows, then columns.

    Parameters
    ----------
    P : (n, n) joint covariance, updated in place
    work : (m,) scratch
    A : (m, m)
    first : first of the m states
    """
    n = P.shape[0]
    m = A.shape[0]
    for j in range(n):
        for i in range(m):
            total = like(P[0, 0], 0.0)
            for k in range(m):
                total += A[i, k] * P[first + k, j]
            work[i] = total
        for i in range(m):
            P[first + i, j] = work[i]
    for i in range(n):
        _multiply_states(P[i], work, A, first)


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
    # s+ = A s + W w + B c + d: deterministic part d, white noise by source, correlated errors by component
    A = chain.move[epoch]
    W = chain.white[epoch]
    first = true.solution
    m = chain.move.shape[1]
    for g in range(true.n_slot.shape[0]):
        work = whole(scratch.y)
        group_covariance = group(joint.sources, g)
        _multiply_covariance(group_covariance, work, A, first)
        cross_covariances = group(joint.cross, g)
        for k in range(true.n_slot[g]):
            if true.has_cross[g, k]:
                _multiply_states(cross_covariances[k], work, A, first)
    _multiply_states(joint.mean, scratch.receiver, A, first)
    for i in range(m):
        joint.mean[first + i] += chain.push[epoch, i]
    for q in range(chain.kind.shape[0]):
        source = true.solution_source[q]
        g = true.group[source]
        lane = true.lane[source]
        variance = chain.variance[epoch, q]
        P = joint.sources[g, ..., lane]
        for i in range(m):
            for j in range(m):
                covariance = W[i, q] * variance * W[j, q]
                P[first + i, first + j] += covariance
    for c in range(true.first_shared, true.source.shape[0]):
        source = true.source[c]
        k = true.slot[c]
        g = true.group[source]
        lane = true.lane[source]
        P = joint.sources[g, ..., lane]
        y = joint.cross[g, ..., lane]
        variance = joint.variance[g, k, 0, lane]
        number = c - true.first_shared
        partials = chain.shared[epoch, :, number]
        enter(P, y[k], variance, partials, first)


@jit
def solution_back(back, work, chain, true, epoch, time_bin):
    """Propagate the adjoint backwards through `advance_solution`, and add the contribution of its noise.

    Parameters
    ----------
    back : BackwardPass, updated in place
    work : scratch
    chain : SolutionErrorModel of a solution, or SuccessiveErrors
    true : Components
    epoch : index
    time_bin : bin of the contribution
    """
    A = chain.move[epoch]
    white = chain.white[epoch]
    first = true.solution
    m = chain.move.shape[1]
    for metric in range(back.e.shape[0]):
        y = back.e[metric]
        for q in range(chain.kind.shape[0]):
            source = true.solution_source[q]
            variance = chain.variance[epoch, q]
            through = 0.0  # lambda' w of the noise, its effect on the metric
            for i in range(m):
                through += y[first + i] * white[i, q]
            back.contribution[metric, source, time_bin] += through * through * variance
        for c in range(chain.shared.shape[2]):
            component = true.first_shared + c
            for i in range(m):
                back.c[metric, component] += y[first + i] * chain.shared[epoch, i, c]
        _multiply_states(y, work, A.T, first)


@jit
def _copy_vector(y, clone, first, n):
    for i in range(n):
        y[clone + i] = y[first + i]


@jit
def _copy_covariance(P, clone, first, n):
    for j in range(P.shape[0]):
        for i in range(n):
            P[clone + i, j] = P[first + i, j]
    for i in range(P.shape[0]):
        _copy_vector(P[i], clone, first, n)


@jit
def clone_states(joint, true, clone, first, n):
    """Copy states of the joint vector, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    true : Components
    clone : first state that is set
    first, n : first state that is copied, number of states
    """
    for g in range(true.n_slot.shape[0]):
        _copy_covariance(group(joint.sources, g), clone, first, n)
        cross_covariances = group(joint.cross, g)
        for k in range(true.n_slot[g]):
            if true.has_cross[g, k]:
                _copy_vector(cross_covariances[k], clone, first, n)
    _copy_vector(joint.mean, clone, first, n)


@jit
def clone_error(joint, true, late, window):
    """Clone the navigation error at the end of a window, as `filter.policies.delay.keep` stores the state.

    The error by motion within a tick is neglected; it is below a millimetre.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    true : Components
    late : DelayProcessing, or None
    window : index
    """
    if late is not None:
        for line in range(late.n_ring.shape[0]):
            early = late.early[line, window]
            valid = late.valid[line, window]
            for epoch in range(early[0], early[1]):
                clone = true.clone + N_CLONE * place_of(late, line, epoch)
                clone_states(joint, true, clone + N_NAV, VEL, 3)
            for epoch in range(valid[0], valid[1]):
                clone = true.clone + N_CLONE * place_of(late, line, epoch)
                clone_states(joint, true, clone, 0, N_NAV)


@jit
def _line_back(y, true, late, line, window):
    """Add the adjoint of the clones of a line to that of the states that they copy, and reset it.

    Parameters
    ----------
    y : (n,) adjoint of a metric, updated in place
    true, late : Components, DelayProcessing
    line : delay line, of the receiver or of a sensor
    window : index
    """
    early = late.early[line, window]
    valid = late.valid[line, window]
    for epoch in range(valid[0], valid[1]):
        clone = true.clone + N_CLONE * place_of(late, line, epoch)
        for i in range(N_NAV):
            y[i] += y[clone + i]
            y[clone + i] = 0.0
    for epoch in range(early[0], early[1]):
        clone = true.clone + N_CLONE * place_of(late, line, epoch)
        velocity_clone = clone + N_NAV
        for i in range(3):
            y[VEL + i] += y[velocity_clone + i]
            y[velocity_clone + i] = 0.0


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

    Parameters
    ----------
    H : (n, n_entry) Jacobian rows of the epoch; the last entries of the first six rows are set
    late : DelayProcessing, or None
    epoch : index
    """
    solution = H.shape[1] - N_SOLUTION_ENTRY
    velocity = solution + 6
    for i in range(6):
        for j in range(6):
            H[i, solution + j] = -1.0 if i == j else 0.0
            H[i, velocity + j] = 0.0
    if late is not None and late.extrapolated:
        delay = late.delay[epoch]
        slope = delay / late.base[epoch]
        for i in range(3):
            H[i, velocity + i] = -delay
            H[3 + i, velocity + i] = -slope
            H[3 + i, velocity + 3 + i] = slope
