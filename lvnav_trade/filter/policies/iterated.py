"""The iterated update: measurements linearised again at the estimate of the previous iteration.

Gauss and Newton's method for the measurements of an epoch (Bell and Cathey, IEEE Trans. Automatic Control 38(2),
1993). With the prediction x-, P- and pass i at x_i,

    x_(i+1) = x- + K_i (y - h(x_i) - H_i (x- - x_i)),   K_i = P- H_i' (H_i P- H_i' + R)^-1.

Each pass is therefore the update of the extended filter from the same prediction, with rows linearised at x_i and with
H_i x_i added to the innovation. The earlier state of a difference of two epochs is not iterated, nor are measurements
that are compared with a stored state.
"""

from typing import NamedTuple

from lvnav_trade.filter.decorrelation import decorrelate
from lvnav_trade.filter.ekf import (
    correct_receiver,
    fill_receiver,
    place_antenna,
    receiver_channel,
    receiver_row_count,
    sensor_row,
)
from lvnav_trade.filter.policies.delay import repeat_extrapolation
from lvnav_trade.filter.policies.open_loop import fill_sensor_at_state
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, zeros_of
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.quantities.records import Floats


class IterationSettings(NamedTuple):
    """Settings of an iterated update.

    repeats : Number of passes after the first.
    n_present : Number of states of the present epoch; clones follow them.
    """

    repeats: int
    n_present: int


class IterationWork(NamedTuple):
    """Arrays of an iterated update: the prediction, which every pass starts from.

    P : (n, n). Covariance of the prediction.
    x : (n,). Error state of the prediction.
    linearisation_state : (n,). Error state at which rows are linearised, x_i.
    nav : (10,). Navigation state that the error state refers to.
    clock : (2,) m, m/s. Clock estimate that it refers to.
    extra : (n_extra,). Estimated extra states that it refers to.
    counts : (3,). NIS, accepted and rejected measurements of the epoch before the update.
    """

    P: Floats
    x: Floats
    linearisation_state: Floats
    nav: Floats
    clock: Floats
    extra: Floats
    counts: Floats


def new_iteration_work(n_state: int, n_extra: int, lanes: int = 0) -> IterationWork:
    """Return the arrays of an iterated update: one run, or `lanes` runs on the last axis."""
    shapes = {
        "P": (n_state, n_state),
        "x": (n_state,),
        "linearisation_state": (n_state,),
        "nav": (10,),
        "clock": (2,),
        "extra": (max(1, n_extra),),
        "counts": (3,),
    }
    return IterationWork(**zeros_of(shapes, lanes))


@jit
def _copy(target, source):
    for i in range(target.shape[0]):
        target[i] = source[i]


@jit
def store_prediction(iteration, work, epoch):
    """Store the prediction that an update starts from (IterationWork, or None)."""
    if iteration is not None:
        for i in range(iteration.x.shape[0]):
            _copy(iteration.P[i], work.P[i])
        _copy(iteration.x, work.x)
        _copy(iteration.nav, work.nav)
        _copy(iteration.clock, work.clock_hat)
        _copy(iteration.extra, work.extra)
        iteration.counts[0] = work.nis[epoch]
        iteration.counts[1] = work.n_row[epoch]
        iteration.counts[2] = work.n_reject[epoch]


@jit
def _move(work, iteration, passes, model, epoch):
    """Undo the last pass and move the estimates to its result, where rows are linearised next."""
    for i in range(iteration.x.shape[0]):
        iteration.linearisation_state[i] = work.x[i] if i < passes.n_present else number_like(work.x[i], 0.0)
        work.x[i] = iteration.linearisation_state[i]
        _copy(work.P[i], iteration.P[i])
    _restore_estimates(work, iteration)
    correct_motion(work.nav, work.x)
    correct_receiver(work, model)
    _copy(work.x, iteration.x)
    work.nis[epoch] = iteration.counts[0]
    work.n_row[epoch] = iteration.counts[1]
    work.n_reject[epoch] = iteration.counts[2]


@jit
def _restore_estimates(work, iteration):
    """Set the estimates back to those that the error state refers to."""
    _copy(work.nav, iteration.nav)
    _copy(work.clock_hat, iteration.clock)
    _copy(work.extra, iteration.extra)


@jit
def _add_linear_term(work, iteration, model, row, channel):
    """Add H_i x_i to an innovation, which then refers to the state that the error state refers to."""
    for c in range(model.n_entry[channel]):
        entry = model.entry[channel, c]
        state = model.column[channel, c]
        linear_term = work.H[row, entry] * iteration.linearisation_state[state]
        work.z[row] = work.z[row] + linear_term


@jit
def linearise_receiver(work, optional_state, case, iteration, epoch):
    """Undo the last pass and set the receiver's rows, linearised at its result.

    Parameters
    ----------
    work, optional_state : arrays of the run and of its optional features
    case : FilterCase
    iteration : IterationWork, of `store_prediction`
    epoch : index
    """
    model = case.model
    signals = case.signals
    options = case.options
    _move(work, iteration, options.iteration_settings, model, epoch)
    place_antenna(work, optional_state.state_history, options.delay_processing, model, case.step, epoch)
    fill_receiver(work, optional_state.previous_epoch, options.differences, model, signals, epoch)
    for row in range(receiver_row_count(model, signals, epoch)):
        channel = receiver_channel(model, signals, epoch, row)
        _add_linear_term(work, iteration, model, row, channel)
    _restore_estimates(work, iteration)
    place_antenna(work, optional_state.state_history, options.delay_processing, model, case.step, epoch)
    repeat_extrapolation(optional_state.state_history, options.delay_processing)
    decorrelate(work, optional_state, case, optional_state.receiver, options.delay_processing, epoch)


@jit
def linearise_sensor(work, optional_state, case, iteration, k, epoch):
    """Undo the last pass and set the rows of sensor k, linearised at its result."""
    model = case.model
    sensors = case.sensors
    first_channel = sensors.channel[k]
    first_row = sensor_row(model, work, first_channel)
    _move(work, iteration, case.options.iteration_settings, model, epoch)
    fill_sensor_at_state(work, optional_state, case, k, epoch)
    for i in range(sensors.scalars[k]):
        _add_linear_term(work, iteration, model, first_row + i, first_channel + i)
    _restore_estimates(work, iteration)
