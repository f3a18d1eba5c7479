"""The iterated update: measurements linearised again at the estimate of the previous iteration.

Gauss and Newton's method for the measurements of an epoch (Bell and Cathey, IEEE Trans. Automatic Control 38(2),
1993). With the prediction x-, P- and pass i at x_i,

    x_(i+1) = x- + K_i (y - h(x_i) - H_i (x- - x_i)),   K_i = P- H_i' (H_i P- H_i' + R)^-1.

So a pass is the update of the extended filter from the same prediction, with rows at x_i and with H_i x_i added to what
is measured beyond them. An earlier state of a difference stays where it is; what is compared with a stored state is not
iterated.
"""

from typing import NamedTuple

from lvnav_trade.filters.ekf import (
    channel_of,
    correct_receiver,
    decorrelate,
    fill_receiver,
    n_measured,
    place_antenna,
    row_of,
)
from lvnav_trade.filters.feedforward import fill_sensor_at_state
from lvnav_trade.filters.late import repeat_extrapolation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, zeros_of
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.records import Floats


class Passes(NamedTuple):
    """How an update is iterated: repeats after the first pass; n_present states before the clones."""

    repeats: int
    n_present: int


class Again(NamedTuple):
    """Arrays of an iterated update: P (n, n), x (n,) of the prediction; at (n,) where rows are linearised; nav (10,),
    clock (2,), extra (n_extra,) that errors are of; counts (3,) of the epoch.
    """

    P: Floats
    x: Floats
    at: Floats
    nav: Floats
    clock: Floats
    extra: Floats
    counts: Floats


def new_again(n_state: int, n_extra: int, lanes: int = 0) -> Again:
    """Return the arrays of an iterated update: one run, or `lanes` runs on the last axis."""
    shapes = {
        "P": (n_state, n_state),
        "x": (n_state,),
        "at": (n_state,),
        "nav": (10,),
        "clock": (2,),
        "extra": (max(1, n_extra),),
        "counts": (3,),
    }
    return Again(**zeros_of(shapes, lanes))


@jit
def _copy(to, source):
    for i in range(to.shape[0]):
        to[i] = source[i]


@jit
def hold(again, work, epoch):
    """Hold what an update starts from (Again, or None)."""
    if again is not None:
        for i in range(again.x.shape[0]):
            _copy(again.P[i], work.P[i])
        _copy(again.x, work.x)
        _copy(again.nav, work.nav)
        _copy(again.clock, work.clock_hat)
        _copy(again.extra, work.extra)
        again.counts[0], again.counts[1], again.counts[2] = work.nis[epoch], work.n_row[epoch], work.n_reject[epoch]


@jit
def _move(work, again, passes, model, epoch):
    """Take the update back, and move the estimate to what it has found."""
    for i in range(again.x.shape[0]):
        again.at[i] = work.x[i] if i < passes.n_present else like(work.x[i], 0.0)
        work.x[i] = again.at[i]
        _copy(work.P[i], again.P[i])
    _stay(work, again)
    correct_motion(work.nav, work.x)
    correct_receiver(work, model)
    _copy(work.x, again.x)
    work.nis[epoch], work.n_row[epoch], work.n_reject[epoch] = again.counts[0], again.counts[1], again.counts[2]


@jit
def _stay(work, again):
    """Set the estimate to what errors are of."""
    _copy(work.nav, again.nav)
    _copy(work.clock_hat, again.clock)
    _copy(work.extra, again.extra)


@jit
def _refer(work, again, model, row, channel):
    """Let a row's measured minus predicted be of the state that errors are of."""
    for c in range(model.n_entry[channel]):
        value = work.H[row, model.entry[channel, c]] * again.at[model.column[channel, c]]
        work.z[row] = work.z[row] + value


@jit
def linearise_receiver(work, parts, case, again, epoch):
    """Set the rows of what the receiver measures, linearised at what the last update has found, which is taken back."""
    model, signals, options = case.model, case.signals, case.options
    _move(work, again, options.iterated, model, epoch)
    place_antenna(work, parts.past, options.late, model, case.step, epoch)
    fill_receiver(work, parts.earlier, options.delayed, model, signals, epoch)
    for row in range(n_measured(model, signals, epoch)):
        _refer(work, again, model, row, channel_of(model, signals, epoch, row))
    _stay(work, again)
    place_antenna(work, parts.past, options.late, model, case.step, epoch)
    repeat_extrapolation(parts.past, options.late)
    decorrelate(work, parts, case, parts.rx, options.late, epoch)


@jit
def linearise_sensor(work, parts, case, again, k, epoch):
    """Do the same with the rows of sensor k."""
    model, sensors = case.model, case.sensors
    at = row_of(model, work, sensors.channel[k])
    _move(work, again, case.options.iterated, model, epoch)
    fill_sensor_at_state(work, parts, case, k, epoch)
    for i in range(sensors.scalars[k]):
        _refer(work, again, model, at + i, sensors.channel[k] + i)
    _stay(work, again)
