"""Earlier state of a difference of two epochs from the present state, by the inverse of the transition in between.

With the transition matrix Phi and the process noise w, of covariance Q, since the earlier epoch (Wendel and Trommer
2004),

    x_(k-1) = Phi^-1 (x_k - w),   Cov(x_k, x_(k-1)) = (P_k - Q) Phi^-T,   P_(k-1) = Phi^-1 (P_k - Q) Phi^-T.

The process noise is correlated with the measurement. The result is that of clones except for rounding, as long as no
measurement is processed between the two epochs. The arrays are those of `epoch_differences.PreviousEpoch`.
"""

from lvnav_trade.kernels.covariance import add_axis_noise, apply_phi, inflate, predict
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like


@jit
def _inflate_transition(previous_epoch, model, factor):
    """Apply the fading memory of a window to the accumulated transition, its noise and the factor `growth`."""
    inflate(previous_epoch.noise, factor, model.n_estimated)
    for j in range(previous_epoch.phi.shape[0]):
        for i in range(model.n_estimated):
            previous_epoch.phi[j, i] = previous_epoch.phi[j, i] * factor
    previous_epoch.growth[0] = previous_epoch.growth[0] * factor


@inline_jit
def accumulate_transition(previous_epoch, differences, blocks, sums, model, length_index, injection):
    """Accumulate transition matrix and process noise since the previous epoch over one window.

    Only a filter that computes the earlier state from the present state needs them.

    Parameters
    ----------
    previous_epoch, differences : PreviousEpoch, and DifferenceProcessing or None
    blocks : (n_block, 9) blocks of the transition over the window
    sums : (18,) integrals of the strapdown over the window
    model : FilterModel
    length_index : index of the window length
    injection : change of operating region at the end of the window, -1 none
    """
    if differences is not None and differences.is_back_propagated:
        seconds = model.seconds[length_index]
        n = previous_epoch.phi.shape[0]
        factor = model.inflation[length_index]
        if factor != 1.0:
            _inflate_transition(previous_epoch, model, factor)
        # phi is transposed, so each of its rows is a column that the transition of the window multiplies
        for j in range(n):
            apply_phi(
                previous_epoch.phi[j],
                blocks,
                model.block_rows,
                model.block_columns,
                model.decay[length_index],
                model.clock,
                seconds,
            )
        add_axis_noise(previous_epoch.noise, model.excess_density, sums, seconds)
        predict(
            previous_epoch.noise,
            blocks,
            model.block_rows,
            model.block_columns,
            model.decay[length_index],
            model.noise[length_index],
            model.clock,
            seconds,
        )
        add_axis_noise(previous_epoch.noise, model.excess_density, sums, seconds)
        if injection >= 0:
            for i in range(n):
                previous_epoch.noise[i, i] = previous_epoch.noise[i, i] + model.injected_variance[injection, i]


@jit
def begin_transition(previous_epoch, differences):
    """Reset the accumulated transition to the identity and its noise to zero."""
    if differences is not None and differences.is_back_propagated:
        n = previous_epoch.phi.shape[0]
        previous_epoch.growth[0] = number_like(previous_epoch.clock[0], 1.0)
        for i in range(n):
            for j in range(n):
                previous_epoch.phi[i, j] = number_like(previous_epoch.clock[0], 1.0 if i == j else 0.0)
                previous_epoch.noise[i, j] = number_like(previous_epoch.clock[0], 0.0)


@jit
def _factorise(lu, phi):
    """Set lu (n, n) to the factors L (unit diagonal) and U of the transition, whose columns are the rows of phi.

    No pivoting: over some seconds a transition matrix has ones on its diagonal and small elements on one side of it.
    """
    n = lu.shape[0]
    for i in range(n):
        for j in range(n):
            lu[i, j] = phi[j, i]
    for k in range(n):
        for i in range(k + 1, n):
            factor = lu[i, k] / lu[k, k]
            lu[i, k] = factor
            for j in range(k + 1, n):
                lu[i, j] = lu[i, j] - factor * lu[k, j]


@jit
def _solve(lu, y):
    """Replace y (n,) by the solution of L U x = y."""
    n = lu.shape[0]
    for i in range(n):
        for k in range(i):
            y[i] = y[i] - lu[i, k] * y[k]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            y[i] = y[i] - lu[i, k] * y[k]
        y[i] = y[i] / lu[i, i]


@jit
def _fill_cross_covariance(P, previous_epoch, differences):
    """Set `previous_epoch.noise` to (P - Q) Phi^-T, the covariance of the present with the earlier state."""
    n = P.shape[0]
    first = differences.clone
    cross = previous_epoch.noise
    for i in range(n):
        for j in range(n):
            cross[i, j] = P[i, j] - cross[i, j]
    # the clones of the epoch before have no information on this one
    for c in range(differences.cloned_states.shape[0]):
        for j in range(n):
            cross[first + c, j] = number_like(P[0, 0], 0.0)
            cross[j, first + c] = number_like(P[0, 0], 0.0)
    _factorise(previous_epoch.lu, previous_epoch.phi)
    for i in range(n):
        _solve(previous_epoch.lu, cross[i])


@jit
def recover_previous_epoch(P, previous_epoch, differences):
    """Set the clones in the covariance P (n, n) to the earlier state, computed from the present state.

    `previous_epoch.noise` becomes (P - Q) Phi^-T. The rows and columns of the clones themselves are cleared first.
    With fading memory the computed covariance is inflated by `growth`, as that of a stored clone would be.
    """
    if differences is not None and differences.is_back_propagated:
        growth = previous_epoch.growth[0]
        n = P.shape[0]
        n_clone = differences.cloned_states.shape[0]
        first = differences.clone
        _fill_cross_covariance(P, previous_epoch, differences)
        cross = previous_epoch.noise  # element (i, j): covariance of the present state i with the earlier state j
        for c in range(n_clone):
            for i in range(n):
                is_clone = first <= i and i < first + n_clone
                if not is_clone:
                    covariance = growth * cross[i, differences.cloned_states[c]]
                    P[i, first + c] = covariance
                    P[first + c, i] = covariance
        # covariance of earlier states with each other: Phi^-1 once more, from the left
        for c in range(n_clone):
            column = previous_epoch.phi[c]
            for i in range(n):
                column[i] = cross[i, differences.cloned_states[c]]
            _solve(previous_epoch.lu, column)
            for d in range(n_clone):
                earlier_state = differences.cloned_states[d]
                P[first + d, first + c] = growth * growth * column[earlier_state]
