"""The open-loop filter: the strapdown runs uncorrected, the error state runs beside it, outputs are their sum."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filters.ekf import fill_loose, place_antenna
from lvnav_trade.filters.monitor import N_ROW, gate_of, judge, settle, start_filter
from lvnav_trade.kernels.covariance import absorb
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.lanes import like, where


@inlined
def carry(work, belief, length):
    """Propagate the error state over a window, with the blocks that `predict_window` has filled."""
    apply_phi(
        work.x, work.K, work.D, belief.block_rows, belief.block_columns, belief.decay[length], belief.clock,
        belief.seconds[length],
    )  # fmt: skip


@jit
def _predict_rows(work, belief, signals, epoch):
    """Set what the error state predicts of every row's measured minus predicted."""
    for row in range(N_ROW):
        total = like(work.x[0], 0.0)
        for c in range(belief.n_entry[row]):
            total = total + work.H[row, belief.entry[row, c]] * work.x[belief.column[row, c]]
        work.watch.predicted[row] = total


@inlined
def update_watched(work, belief, signals, rules, epoch, dt):
    """Absorb the receiver's solution at an epoch where the filter's watch lets it, and let the watch go on."""
    watch = work.watch
    if rules.good[epoch]:
        place_antenna(work, belief, dt)
        fill_loose(work, belief, signals, epoch)
        _predict_rows(work, belief, signals, epoch)
    judge(watch, rules, epoch, work.z, watch.predicted)
    if rules.good[epoch]:
        start_filter(work.P, work.x, watch, rules, work.z, signals.variance[epoch])
        gate, used = gate_of(watch, belief.gate_squared), watch.sample[0] > 0.0
        for row in range(N_ROW):
            n = belief.n_entry[row]
            normalised, weight = absorb(
                work.P, work.x, work.K, work.H[row], belief.entry[row, :n], belief.column[row, :n], work.z[row],
                signals.variance[epoch, row], gate, belief.n_estimated, belief.joseph,
            )  # fmt: skip
            believed = weight > 0.0
            work.innovation[epoch, row] = where(used, normalised, np.nan)
            work.nis[epoch] = work.nis[epoch] + where(believed, normalised * normalised, 0.0)
            work.n_row[epoch] = work.n_row[epoch] + where(believed, 1.0, 0.0)
            work.n_reject[epoch] = work.n_reject[epoch] + where(believed, 0.0, 1.0)
    settle(watch, rules, epoch, work.P)
