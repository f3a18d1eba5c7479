"""Joint states after the estimation error: error of the receiver's solution, and clones of earlier states.

The joint vector is [e, s, k]: estimation error e, error s of the receiver's solution (see
`solution.SolutionErrorModel`), and clones k. For each delayed measurement, a clone has the navigation error at its
time of validity, and an earlier velocity error. Copies and combinations at an epoch are linear, so they apply to every
source separately, forwards and backwards.
"""

from lvnav_trade.filter.policies.delay import ring_index
from lvnav_trade.kernels.covariance import enter
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group, group_view, number_like
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
        total = number_like(y[0], 0.0)
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
            total = number_like(P[0, 0], 0.0)
            for k in range(m):
                total += A[i, k] * P[first + k, j]
            work[i] = total
        for i in range(m):
            P[first + i, j] = work[i]
    for i in range(n):
        _multiply_states(P[i], work, A, first)


@jit
def advance_solution(joint, scratch, chain, components, epoch):
    """Propagate the receiver-error states to an epoch, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    scratch, components : Scratch, Components
    chain : SolutionErrorModel of a solution, or SuccessiveErrors
    epoch : index
    """
    # s+ = A s + W w + B c + d: deterministic part d, white noise by source, correlated errors by component
    A = chain.transition[epoch]
    W = chain.noise_input[epoch]
    first = components.solution
    m = chain.transition.shape[1]
    for g in range(components.n_slot.shape[0]):
        work = group_view(scratch.y)
        group_covariance = group(joint.sources, g)
        _multiply_covariance(group_covariance, work, A, first)
        cross_covariances = group(joint.cross, g)
        for k in range(components.n_slot[g]):
            if components.has_cross[g, k]:
                _multiply_states(cross_covariances[k], work, A, first)
    _multiply_states(joint.mean, scratch.receiver, A, first)
    for i in range(m):
        joint.mean[first + i] += chain.deterministic_error[epoch, i]
    for q in range(chain.noise_type.shape[0]):
        source = components.solution_source[q]
        g = components.group[source]
        lane = components.lane[source]
        variance = chain.variance[epoch, q]
        P = joint.sources[g, ..., lane]
        for i in range(m):
            for j in range(m):
                covariance = W[i, q] * variance * W[j, q]
                P[first + i, first + j] += covariance
    for c in range(components.first_correlated, components.source.shape[0]):
        source = components.source[c]
        k = components.slot[c]
        g = components.group[source]
        lane = components.lane[source]
        P = joint.sources[g, ..., lane]
        y = joint.cross[g, ..., lane]
        variance = joint.variance[g, k, 0, lane]
        number = c - components.first_correlated
        partials = chain.correlated_input[epoch, :, number]
        enter(P, y[k], variance, partials, first)


@jit
def solution_adjoint(backward_pass, work, chain, components, epoch, time_bin):
    """Propagate the adjoint backwards through `advance_solution`, and add the contribution of its noise.

    Parameters
    ----------
    backward_pass : BackwardPass, updated in place
    work : scratch
    chain : SolutionErrorModel of a solution, or SuccessiveErrors
    components : Components
    epoch : index
    time_bin : bin of the contribution
    """
    A = chain.transition[epoch]
    W = chain.noise_input[epoch]
    first = components.solution
    m = chain.transition.shape[1]
    for metric in range(backward_pass.e.shape[0]):
        y = backward_pass.e[metric]
        for q in range(chain.noise_type.shape[0]):
            source = components.solution_source[q]
            variance = chain.variance[epoch, q]
            sensitivity = 0.0  # lambda' w of the noise, its effect on the metric
            for i in range(m):
                sensitivity += y[first + i] * W[i, q]
            backward_pass.contribution[metric, source, time_bin] += sensitivity * sensitivity * variance
        for c in range(chain.correlated_input.shape[2]):
            component = components.first_correlated + c
            for i in range(m):
                backward_pass.c[metric, component] += y[first + i] * chain.correlated_input[epoch, i, c]
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
def clone_states(joint, components, clone, first, n):
    """Copy states of the joint vector, in every source and in the mean.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    components : Components
    clone : first state that is set
    first, n : first state that is copied, number of states
    """
    for g in range(components.n_slot.shape[0]):
        _copy_covariance(group(joint.sources, g), clone, first, n)
        cross_covariances = group(joint.cross, g)
        for k in range(components.n_slot[g]):
            if components.has_cross[g, k]:
                _copy_vector(cross_covariances[k], clone, first, n)
    _copy_vector(joint.mean, clone, first, n)


@jit
def clone_error(joint, components, delays, window):
    """Clone the navigation error at the end of a window, as `filter.policies.delay.store_state` stores the state.

    The error by motion within a tick is neglected; it is below a millimetre.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    components : Components
    delays : DelayProcessing, or None
    window : index
    """
    if delays is not None:
        for line in range(delays.n_ring.shape[0]):
            early_epochs = delays.velocity_epochs[line, window]
            valid_epochs = delays.state_epochs[line, window]
            for epoch in range(early_epochs[0], early_epochs[1]):
                clone = components.clone + N_CLONE * ring_index(delays, line, epoch)
                clone_states(joint, components, clone + N_NAV, VEL, 3)
            for epoch in range(valid_epochs[0], valid_epochs[1]):
                clone = components.clone + N_CLONE * ring_index(delays, line, epoch)
                clone_states(joint, components, clone, 0, N_NAV)


@jit
def _delay_line_adjoint(y, components, delays, line, window):
    """Add the adjoint of the clones of a line to that of the states that they copy, and reset it.

    Parameters
    ----------
    y : (n,) adjoint of a metric, updated in place
    components, delays : Components, DelayProcessing
    line : delay line, of the receiver or of a sensor
    window : index
    """
    early_epochs = delays.velocity_epochs[line, window]
    valid_epochs = delays.state_epochs[line, window]
    for epoch in range(valid_epochs[0], valid_epochs[1]):
        clone = components.clone + N_CLONE * ring_index(delays, line, epoch)
        for i in range(N_NAV):
            y[i] += y[clone + i]
            y[clone + i] = 0.0
    for epoch in range(early_epochs[0], early_epochs[1]):
        clone = components.clone + N_CLONE * ring_index(delays, line, epoch)
        velocity_clone = clone + N_NAV
        for i in range(3):
            y[VEL + i] += y[velocity_clone + i]
            y[velocity_clone + i] = 0.0


@jit
def clone_adjoint(backward_pass, components, delays, window):
    """Propagate the adjoint backwards through `clone_error`."""
    if delays is not None:
        for m in range(backward_pass.e.shape[0]):
            for line in range(delays.n_ring.shape[0]):
                _delay_line_adjoint(backward_pass.e[m], components, delays, line, window)


@jit
def complete_rows(H, delays, epoch):
    """Set the Jacobian entries of a solution for its own error, and for the clones of an extrapolation.

    The innovation depends on the error of the solution with -1. An extrapolation over the delay d with the acceleration
    from two velocities, b apart, depends on them with -d in position, and -d / b and d / b in velocity.

    Parameters
    ----------
    H : (n, n_entry) Jacobian rows of the epoch; the last entries of the first six rows are set
    delays : DelayProcessing, or None
    epoch : index
    """
    solution = H.shape[1] - N_SOLUTION_ENTRY
    velocity = solution + 6
    for i in range(6):
        for j in range(6):
            H[i, solution + j] = -1.0 if i == j else 0.0
            H[i, velocity + j] = 0.0
    if delays is not None and delays.is_extrapolated:
        delay = delays.delay[epoch]
        slope = delay / delays.base[epoch]
        for i in range(3):
            H[i, velocity + i] = -delay
            H[3 + i, velocity + i] = -slope
            H[3 + i, velocity + 3 + i] = slope
