"""The policy of a filter: an open loop, whose outputs are sums and whose strapdown is left alone; whose leave it asks.

In an open loop the error state stays beside the inertial system: it is propagated with the transition of every window,
rows are linearised at the uncorrected state, and the sum of both goes into the records and nowhere else. For small
errors that is the closed loop; a large error of the inertial system leaves its second order in the rows and in the
transition.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.filters.ekf import (
    absorb_and_count,
    absorb_height,
    correct,
    fill_loose,
    place_antenna,
    rows_at,
    update,
    weigh,
)
from lvnav_trade.filters.monitor import (
    MODE,
    N_ROW,
    gate_of,
    is_correcting,
    is_running,
    judge,
    settle,
    start_filter,
)
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.lanes import aligned_zeros, like, size, view, where

Floats = NDArray[np.float64]


class Aside(NamedTuple):
    """What an open loop keeps while its sum is recorded: x (n_state,) error state, nav (10,) inertial system."""

    x: Floats
    nav: Floats


def new_aside(n_state: int, lanes: int = 0) -> Aside:
    """Return the arrays of an open loop: one run, or `lanes` runs on the last axis."""
    end = (lanes,) if lanes else ()
    return Aside(aligned_zeros((n_state, *end)), aligned_zeros((10, *end)))


@jit
def _as_lanes(w):
    return Aside(view(w.x), view(w.nav))


@jit
def lanes_of_aside(aside):
    """Return lane views of an open loop's arrays, or None where the loop is closed."""
    if aside is None:
        return None
    return _as_lanes(aside)


@jit
def carry(work, aside, belief, length):
    """Propagate the error state of an open loop over a window, with the blocks that `predict_window` has filled."""
    if aside is not None:
        apply_phi(
            work.x, work.D, belief.block_rows, belief.block_columns, belief.decay[length], belief.clock,
            belief.seconds[length],
        )  # fmt: skip


@jit
def feed_back(work, aside, belief):
    """Feed the error state back where the loop is closed."""
    if aside is None:
        correct(work, belief)


@jit
def _share(work, watch):
    """Return 1 where the outputs of an open loop are corrected, 0 where they are the inertial system's own."""
    if watch is None:
        return like(work.x[0], 1.0)
    return is_correcting(watch.state[0])


@jit
def add_up(work, aside, watch, belief):
    """Set the navigation state to the sum of inertial system and error state; both are kept aside."""
    share = _share(work, watch)
    for i in range(size(work.x, 0)):
        aside.x[i] = work.x[i]
        work.x[i] = where(share > 0.0, work.x[i], 0.0)
    for i in range(size(work.nav, 0)):
        aside.nav[i] = work.nav[i]
    correct(work, belief)


@jit
def take_apart(work, aside, belief):
    """Undo `add_up`: nothing that is estimated reaches the strapdown."""
    for i in range(size(work.x, 0)):
        work.x[i] = aside.x[i]
    for i in range(size(work.nav, 0)):
        work.nav[i] = aside.nav[i]
    processes.zero_all(work.par)
    processes.zero_all(work.tables)
    for i in range(2):
        work.clock_hat[i] = like(work.x[0], 0.0)
    for e in range(belief.extra_offset.shape[0]):
        work.extra[e] = like(work.x[0], 0.0)


@jit
def _predict_rows(work, belief):
    """Set what the error state predicts of every row's measured minus predicted."""
    for row in range(N_ROW):
        total = like(work.x[0], 0.0)
        for c in range(belief.n_entry[row]):
            total = total + work.H[row, belief.entry[row, c]] * work.x[belief.column[row, c]]
        work.watch.predicted[row] = total


@jit
def _sample_variance(out, rx, variance):
    """Set the variances (6,) of a solution: what the receiver tells with it, or what the filter believes."""
    for row in range(N_ROW):
        if rx is None:
            out[row] = like(out[0], variance[row])
        else:
            out[row] = rx.covariance[row, row]


@inlined
def _update_watched(work, rules, gains, belief, signals, epoch, dt):
    """Absorb the receiver's solution at an epoch where the filter's watch lets it, and let the watch go on."""
    watch = work.watch
    if rules.good[epoch]:
        place_antenna(work, None, belief, dt)
        fill_loose(work, belief, signals, epoch)
        _predict_rows(work, belief)
    judge(watch, rules, epoch, work.z, watch.predicted)
    if rules.good[epoch]:
        _sample_variance(watch.predicted, work.rx, signals.variance[epoch])
        start_filter(work.P, work.x, watch, rules, work.z, watch.predicted)
        weigh(work, work.rx, None, belief, signals, epoch)
        gate, used = gate_of(watch, belief.gate_squared), watch.sample[0] > 0.0
        for row in range(N_ROW):
            absorb_and_count(work, gains, belief, signals, epoch, row, row, gate)
            work.innovation[epoch, row] = where(used, work.innovation[epoch, row], np.nan)
    settle(watch, rules, epoch, work.P)


@inlined
def take(work, rules, late, gains, altimeter, belief, signals, epoch, dt):
    """Take what the receiver puts out at an epoch, where the filter has a logic by its leave, and what an altimeter
    does, once the filter runs.
    """
    if rules is None:
        if rows_at(belief, signals, epoch) > 0:
            update(work, belief, signals, late, gains, epoch, dt)
        absorb_height(work, altimeter, belief, signals, epoch, belief.gate_squared)
    elif (epoch + 1) % belief.every == 0:
        _update_watched(work, rules, gains, belief, signals, epoch, dt)
        gate = where(is_running(work.watch.state[MODE]) > 0.0, belief.gate_squared, -1.0)
        absorb_height(work, altimeter, belief, signals, epoch, gate)
