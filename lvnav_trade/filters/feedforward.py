"""Use of the error state: a closed loop feeds it back to the strapdown, an open loop adds it to the outputs.

A direct filter has none: its update acts on the total state after every scalar measurement, so that the next one is
linearised there. A closed loop linearises all scalars of an epoch where the epoch begins.

In an open loop the error state stays beside the inertial system: it is propagated with the transition of every window,
also where the covariance's is linearised less often, measurements are linearised at the uncorrected state, and the sum
of both goes into the records and nowhere else. For small errors that is the closed loop; a large error of the inertial
system leaves its second order in the measurements and in the transition. A mode logic, if there is one, permits or
stops the processing of measurements.
"""

from typing import NamedTuple

from lvnav_trade.filters import ekf
from lvnav_trade.filters.late import correct_stored_errors, place_of, predicted_of_stored
from lvnav_trade.filters.monitor import MODE, is_correcting
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import where, zeros_of
from lvnav_trade.kernels.transition import EVERY_WINDOW
from lvnav_trade.records import Floats


class OpenLoop(NamedTuple):
    """What an open loop stores while its sum is recorded, or an epoch is processed: x (n_state,) error state, nav (10,)
    inertial system, par (n_par, 3), clock_hat (2,) and extra (n_extra,) estimates.
    """

    x: Floats
    nav: Floats
    par: Floats
    clock_hat: Floats
    extra: Floats


def new_open_loop(n_state: int, n_par: int, n_extra: int, lanes: int = 0) -> OpenLoop:
    """Return the arrays of an open loop: one run, or `lanes` runs on the last axis."""
    shapes = {"x": (n_state,), "nav": (10,), "par": (max(1, n_par), 3), "clock_hat": (2,), "extra": (max(1, n_extra),)}
    return OpenLoop(**zeros_of(shapes, lanes))


@jit
def propagate_open_loop(work, points, open_loop, model, length, linearised):
    """Propagate the error state of an open loop over a window: by the blocks of its transition, the motion of an
    unscented filter by its points (Points, or None).

    linearised : what the window does to the rates at which the covariance's transition is linearised; the error state
        is propagated by the window's own in any case, as the strapdown is
    """
    if open_loop is not None:
        if linearised != EVERY_WINDOW:
            for i in range(work.sums.shape[0]):
                work.sums[i] = work.rates[1, i] * model.seconds[length]
            ekf.fill_transition(work, model, length)
        apply_phi(
            work.x,
            work.D,
            model.block_rows,
            model.block_columns,
            model.decay[length],
            model.clock,
            model.seconds[length],
        )
        if points is not None:
            for i in range(points.mean.shape[0]):
                work.x[i] = points.mean[i]


@jit
def apply_feedback(work, past, open_loop, late, model):
    """Feed the error state back in a closed loop; in an open one correct what late measurements are compared with."""
    if open_loop is None:
        ekf.correct(work, past, late, model)
    else:
        correct_stored_errors(past, late, work.x, open_loop.x)


@jit
def _copy(to, source):
    for i in range(source.shape[0]):
        to[i] = source[i]


@jit
def _copy_estimates(to, source):
    """Copy error state, inertial system and estimates from the arrays of a run to those of its open loop, or back."""
    _copy(to.x, source.x)
    _copy(to.nav, source.nav)
    _copy(to.clock_hat, source.clock_hat)
    _copy(to.extra, source.extra)
    for b in range(source.par.shape[0]):
        _copy(to.par[b], source.par[b])


@jit
def apply_correction(work, open_loop, watch, model):
    """Set the estimates to the sum of inertial system and error state; `remove_correction` restores them. Where a mode
    logic (Watch, or None) does not yet correct the outputs, they remain the inertial system's own.
    """
    _copy_estimates(open_loop, work)
    if watch is not None:
        for i in range(work.x.shape[0]):
            work.x[i] = where(is_correcting(watch.state[MODE]) > 0.0, work.x[i], 0.0)
    ekf.correct(work, None, None, model)


@jit
def remove_correction(work, open_loop, model):
    """Undo `apply_correction`: nothing that is estimated reaches the strapdown."""
    _copy_estimates(work, open_loop)
    processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)


@jit
def compare_receiver(work, past, case, late, epoch):
    """Correct the innovations of an open loop for what its error state has changed by since they were valid, those of
    the receiver (Late, or None).
    """
    if late is not None and not late.extrapolated:
        model, place = case.model, place_of(late, late.receiver, epoch)
        for row in range(ekf.n_measured(model, case.signals, epoch)):
            channel = ekf.channel_of(model, case.signals, epoch, row)
            n = model.n_entry[channel]
            entries, columns = model.entry[channel, :n], model.column[channel, :n]
            work.z[row] = work.z[row] - predicted_of_stored(past, place, work.H[row], entries, columns, work.x)


@jit
def _compare_sensor(work, past, case, open_loop, late, k, epoch):
    """Do the same for sensor k, for what the error state has changed by up to this epoch."""
    if open_loop is not None and late is not None and late.of_sensor[k] >= 0:
        model, place = case.model, place_of(late, late.of_sensor[k], epoch)
        first = ekf.row_of(model, work, case.sensors.channel[k])
        for i in range(case.sensors.scalars[k]):
            channel, row = case.sensors.channel[k] + i, first + i
            n = model.n_entry[channel]
            entries, columns = model.entry[channel, :n], model.column[channel, :n]
            work.z[row] = work.z[row] - predicted_of_stored(past, place, work.H[row], entries, columns, open_loop.x)


@inlined
def fill_sensor_at_state(work, parts, case, k, epoch):
    """Set the rows of sensor k at the navigation state as it stands, less what an open loop knows of late ones."""
    late = case.options.late
    ekf.fill_sensor(work, parts.past, late, case.model, case.signals, case.sensors, k, epoch)
    _compare_sensor(work, parts.past, case, parts.open_loop, late, k, epoch)


@inlined
def begin_sum(open_loop, x):
    """Hold the error state x (n,) that an epoch of an open loop (OpenLoop, or None) begins with."""
    if open_loop is not None:
        _copy(open_loop.x, x)
