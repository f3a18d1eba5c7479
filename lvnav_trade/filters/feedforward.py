"""What is done with the error state: a closed loop feeds it back to the strapdown, an open loop adds it to the outputs.

A direct filter has none: its update acts on the total state after every scalar measurement, so that the next one is
linearised there. A closed loop linearises all scalars of an epoch where the epoch begins.

In an open loop the error state stays beside the inertial system: it is propagated with the transition of every window,
also where the covariance's is linearised less often, measurements are linearised at the uncorrected state, and the sum
of both goes into the records and nowhere else. For small errors that is the closed loop; a large error of the inertial
system leaves its second order in the measurements and in the transition. A mode logic, if there is one, permits or
stops the processing of measurements.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filters import ekf
from lvnav_trade.filters.delayed import find_earlier, renew
from lvnav_trade.filters.integrity.assess import assess
from lvnav_trade.filters.integrity.state import forget
from lvnav_trade.filters.iterated import hold
from lvnav_trade.filters.late import correct_stored_errors, place_of, predicted_of_stored
from lvnav_trade.filters.monitor import MODE, check_measurements, is_correcting, is_running, start_filter, update_mode
from lvnav_trade.filters.unscented import measure_receiver
from lvnav_trade.filters.updates import iterate_receiver, noise_variance, update_receiver, update_sensors
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where, zeros_of
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
            work.x, work.D, model.block_rows, model.block_columns, model.decay[length], model.clock,
            model.seconds[length],
        )  # fmt: skip
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
def _compare_late(work, past, open_loop, late, model, signals, epoch):
    """Correct the innovations of an open loop for what its error state has changed by since they were valid."""
    if open_loop is not None and late is not None and not late.extrapolated:
        for row in range(ekf.n_measured(model, signals, epoch)):
            channel = ekf.channel_of(model, signals, epoch, row)
            n = model.n_entry[channel]
            entries, columns = model.entry[channel, :n], model.column[channel, :n]
            work.z[row] = work.z[row] - predicted_of_stored(
                past, place_of(late, 0, epoch), work.H[row], entries, columns, work.x
            )


@jit
def _predicted(work, model, signals, epoch, row):
    """Return what the error state predicts of a row's measured minus predicted."""
    channel, total = ekf.channel_of(model, signals, epoch, row), like(work.x[0], 0.0)
    for c in range(model.n_entry[channel]):
        total = total + work.H[row, model.entry[channel, c]] * work.x[model.column[channel, c]]
    return total


@jit
def _predict_rows(work, watch, model, signals, epoch):
    """Set what the error state predicts of every row."""
    for row in range(ekf.n_measured(model, signals, epoch)):
        watch.predicted[row] = _predicted(work, model, signals, epoch, row)


@jit
def _sample_variance(out, rx, variance, scale, from_gnss):
    """Set the variances (6,) of a solution that a filter starts from: the receiver's, or what the filter assumes."""
    if from_gnss:
        for row in range(6):
            if rx is None:
                out[row] = like(out[0], variance[row])
            else:
                out[row] = rx.covariance[row, row] * (scale[row] * scale[row])


@jit
def _assess(work, points, monitor, tests, delayed, running, gains, model, signals, epoch):
    """Test an epoch's rows for faults (Monitor and Tests, or None); of an open loop less what its error state says."""
    if monitor is not None:
        for row in range(ekf.n_measured(model, signals, epoch)):
            channel = ekf.channel_of(model, signals, epoch, row)
            monitor.z[row] = work.z[row] - _predicted(work, model, signals, epoch, row)
            monitor.variance[row] = noise_variance(
                work, points, gains, signals, epoch, row, channel, model.has_covariance
            )
        assess(monitor, tests, work.P, work.H, monitor.z, running, delayed, model, signals, epoch)


@inlined
def _process_permitted(
    work, points, again, rx, past, earlier, watch, monitor, open_loop, direct, passes, rules, tests, late, delayed,
    gains, model, signals, epoch, dt,
):  # fmt: skip
    """Process the receiver's measurements at an epoch if the mode logic permits, and make its transitions."""
    n_row = ekf.n_measured(model, signals, epoch)
    if rules.good[epoch]:
        measure_receiver(work, points, past, earlier, late, delayed, model, signals, epoch, dt)
        _compare_late(work, past, open_loop, late, model, signals, epoch)
        _predict_rows(work, watch, model, signals, epoch)
    check_measurements(watch, rules, delayed, model, signals, epoch, work.z, n_row)
    if rules.good[epoch]:
        _sample_variance(watch.predicted, rx, signals.variance[epoch], signals.scale[epoch], rules.from_gnss)
        start_filter(work.P, work.x, watch, rules, work.z)
        renew(work.P, work.x, work.extra, delayed, model, epoch)  # for those that start: at others it is done
        ekf.decorrelate(work, points, past, rx, late, gains, model, signals, epoch)
        forget(monitor, watch.sample[1])
        _assess(work, points, monitor, tests, delayed, watch.sample[0], gains, model, signals, epoch)
        used = watch.sample[0] > 0.0
        gate = where(used, model.gate_squared, -1.0)
        starts = watch.sample[1] > 0.0
        hold(again, work, epoch)
        update_receiver(
            work, points, past, earlier, late, delayed, direct, monitor, gains, model, signals, epoch, dt, gate, starts
        )
        iterate_receiver(
            work, again, passes, rx, past, earlier, late, delayed, monitor, gains, model, signals, epoch, dt, gate,
            starts,
        )  # fmt: skip
        for row in range(n_row):
            channel = ekf.channel_of(model, signals, epoch, row)
            work.innovation[epoch, channel] = where(used, work.innovation[epoch, channel], np.nan)
    update_mode(watch, rules, epoch, work.P)


@inlined
def process_measurements(
    work, points, again, rx, past, earlier, watch, monitor, open_loop, direct, passes, rules, tests, late, delayed,
    gains, sensors, model, signals, epoch, dt,
):  # fmt: skip
    """Process what the receiver and the other sensors measure at an epoch; if the filter has a mode logic, once it
    permits.
    """
    if open_loop is not None:
        _copy(open_loop.x, work.x)
    ekf.place_antenna(work, past, late, model, dt, epoch)
    find_earlier(work.P, earlier, delayed)
    renew(work.P, work.x, work.extra, delayed, model, epoch)
    if rules is None:
        if ekf.n_measured(model, signals, epoch) > 0:
            measure_receiver(work, points, past, earlier, late, delayed, model, signals, epoch, dt)
            ekf.decorrelate(work, points, past, rx, late, gains, model, signals, epoch)
            _compare_late(work, past, open_loop, late, model, signals, epoch)
            _assess(work, points, monitor, tests, delayed, like(work.x[0], 1.0), gains, model, signals, epoch)
            gate = model.gate_squared
            hold(again, work, epoch)
            update_receiver(
                work,
                points,
                past,
                earlier,
                late,
                delayed,
                direct,
                monitor,
                gains,
                model,
                signals,
                epoch,
                dt,
                gate,
                None,
            )
            iterate_receiver(
                work, again, passes, rx, past, earlier, late, delayed, monitor, gains, model, signals, epoch, dt, gate,
                None,
            )  # fmt: skip
        gate = model.gate_squared
        update_sensors(
            work, points, again, passes, past, open_loop, direct, late, gains, sensors, model, signals, epoch, gate
        )
    elif (epoch + 1) % model.every == 0:
        _process_permitted(
            work, points, again, rx, past, earlier, watch, monitor, open_loop, direct, passes, rules, tests, late,
            delayed, gains, model, signals, epoch, dt,
        )  # fmt: skip
        gate = where(is_running(watch.state[MODE]) > 0.0, model.gate_squared, -1.0)
        update_sensors(
            work, points, again, passes, past, open_loop, direct, late, gains, sensors, model, signals, epoch, gate
        )
