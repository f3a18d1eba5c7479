"""Differences of two epochs: the earlier state is stored, and cloned in the covariance or found from the present one.

A difference of ranges, z_k - z_(k-1), depends on the state at two epochs. The estimate of the earlier one is stored;
its error is a clone of the present one (stochastic cloning: Roumeliotis and Burdick 2002), so that the update has its
usual form. After the updates of an epoch the clone is replaced: x_clone <- S x. Instead of cloning, the covariance of
the earlier state follows from the present one by the inverse of the transition in between (Wendel and Trommer 2004):

    x_(k-1) = Phi^-1 (x_k - w),   Cov(x_k, x_(k-1)) = (P_k - Q) Phi^-T,   P_(k-1) = Phi^-1 (P_k - Q) Phi^-T

with w of covariance Q, which is the correlation of process noise with the measurement. As S x these are the rows that
the clone has, so both are the same filter but for rounding, as long as nothing is measured between the two epochs.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filters.late import ERROR, place_of
from lvnav_trade.kernels.covariance import add_turned, apply_phi, inflate, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, zeros_of
from lvnav_trade.kernels.transition import ATT, POS
from lvnav_trade.layout import StateLayout
from lvnav_trade.line_of_sight import antenna
from lvnav_trade.observables.base import D_ATT, D_CLOCK, D_EXTRA, D_POS, H_ATT, H_CLOCK, H_POS, N_ENTRY
from lvnav_trade.observables.partials import Channels
from lvnav_trade.records import Bools, Floats, Ints


class Delayed(NamedTuple):
    """How a filter measures further observables of satellites, beside pseudorange and range rate.

    difference (n_kind,) whether an observable is a difference of two epochs; present (n_epoch, n_receiver) whether a
    channel has a measurement; earlier: first entry of a row that is of the earlier epoch; renewed (n_epoch, n_extra)
    variance that an extra state begins anew with at an epoch, -1 where it does not; cloned (n_clone,) states, and
    clone, the first of their clones; back: the earlier state is found from the present one.
    """

    difference: Bools
    present: Bools
    earlier: int
    renewed: Floats
    cloned: Ints
    clone: int
    back: bool


class Earlier(NamedTuple):
    """What a filter stores of the epoch before: antenna (n_antenna, 21), clock (1,) m and extra (n_extra,) estimates;
    phi and noise (n_state, n_state), the transition since then and its noise, lu (n_state, n_state), all empty unless
    the earlier state is found from the present one; growth (1,) of deviations by fading memory since then.
    """

    antenna: Floats
    clock: Floats
    extra: Floats
    phi: Floats
    noise: Floats
    lu: Floats
    growth: Floats


def new_earlier(delayed: Delayed, n_antenna: int, n_extra: int, n_state: int, lanes: int = 0) -> Earlier:
    """Return the arrays of a filter's earlier epoch: one run, or `lanes` runs on the last axis."""
    n = n_state if delayed.back else 1
    shapes = {"antenna": (n_antenna, 21), "clock": (1,), "extra": (max(1, n_extra),), "growth": (1,)}
    return Earlier(**zeros_of(shapes | dict.fromkeys(("phi", "noise", "lu"), (n, n)), lanes))


def cloned_states(
    layout: StateLayout, channels: Channels, differences: tuple[str, ...], has_lever: bool
) -> tuple[int, ...]:
    """Return the states that the earlier range of a difference depends on."""
    if not differences:
        return ()
    of_differences = np.r_[tuple(channels.of(name) for name in differences)]
    entering = [e for e in layout.extras if np.any(e.member[of_differences] >= 0)]
    found = [*range(POS, POS + 3), *(range(ATT, ATT + 3) if has_lever else ()), layout.clock]
    return (*found, *(e.offset + i for e in entering for i in range(len(e.labels))))


def earlier_entries(layout: StateLayout, present: list[tuple[int, int]], first: int) -> list[tuple[int, int]]:
    """Return entries and clones of the earlier epoch of a difference by those of the later one; first: entry."""
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
    """Return whether the filter takes a channel of the receiver that has a row at an epoch."""
    if delayed is None:
        return model.measured[channel]
    return model.measured[channel] and delayed.present[epoch, channel]


@jit
def subtract_extra(work, earlier, delayed, model, signals, epoch, row, channel):
    """Set the entries of a difference for extra states at its earlier epoch; return what their estimates take off the
    prediction.
    """
    h = work.H[row]
    total = like(work.x[0], 0.0)
    for f in range(model.extra_member.shape[0]):
        e = model.extra_member[f, channel]
        if e >= 0:
            partial = like(work.x[0], signals.partial[f, epoch - 1, channel])
            h[delayed.earlier + D_EXTRA + f] = -partial
            total = total + partial * earlier.extra[e]
    return total


@jit
def _begin_anew(P, at, variance):
    """Let a state of the covariance P begin anew, with a variance and independent of the others."""
    for i in range(P.shape[0]):
        P[at, i], P[i, at] = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
    P[at, at] = like(P[0, 0], variance)


@jit
def renew(P, x, extra, delayed, model, epoch):
    """Let states begin anew at an epoch: the noise of a measurement, the ambiguity of a carrier that was acquired.

    P (n, n), x (n,) and the estimates extra (n_extra,) updated; delayed : Delayed, or None
    """
    if delayed is not None:
        for e in range(delayed.renewed.shape[1]):
            if delayed.renewed[epoch, e] >= 0.0:
                at = model.extra_offset[e]
                _begin_anew(P, at, delayed.renewed[epoch, e])
                x[at], extra[e] = like(x[0], 0.0), like(x[0], 0.0)


@jit
def clone(P, delayed):
    """Replace the clones in the covariance P (n, n) by the states that they are of: S P S'."""
    n = P.shape[0]
    for c in range(delayed.cloned.shape[0]):
        for j in range(n):
            P[delayed.clone + c, j] = P[delayed.cloned[c], j]
    for c in range(delayed.cloned.shape[0]):
        for i in range(n):
            P[i, delayed.clone + c] = P[i, delayed.cloned[c]]


@inlined
def accumulate_transition(earlier, delayed, blocks, sums, model, length, injection):
    """Accumulate transition and noise since the epoch before over a window, where the earlier state is found from them;
    sums (18,): the strapdown's, of which the blocks are.
    """
    if delayed is not None and delayed.back:
        seconds, n, factor = model.seconds[length], earlier.phi.shape[0], model.inflation[length]
        if factor != 1.0:
            inflate(earlier.noise, factor, model.n_estimated)
            for j in range(n):
                for i in range(model.n_estimated):
                    earlier.phi[j, i] = earlier.phi[j, i] * factor
            earlier.growth[0] = earlier.growth[0] * factor
        # by columns: Phi of the window times each of them
        for j in range(n):
            apply_phi(
                earlier.phi[j],
                blocks,
                model.block_rows,
                model.block_columns,
                model.decay[length],
                model.clock,
                seconds,
            )
        add_turned(earlier.noise, model.uneven, sums, seconds)
        predict(
            earlier.noise,
            blocks,
            model.block_rows,
            model.block_columns,
            model.decay[length],
            model.noise[length],
            model.clock,
            seconds,
        )
        add_turned(earlier.noise, model.uneven, sums, seconds)
        if injection >= 0:
            for i in range(n):
                earlier.noise[i, i] = earlier.noise[i, i] + model.injected[injection, i]


@jit
def begin_transition(earlier, delayed):
    """Start transition and noise at an epoch."""
    if delayed is not None and delayed.back:
        n = earlier.phi.shape[0]
        earlier.growth[0] = like(earlier.clock[0], 1.0)
        for i in range(n):
            for j in range(n):
                earlier.phi[i, j] = like(earlier.clock[0], 1.0 if i == j else 0.0)
                earlier.noise[i, j] = like(earlier.clock[0], 0.0)


@jit
def _factorise(lu, phi):
    """Set lu (n, n) to the factors L (unit diagonal) and U of the transition, whose columns are the rows of phi.

    Without pivots: a transition of some seconds is lower and upper triangular with ones but for small numbers.
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
def find_earlier(P, earlier, delayed):
    """Set the clones in the covariance P (n, n) to the earlier state as it follows from the present one.

    earlier.noise becomes (P - Q) Phi^-T. The rows and columns of the clones themselves are cleared first. With fading
    memory the recovered covariance is inflated by `growth`, as that of a stored clone would be.
    """
    if delayed is not None and delayed.back:
        growth = earlier.growth[0]
        n, n_clone, first = P.shape[0], delayed.cloned.shape[0], delayed.clone
        _factorise(earlier.lu, earlier.phi)
        back = earlier.noise  # row i: what state i of now has with the states of then
        for i in range(n):
            for j in range(n):
                back[i, j] = P[i, j] - back[i, j]
        for c in range(n_clone):  # whatever the clones were is no information
            for j in range(n):
                back[first + c, j], back[j, first + c] = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
        for i in range(n):
            _solve(earlier.lu, back[i])
        for c in range(n_clone):
            for i in range(n):
                if not (first <= i and i < first + n_clone):
                    P[i, first + c] = growth * back[i, delayed.cloned[c]]
                    P[first + c, i] = growth * back[i, delayed.cloned[c]]
        # then with then: Phi^-1 once more, on the other side
        for c in range(n_clone):
            column = earlier.phi[c]
            for i in range(n):
                column[i] = back[i, delayed.cloned[c]]
            _solve(earlier.lu, column)
            for d in range(n_clone):
                P[first + d, first + c] = growth * growth * column[delayed.cloned[d]]


@jit
def correct_earlier(x, earlier, delayed, model):
    """Correct the stored estimate of the earlier epoch by the clones in an error state x (n,) that is fed back between
    rows of the same epoch.
    """
    if delayed is not None:
        for c in range(delayed.cloned.shape[0]):
            state, value = delayed.cloned[c], x[delayed.clone + c]
            for a in range(earlier.antenna.shape[0]):
                at = earlier.antenna[a]
                if POS <= state and state < POS + 3:
                    at[state - POS] = at[state - POS] + value
                elif state < ATT + 3:  # the arm turns about one axis: x cross arm
                    second, third = (state - ATT + 1) % 3, (state - ATT + 2) % 3
                    up, down = value * at[6 + second], value * at[6 + third]
                    at[third], at[6 + third] = at[third] + up, at[6 + third] + up
                    at[second], at[6 + second] = at[second] - down, at[6 + second] - down
            if state == model.clock:
                earlier.clock[0] = earlier.clock[0] + value
            for e in range(model.extra_offset.shape[0]):
                if model.extra_offset[e] == state:
                    earlier.extra[e] = earlier.extra[e] + value


@inlined
def store_estimate(work, earlier, past, late, delayed, model, epoch):
    """Store the estimate at the end of an epoch for the differences of the next one; of a late receiver (Late, or None)
    that of the time when its measurements were valid.
    """
    if delayed is not None:
        for a in range(model.lever_arms.shape[0]):
            if late is not None and late.receiver >= 0:
                antenna(
                    earlier.antenna[a], past[place_of(late, late.receiver, epoch)], work.rate, model.lever_arms[a], 0.0
                )
            else:
                antenna(earlier.antenna[a], work.nav, work.rate, model.lever_arms[a], 0.0)
        earlier.clock[0] = work.clock_hat[0]
        for e in range(work.extra.shape[0]):
            earlier.extra[e] = work.extra[e]


@inlined
def clone_formal(P, earlier, delayed):
    """Let the earlier state be that of this epoch in the covariance P (n, n) of the filter, or in what it will be found
    from.
    """
    if delayed is not None:
        if not delayed.back:
            clone(P, delayed)
        begin_transition(earlier, delayed)


@inlined
def clone_open_loop(x, past, open_loop, late, delayed, epoch):
    """Let the clones of the error state x (n,) of an open loop be what the states are at the end of an epoch."""
    if delayed is not None and open_loop is not None:
        for c in range(delayed.cloned.shape[0]):
            state = delayed.cloned[c]
            x[delayed.clone + c] = x[state]
            if late is not None and late.receiver >= 0 and state < 9:
                x[delayed.clone + c] = past[place_of(late, late.receiver, epoch), ERROR + state]
