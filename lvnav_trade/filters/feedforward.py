"""What is done with the error state: a closed loop feeds it back to the strapdown, an open loop adds it to the outputs.

In an open loop the error state stays beside the inertial system: it is propagated with the transition of every window,
measurements are linearised at the uncorrected state, and the sum of both goes into the records and nowhere else. For
small errors that is the closed loop; a large error of the inertial system leaves its second order in the measurements
and in the transition. A mode logic, if there is one, permits or stops the processing of measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.filters.ekf import (
    channel_of,
    correct,
    fill_loose,
    fill_receiver,
    fill_tight,
    n_measured,
    place_antenna,
    update_receiver,
    update_sensors,
    weigh,
)
from lvnav_trade.filters.late import correct_stored_errors, predicted_of_stored
from lvnav_trade.filters.monitor import (
    MODE,
    check_measurements,
    gate_of,
    is_correcting,
    is_running,
    start_filter,
    update_mode,
)
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.lanes import aligned_zeros, like, size, view, where

Floats = NDArray[np.float64]


class OpenLoop(NamedTuple):
    """What an open loop stores while its sum is recorded, or an epoch is processed: x (n_state,) error state, nav (10,)
    inertial system, par (n_par, 3), clock (2,) and extra (n_extra,) estimates.
    """

    x: Floats
    nav: Floats
    par: Floats
    clock: Floats
    extra: Floats


def new_open_loop(n_state: int, n_par: int, n_extra: int, lanes: int = 0) -> OpenLoop:
    """Return the arrays of an open loop: one run, or `lanes` runs on the last axis."""
    end = (lanes,) if lanes else ()
    shapes = ((n_state,), (10,), (max(1, n_par), 3), (2,), (max(1, n_extra),))
    return OpenLoop(*(aligned_zeros((*shape, *end)) for shape in shapes))


@jit
def _as_lanes(w):
    return OpenLoop(view(w.x), view(w.nav), view(w.par), view(w.clock), view(w.extra))


@jit
def lanes_of_open_loop(open_loop):
    """Return lane views of an open loop's arrays, or None where the loop is closed."""
    if open_loop is None:
        return None
    return _as_lanes(open_loop)


@jit
def carry(work, open_loop, model, length):
    """Propagate the error state of an open loop over a window, with the blocks that `predict_window` has filled."""
    if open_loop is not None:
        apply_phi(
            work.x, work.D, model.block_rows, model.block_columns, model.decay[length], model.clock,
            model.seconds[length],
        )  # fmt: skip


@jit
def apply_feedback(work, open_loop, late, model):
    """Feed the error state back in a closed loop; in an open one correct what late measurements are compared with."""
    if open_loop is None:
        correct(work, late, model)
    else:
        correct_stored_errors(work.past, late, work.x, open_loop.x)


@jit
def _share(work, watch):
    """Return 1 where the outputs of an open loop are corrected, 0 where they are the inertial system's own."""
    if watch is None:
        return like(work.x[0], 1.0)
    return is_correcting(watch.state[0])


@jit
def _copy(to, source, n):
    for i in range(n):
        to[i] = source[i]


@jit
def apply_correction(work, open_loop, watch, model):
    """Set the estimates to the sum of inertial system and error state; `remove_correction` restores them."""
    share = _share(work, watch)
    _copy(open_loop.x, work.x, size(work.x, 0))
    _copy(open_loop.nav, work.nav, size(work.nav, 0))
    _copy(open_loop.clock, work.clock_hat, 2)
    _copy(open_loop.extra, work.extra, size(work.extra, 0))
    for b in range(size(work.par, 0)):
        _copy(open_loop.par[b], work.par[b], 3)
    for i in range(size(work.x, 0)):
        work.x[i] = where(share > 0.0, work.x[i], 0.0)
    correct(work, None, model)


@jit
def remove_correction(work, open_loop, model):
    """Undo `apply_correction`: nothing that is estimated reaches the strapdown."""
    _copy(work.x, open_loop.x, size(work.x, 0))
    _copy(work.nav, open_loop.nav, size(work.nav, 0))
    _copy(work.clock_hat, open_loop.clock, 2)
    _copy(work.extra, open_loop.extra, size(work.extra, 0))
    for b in range(size(work.par, 0)):
        _copy(work.par[b], open_loop.par[b], 3)
    processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)


@jit
def _compare_late(work, open_loop, late, model, signals, epoch):
    """Correct the innovations of an open loop for what its error state has changed by since they were valid."""
    if open_loop is not None and late is not None:
        _correct_innovations(work, late, model, signals, epoch)


@jit
def _correct_innovations(work, late, model, signals, epoch):
    if not late.extrapolated:
        for row in range(n_measured(model, signals, epoch)):
            channel = channel_of(model, signals, epoch, row)
            n = model.n_entry[channel]
            entries, columns = model.entry[channel, :n], model.column[channel, :n]
            work.z[row] = work.z[row] - predicted_of_stored(
                work.past, late, work.H[row], entries, columns, work.x, epoch
            )


@jit
def _store_error_state(work, open_loop):
    """Store the error state of an open loop before an epoch."""
    if open_loop is not None:
        _copy(open_loop.x, work.x, size(work.x, 0))


@jit
def _predict_rows(work, model, signals, epoch):
    """Set what the error state predicts of every row's measured minus predicted."""
    for row in range(n_measured(model, signals, epoch)):
        channel = channel_of(model, signals, epoch, row)
        total = like(work.x[0], 0.0)
        for c in range(model.n_entry[channel]):
            total = total + work.H[row, model.entry[channel, c]] * work.x[model.column[channel, c]]
        work.watch.predicted[row] = total


@jit
def _sample_variance(out, rx, variance, from_gnss):
    """Set the variances (6,) of a solution that a filter starts from: the receiver's, or what the filter assumes."""
    if from_gnss:
        for row in range(6):
            if rx is None:
                out[row] = like(out[0], variance[row])
            else:
                out[row] = rx.covariance[row, row]


@inlined
def _process_permitted(work, open_loop, rules, late, gains, model, signals, epoch):
    """Process the receiver's measurements at an epoch if the mode logic permits, and make its transitions."""
    watch, n_row = work.watch, n_measured(model, signals, epoch)
    if rules.good[epoch]:
        if model.tight:
            fill_tight(work, model, signals, epoch)
        else:
            fill_loose(work, model, signals, epoch)
        _compare_late(work, open_loop, late, model, signals, epoch)
        _predict_rows(work, model, signals, epoch)
    check_measurements(watch, rules, model, signals, epoch, work.z, n_row)
    if rules.good[epoch]:
        _sample_variance(watch.predicted, work.rx, signals.variance[epoch], rules.from_gnss)
        start_filter(work.P, work.x, watch, rules, work.z)
        weigh(work, work.rx, late, gains, model, signals, epoch)
        gate, used = gate_of(watch, model.gate_squared), watch.sample[0] > 0.0
        update_receiver(work, gains, model, signals, epoch, gate)
        for row in range(n_row):
            channel = channel_of(model, signals, epoch, row)
            work.innovation[epoch, channel] = where(used, work.innovation[epoch, channel], np.nan)
    update_mode(watch, rules, epoch, work.P)


@inlined
def process_measurements(work, open_loop, rules, late, gains, sensors, model, signals, epoch, dt):
    """Process what the receiver and the other sensors measure at an epoch; if the filter has a mode logic, once it
    permits.
    """
    _store_error_state(work, open_loop)
    place_antenna(work, late, model, dt, epoch)
    if rules is None:
        if n_measured(model, signals, epoch) > 0:
            fill_receiver(work, late, gains, model, signals, epoch)
            _compare_late(work, open_loop, late, model, signals, epoch)
            update_receiver(work, gains, model, signals, epoch, model.gate_squared)
        update_sensors(work, gains, sensors, model, signals, epoch, model.gate_squared)
    elif (epoch + 1) % model.every == 0:
        _process_permitted(work, open_loop, rules, late, gains, model, signals, epoch)
        gate = where(is_running(work.watch.state[MODE]) > 0.0, model.gate_squared, -1.0)
        update_sensors(work, gains, sensors, model, signals, epoch, gate)
