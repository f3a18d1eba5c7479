"""Differences of two epochs: the earlier state is cloned in the covariance, or computed from the present state.

A difference of ranges, z_k - z_(k-1), depends on the state at two epochs. The estimate at the earlier epoch is stored.
Its error is a set of cloned states (stochastic cloning: Roumeliotis and Burdick 2002), so the measurement update has
its usual form. After the updates of an epoch the clones are replaced by the present states: x_clone <- S x.

Without clones, the covariance of the earlier state is computed from the present state, see `back_propagation.py`.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.policies.back_propagation import begin_transition
from lvnav_trade.filter.policies.delay import ERROR, ring_index
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, zeros_of
from lvnav_trade.kernels.transition import ATT, POS
from lvnav_trade.quantities.line_of_sight import antenna
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.sensors.jacobian_row import D_ATT, D_CLOCK, D_EXTRA, D_POS, H_ATT, H_CLOCK, H_POS, N_ENTRY
from lvnav_trade.sensors.receiver_observables import Channels


class DifferenceProcessing(NamedTuple):
    """Processing of the further satellite observables: carrier phase and differences of two epochs.

    is_difference : (n_observable,). Whether the observable is a difference of two epochs.
    is_present : (n_epoch, n_receiver). Whether the channel has a measurement.
    previous_entry : First Jacobian entry of the earlier epoch.
    reset_variance : (n_epoch, n_extra) SI squared. Variance to which an extra state is reset at the epoch; -1: no
        reset.
    cloned_states : (n_clone,). States that have a clone.
    clone : First clone in the state vector.
    is_back_propagated : Whether the earlier state is computed from the present state by the inverse transition.
    """

    is_difference: Bools
    is_present: Bools
    previous_entry: int
    reset_variance: Floats
    cloned_states: Ints
    clone: int
    is_back_propagated: bool


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
    differences: DifferenceProcessing, n_antenna: int, n_extra: int, n_state: int, lanes: int = 0
) -> PreviousEpoch:
    """Return the arrays of a filter's earlier epoch: one run, or `lanes` runs on the last axis."""
    n = n_state if differences.is_back_propagated else 1
    shapes = {
        "antenna": (n_antenna, 21),
        "clock": (1,),
        "extra": (max(1, n_extra),),
        "phi": (n, n),
        "noise": (n, n),
        "lu": (n, n),
        "growth": (1,),
    }
    return PreviousEpoch(**zeros_of(shapes, lanes))


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
    states = [POS, POS + 1, POS + 2]
    if has_lever:
        states += [ATT, ATT + 1, ATT + 2]
    states.append(layout.clock)
    for block in layout.extras:
        if any(np.any(block.member[channels.observable_slice(name)] >= 0) for name in differences):
            states += range(block.offset, block.offset + len(block.labels))
    return tuple(states)


def earlier_entries(layout: StateLayout, present: list[tuple[int, int]], first: int) -> list[tuple[int, int]]:
    """Return the pairs (Jacobian entry, clone) of the earlier epoch of a difference.

    present: the pairs (entry, state) of the later epoch; first: first entry of the earlier epoch.
    """
    earlier_entry = {H_CLOCK: D_CLOCK}
    for i in range(3):
        earlier_entry[H_POS + i] = D_POS + i
        earlier_entry[H_ATT + i] = D_ATT + i
    pairs = []
    for entry, state in present:
        offset = earlier_entry[entry] if entry < N_ENTRY else D_EXTRA + entry - N_ENTRY
        clone_state = layout.clone + layout.cloned_states.index(state)
        pairs.append((first + offset, clone_state))
    return pairs


@jit
def is_present(differences, model, epoch, channel):
    """Return whether the filter processes a receiver channel at an epoch (DifferenceProcessing, or None)."""
    if differences is None:
        return model.is_processed[channel]
    return model.is_processed[channel] and differences.is_present[epoch, channel]


@jit
def subtract_extra(work, previous_epoch, differences, model, signals, epoch, row, channel):
    """Set the Jacobian entries of extra states at the earlier epoch of a difference.

    Returns the contribution of their estimates, which is subtracted from the prediction.

    Parameters
    ----------
    work : arrays of the run
    previous_epoch, differences : PreviousEpoch, DifferenceProcessing
    model, signals : FilterModel, Signals
    epoch, row, channel : indices
    """
    h = work.H[row]
    total = number_like(work.x[0], 0.0)
    for family in range(model.extra_member.shape[0]):
        state = model.extra_member[family, channel]
        if state >= 0:
            partial = number_like(work.x[0], signals.partial[family, epoch - 1, channel])
            h[differences.previous_entry + D_EXTRA + family] = -partial
            total = total + partial * previous_epoch.extra[state]
    return total


@jit
def _reset_state(P, state, variance):
    """Reset a state in the covariance P to a variance, uncorrelated with all other states."""
    zero = number_like(P[0, 0], 0.0)
    for i in range(P.shape[0]):
        P[state, i] = zero
        P[i, state] = zero
    P[state, state] = number_like(P[0, 0], variance)


@jit
def reset_states(P, x, extra, differences, model, epoch):
    """Reset extra states at an epoch: the noise of a new measurement, the ambiguity of a newly acquired carrier.

    Parameters
    ----------
    P, x : (n, n) covariance and (n,) error state, updated in place
    extra : (n_extra,) estimates, updated in place
    differences : DifferenceProcessing, or None
    """
    if differences is not None:
        for e in range(differences.reset_variance.shape[1]):
            variance = differences.reset_variance[epoch, e]
            if variance >= 0.0:
                state = model.extra_offset[e]
                _reset_state(P, state, variance)
                x[state] = number_like(x[0], 0.0)
                extra[e] = number_like(x[0], 0.0)


@jit
def clone(P, differences):
    """Replace the clones in the covariance P (n, n) by copies of the present states: P <- S P S'."""
    n = P.shape[0]
    for c in range(differences.cloned_states.shape[0]):
        state = differences.cloned_states[c]
        clone_state = differences.clone + c
        for j in range(n):
            P[clone_state, j] = P[state, j]
    for c in range(differences.cloned_states.shape[0]):
        state = differences.cloned_states[c]
        clone_state = differences.clone + c
        for i in range(n):
            P[i, clone_state] = P[i, state]


@jit
def _correct_antenna(antenna_state, state, error):
    """Correct position and lever arm of an antenna by the error of one state, if it is of position or attitude."""
    if POS <= state and state < POS + 3:
        axis = state - POS
        antenna_state[axis] = antenna_state[axis] + error
    elif state < ATT + 3:  # an attitude error about one axis rotates the lever arm: x cross arm
        second = (state - ATT + 1) % 3
        third = (state - ATT + 2) % 3
        second_arm = 6 + second
        third_arm = 6 + third
        third_change = error * antenna_state[second_arm]
        second_change = error * antenna_state[third_arm]
        antenna_state[third] = antenna_state[third] + third_change
        antenna_state[third_arm] = antenna_state[third_arm] + third_change
        antenna_state[second] = antenna_state[second] - second_change
        antenna_state[second_arm] = antenna_state[second_arm] - second_change


@jit
def correct_previous_epoch(x, previous_epoch, differences, model):
    """Correct the stored estimate of the earlier epoch by the clones in the error state x (n,).

    Needed if the error state is fed back between scalar measurements of the same epoch.
    """
    if differences is not None:
        for c in range(differences.cloned_states.shape[0]):
            state = differences.cloned_states[c]
            error = x[differences.clone + c]
            for a in range(previous_epoch.antenna.shape[0]):
                _correct_antenna(previous_epoch.antenna[a], state, error)
            if state == model.clock:
                previous_epoch.clock[0] = previous_epoch.clock[0] + error
            for e in range(model.extra_offset.shape[0]):
                if model.extra_offset[e] == state:
                    previous_epoch.extra[e] = previous_epoch.extra[e] + error


@inline_jit
def store_estimate(work, previous_epoch, state_history, delays, differences, model, epoch):
    """Store the estimate at the end of an epoch, for the differences of the next epoch.

    Parameters
    ----------
    work : arrays of the run
    previous_epoch : PreviousEpoch, updated in place
    state_history, delays : stored states, and DelayProcessing of a delayed receiver, whose estimate is that of the time
        of validity; or None
    differences, model : DifferenceProcessing, or None; FilterModel
    epoch : index
    """
    if differences is not None:
        for a in range(model.lever_arms.shape[0]):
            if delays is not None and delays.receiver_line >= 0:
                stored_state = state_history[ring_index(delays, delays.receiver_line, epoch)]
                antenna(previous_epoch.antenna[a], stored_state, work.rate, model.lever_arms[a], 0.0)
            else:
                antenna(previous_epoch.antenna[a], work.nav, work.rate, model.lever_arms[a], 0.0)
        previous_epoch.clock[0] = work.clock_hat[0]
        for e in range(work.extra.shape[0]):
            previous_epoch.extra[e] = work.extra[e]


@inline_jit
def clone_covariance(P, previous_epoch, differences):
    """Make the present epoch the earlier one in the covariance P (n, n) of the filter.

    The present states are cloned, or the accumulation of the transition starts again.
    """
    if differences is not None:
        if not differences.is_back_propagated:
            clone(P, differences)
        begin_transition(previous_epoch, differences)


@inline_jit
def clone_open_loop(x, state_history, open_loop, delays, differences, epoch):
    """Set the clones in the error state x (n,) of an open loop to the states at the end of an epoch."""
    if differences is not None and open_loop is not None:
        for c in range(differences.cloned_states.shape[0]):
            state = differences.cloned_states[c]
            x[differences.clone + c] = x[state]
            if delays is not None and delays.receiver_line >= 0 and state < 9:
                stored_state = state_history[ring_index(delays, delays.receiver_line, epoch)]
                x[differences.clone + c] = stored_state[ERROR + state]
