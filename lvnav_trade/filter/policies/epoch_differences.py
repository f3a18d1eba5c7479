"""Differences of two epochs: the earlier state is cloned in the covariance, or computed from the present state.

A difference of ranges, z_k - z_(k-1), depends on the state at two epochs. The estimate at the earlier epoch is stored.
Its error is a set of cloned states (stochastic cloning: Roumeliotis and Burdick 2002), so the measurement update has
its usual form. After the updates of an epoch the clones are replaced by the present states: x_clone <- S x.

Without clones, the covariance of the earlier state follows from the present state and the inverse of the transition
matrix in between (Wendel and Trommer 2004):

    x_(k-1) = Phi^-1 (x_k - w),   Cov(x_k, x_(k-1)) = (P_k - Q) Phi^-T,   P_(k-1) = Phi^-1 (P_k - Q) Phi^-T

The process noise w has covariance Q and is correlated with the measurement. Both filters are identical except for
rounding, as long as no measurement is processed between the two epochs.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.policies.delay import ERROR, place_of
from lvnav_trade.kernels.covariance import add_turned, apply_phi, inflate, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, zeros_of
from lvnav_trade.kernels.transition import ATT, POS
from lvnav_trade.quantities.line_of_sight import antenna
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.sensors.jacobian_row import D_ATT, D_CLOCK, D_EXTRA, D_POS, H_ATT, H_CLOCK, H_POS, N_ENTRY
from lvnav_trade.sensors.receiver_observables import Channels


class DifferenceProcessing(NamedTuple):
    """Processing of the further satellite observables: carrier phase and differences of two epochs.

    difference : (n_kind,). Whether the observable is a difference of two epochs.
    present : (n_epoch, n_receiver). Whether the channel has a measurement.
    previous_entry : First Jacobian entry of the earlier epoch.
    renewed : (n_epoch, n_extra) SI squared. Variance to which an extra state is reset at the epoch; -1: no reset.
    cloned : (n_clone,). States that have a clone.
    clone : First clone in the state vector.
    back : Whether the earlier state is computed from the present state by the inverse transition.
    """

    difference: Bools
    present: Bools
    previous_entry: int
    renewed: Floats
    cloned: Ints
    clone: int
    back: bool


class PreviousEpoch(NamedTuple):
    """Estimate at the previous epoch, and the transition since then.

    The transition is empty unless the earlier state is computed from the present state.

    antenna : (n_antenna, 21). Antenna states, see `line_of_sight.antenna`.
    clock : (1,) m. Clock bias.
    extra : (n_extra,). Extra states.
    phi : (n_state, n_state). Transition matrix since the epoch, transposed: each row is a column of it.
    noise : (n_state, n_state). Covariance of the process noise since the epoch.
    lu : (n_state, n_state). LU factors of the transition matrix.
    growth : (1,). Factor on standard deviations by fading memory since the epoch.
    """

    antenna: Floats
    clock: Floats
    extra: Floats
    phi: Floats
    noise: Floats
    lu: Floats
    growth: Floats


def new_previous_epoch(
    delayed: DifferenceProcessing, n_antenna: int, n_extra: int, n_state: int, lanes: int = 0
) -> PreviousEpoch:
    """Return the arrays of a filter's earlier epoch: one run, or `lanes` runs on the last axis."""
    n = n_state if delayed.back else 1
    shapes = {"antenna": (n_antenna, 21), "clock": (1,), "extra": (max(1, n_extra),), "growth": (1,)}
    return PreviousEpoch(**zeros_of(shapes | dict.fromkeys(("phi", "noise", "lu"), (n, n)), lanes))


def cloned_states(
    layout: StateLayout, channels: Channels, differences: tuple[str, ...], has_lever: bool
) -> tuple[int, ...]:
    """Return the states that the earlier range of a difference depends on; these are cloned.

    Parameters
    ----------
    layout, channels
        States and measurement channels of the filter.
    differences
        Names of the measurements that are differences of two epochs.
    has_lever
        Whether an antenna is away from the IMU, so that attitude enters.
    """
    if not differences:
        return ()
    difference_channels = np.r_[tuple(channels.of(name) for name in differences)]
    entering = [e for e in layout.extras if np.any(e.member[difference_channels] >= 0)]
    navigation = [*range(POS, POS + 3), *(range(ATT, ATT + 3) if has_lever else ()), layout.clock]
    return (*navigation, *(e.offset + i for e in entering for i in range(len(e.labels))))


def earlier_entries(layout: StateLayout, present: list[tuple[int, int]], first: int) -> list[tuple[int, int]]:
    """Return the pairs (Jacobian entry, clone) of the earlier epoch of a difference.

    present: the pairs (entry, state) of the later epoch; first: first entry of the earlier epoch.
    """
    moved = {**{H_POS + i: D_POS + i for i in range(3)}, **{H_ATT + i: D_ATT + i for i in range(3)}, H_CLOCK: D_CLOCK}
    return [
        (
            first + (moved[entry] if entry < N_ENTRY else D_EXTRA + entry - N_ENTRY),
            layout.clone + layout.cloned.index(state),
        )
        for entry, state in present
    ]


@jit
def is_present(delayed, model, epoch, channel):
    """Return whether the filter processes a receiver channel at an epoch (DifferenceProcessing, or None)."""
    if delayed is None:
        return model.measured[channel]
    return model.measured[channel] and delayed.present[epoch, channel]


@jit
def subtract_extra(work, previous_epoch, delayed, model, signals, epoch, row, channel):
    """Set the Jacobian entries of extra states at the earlier epoch of a difference.

    Returns the contribution of their estimates, which is subtracted from the prediction.

    Parameters
    ----------
    work : arrays of the run
    previous_epoch, delayed : PreviousEpoch, DifferenceProcessing
    model, signals : FilterModel, Signals
    epoch, row, channel : indices
    """
    h = work.H[row]
    total = like(work.x[0], 0.0)
    for f in range(model.extra_member.shape[0]):
        e = model.extra_member[f, channel]
        if e >= 0:
            partial = like(work.x[0], signals.partial[f, epoch - 1, channel])
            h[delayed.previous_entry + D_EXTRA + f] = -partial
            total = total + partial * previous_epoch.extra[e]
    return total


@jit
def _begin_anew(P, at, variance):
    """Reset a state in the covariance P to a variance, uncorrelated with all other states."""
    for i in range(P.shape[0]):
        P[at, i], P[i, at] = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
    P[at, at] = like(P[0, 0], variance)


@jit
def renew(P, x, extra, delayed, model, epoch):
    """Reset extra states at an epoch: the noise of a new measurement, the ambiguity of a newly acquired carrier.

    Parameters
    ----------
    P, x : (n, n) covariance and (n,) error state, updated in place
    extra : (n_extra,) estimates, updated in place
    delayed : DifferenceProcessing, or None
    """
    if delayed is not None:
        for e in range(delayed.renewed.shape[1]):
            if delayed.renewed[epoch, e] >= 0.0:
                at = model.extra_offset[e]
                _begin_anew(P, at, delayed.renewed[epoch, e])
                x[at], extra[e] = like(x[0], 0.0), like(x[0], 0.0)


@jit
def clone(P, delayed):
    """Replace the clones in the covariance P (n, n) by copies of the present states: P <- S P S'."""
    n = P.shape[0]
    for c in range(delayed.cloned.shape[0]):
        for j in range(n):
            P[delayed.clone + c, j] = P[delayed.cloned[c], j]
    for c in range(delayed.cloned.shape[0]):
        for i in range(n):
            P[i, delayed.clone + c] = P[i, delayed.cloned[c]]


@inlined
def accumulate_transition(previous_epoch, delayed, blocks, sums, model, length, injection):
    """Accumulate transition matrix and process noise since the previous epoch over one window.

    Only a filter that computes the earlier state from the present state needs them.

    Parameters
    ----------
    previous_epoch, delayed : PreviousEpoch, and DifferenceProcessing or None
    blocks : (n_block, 9) blocks of the transition over the window
    sums : (18,) integrals of the strapdown over the window
    model : FilterModel
    length : index of the window length
    injection : change of operating region at the end of the window, -1 none
    """
    if delayed is not None and delayed.back:
        seconds, n, factor = model.seconds[length], previous_epoch.phi.shape[0], model.inflation[length]
        if factor != 1.0:
            inflate(previous_epoch.noise, factor, model.n_estimated)
            for j in range(n):
                for i in range(model.n_estimated):
                    previous_epoch.phi[j, i] = previous_epoch.phi[j, i] * factor
            previous_epoch.growth[0] = previous_epoch.growth[0] * factor
        # phi is transposed, so each of its rows is a column that the transition of the window multiplies
        for j in range(n):
            apply_phi(
                previous_epoch.phi[j],
                blocks,
                model.block_rows,
                model.block_columns,
                model.decay[length],
                model.clock,
                seconds,
            )
        add_turned(previous_epoch.noise, model.uneven, sums, seconds)
        predict(
            previous_epoch.noise,
            blocks,
            model.block_rows,
            model.block_columns,
            model.decay[length],
            model.noise[length],
            model.clock,
            seconds,
        )
        add_turned(previous_epoch.noise, model.uneven, sums, seconds)
        if injection >= 0:
            for i in range(n):
                previous_epoch.noise[i, i] = previous_epoch.noise[i, i] + model.injected[injection, i]


@jit
def begin_transition(previous_epoch, delayed):
    """Reset the accumulated transition to the identity and its noise to zero."""
    if delayed is not None and delayed.back:
        n = previous_epoch.phi.shape[0]
        previous_epoch.growth[0] = like(previous_epoch.clock[0], 1.0)
        for i in range(n):
            for j in range(n):
                previous_epoch.phi[i, j] = like(previous_epoch.clock[0], 1.0 if i == j else 0.0)
                previous_epoch.noise[i, j] = like(previous_epoch.clock[0], 0.0)


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
def recover_previous_epoch(P, previous_epoch, delayed):
    """Set the clones in the covariance P (n, n) to the earlier state, computed from the present state.

    `previous_epoch.noise` becomes (P - Q) Phi^-T. The rows and columns of the clones themselves are cleared first.
    With fading memory the computed covariance is inflated by `growth`, as that of a stored clone would be.
    """
    if delayed is not None and delayed.back:
        growth = previous_epoch.growth[0]
        n, n_clone, first = P.shape[0], delayed.cloned.shape[0], delayed.clone
        _factorise(previous_epoch.lu, previous_epoch.phi)
        back = previous_epoch.noise  # element (i, j): covariance of the present state i with the earlier state j
        for i in range(n):
            for j in range(n):
                back[i, j] = P[i, j] - back[i, j]
        for c in range(n_clone):  # the clones of the epoch before have no information on this one
            for j in range(n):
                back[first + c, j], back[j, first + c] = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
        for i in range(n):
            _solve(previous_epoch.lu, back[i])
        for c in range(n_clone):
            for i in range(n):
                if not (first <= i and i < first + n_clone):
                    P[i, first + c] = growth * back[i, delayed.cloned[c]]
                    P[first + c, i] = growth * back[i, delayed.cloned[c]]
        # covariance of earlier states with each other: Phi^-1 once more, from the left
        for c in range(n_clone):
            column = previous_epoch.phi[c]
            for i in range(n):
                column[i] = back[i, delayed.cloned[c]]
            _solve(previous_epoch.lu, column)
            for d in range(n_clone):
                P[first + d, first + c] = growth * growth * column[delayed.cloned[d]]


@jit
def correct_previous_epoch(x, previous_epoch, delayed, model):
    """Correct the stored estimate of the earlier epoch by the clones in the error state x (n,).

    Needed if the error state is fed back between scalar measurements of the same epoch.
    """
    if delayed is not None:
        for c in range(delayed.cloned.shape[0]):
            state, value = delayed.cloned[c], x[delayed.clone + c]
            for a in range(previous_epoch.antenna.shape[0]):
                at = previous_epoch.antenna[a]
                if POS <= state and state < POS + 3:
                    at[state - POS] = at[state - POS] + value
                elif state < ATT + 3:  # an attitude error about one axis rotates the lever arm: x cross arm
                    second, third = (state - ATT + 1) % 3, (state - ATT + 2) % 3
                    up, down = value * at[6 + second], value * at[6 + third]
                    at[third], at[6 + third] = at[third] + up, at[6 + third] + up
                    at[second], at[6 + second] = at[second] - down, at[6 + second] - down
            if state == model.clock:
                previous_epoch.clock[0] = previous_epoch.clock[0] + value
            for e in range(model.extra_offset.shape[0]):
                if model.extra_offset[e] == state:
                    previous_epoch.extra[e] = previous_epoch.extra[e] + value


@inlined
def store_estimate(work, previous_epoch, state_history, late, delayed, model, epoch):
    """Store the estimate at the end of an epoch, for the differences of the next epoch.

    Parameters
    ----------
    work : arrays of the run
    previous_epoch : PreviousEpoch, updated in place
    state_history, late : stored states, and DelayProcessing of a delayed receiver, whose estimate is that of the time
        of validity; or None
    delayed, model : DifferenceProcessing, or None; FilterModel
    epoch : index
    """
    if delayed is not None:
        for a in range(model.lever_arms.shape[0]):
            if late is not None and late.receiver >= 0:
                antenna(
                    previous_epoch.antenna[a],
                    state_history[place_of(late, late.receiver, epoch)],
                    work.rate,
                    model.lever_arms[a],
                    0.0,
                )
            else:
                antenna(previous_epoch.antenna[a], work.nav, work.rate, model.lever_arms[a], 0.0)
        previous_epoch.clock[0] = work.clock_hat[0]
        for e in range(work.extra.shape[0]):
            previous_epoch.extra[e] = work.extra[e]


@inlined
def clone_formal(P, previous_epoch, delayed):
    """Make the present epoch the earlier one in the covariance P (n, n) of the filter.

    The present states are cloned, or the accumulation of the transition starts again.
    """
    if delayed is not None:
        if not delayed.back:
            clone(P, delayed)
        begin_transition(previous_epoch, delayed)


@inlined
def clone_open_loop(x, state_history, open_loop, late, delayed, epoch):
    """Set the clones in the error state x (n,) of an open loop to the states at the end of an epoch."""
    if delayed is not None and open_loop is not None:
        for c in range(delayed.cloned.shape[0]):
            state = delayed.cloned[c]
            x[delayed.clone + c] = x[state]
            if late is not None and late.receiver >= 0 and state < 9:
                x[delayed.clone + c] = state_history[place_of(late, late.receiver, epoch), ERROR + state]
