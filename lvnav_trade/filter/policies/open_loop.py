"""Use of the error state: a closed loop feeds it back to the strapdown, an open loop adds it to the outputs.

A direct filter has no error state: every scalar measurement corrects the total state, and the next measurement is
linearised there. A closed loop linearises all measurements of an epoch at the state at its beginning.

An open loop propagates the error state separately from the inertial system, with the transition matrix of every window,
even if the covariance is linearised less often. Measurements are linearised at the uncorrected state. The sum of
inertial system and error state is recorded and used nowhere else. To first order the result is that of a closed loop;
large inertial errors add second-order terms to the measurements and to the transition. A mode logic permits or stops
the processing of measurements.
"""

from typing import NamedTuple

from lvnav_trade.filter import ekf
from lvnav_trade.filter.policies.delay import correct_stored_errors, prediction_change, ring_index
from lvnav_trade.filter.policies.mode_logic import MODE, PREDICTED, is_correcting
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import where, zeros_of
from lvnav_trade.kernels.transition import EVERY_WINDOW
from lvnav_trade.quantities.records import Floats


class OpenLoop(NamedTuple):
    """Uncorrected state of an open loop, stored while the corrected outputs are recorded or an epoch is processed.

    x : (n_state,). Error state.
    nav : (10,). Navigation state of the inertial system, frame i.
    par : (n_par, 3). Estimated IMU parameters.
    clock_hat : (2,) m, m/s. Estimated clock bias and drift.
    extra : (n_extra,). Estimated extra states.
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
def propagate_open_loop(work, sigma_points, open_loop, model, length_index, linearisation):
    """Propagate the error state of an open loop over a window.

    The transition matrix is that of the window itself, even if the covariance is linearised less often: the error state
    must follow the strapdown.

    Parameters
    ----------
    sigma_points : SigmaPoints of an unscented filter, whose mean gives the navigation errors; None with Jacobians
    open_loop : OpenLoop, or None in a closed loop
    model : FilterModel
    length_index : index of the window length
    linearisation : how the window changes the rates at which the covariance is linearised, as in `kernels.transition`
    """
    if open_loop is not None:
        if linearisation != EVERY_WINDOW:
            for i in range(work.sums.shape[0]):
                work.sums[i] = work.rates[1, i] * model.seconds[length_index]
            ekf.fill_transition(work, model, length_index)
        apply_phi(
            work.x,
            work.D,
            model.block_rows,
            model.block_columns,
            model.decay[length_index],
            model.clock,
            model.seconds[length_index],
        )
        if sigma_points is not None:
            for i in range(sigma_points.mean.shape[0]):
                work.x[i] = sigma_points.mean[i]


@jit
def propagate_held_correction(work, mode_state, rules, model, length_index):
    """Propagate what a mode logic (ModeState, or None) holds over a window, where the rules ask for it, by the
    transition that `propagate_open_loop` has left in `work.D`.
    """
    if mode_state is not None and rules.after_stop == PREDICTED:
        apply_phi(
            mode_state.held_correction,
            work.D,
            model.block_rows,
            model.block_columns,
            model.decay[length_index],
            model.clock,
            model.seconds[length_index],
        )


@jit
def apply_feedback(work, state_history, open_loop, delays, model):
    """Feed the error state back in a closed loop; in an open loop correct the stored states of late measurements."""
    if open_loop is None:
        ekf.correct(work, state_history, delays, model)
    else:
        correct_stored_errors(state_history, delays, work.x, open_loop.x)


@jit
def _copy(target, source):
    for i in range(source.shape[0]):
        target[i] = source[i]


@jit
def _copy_estimates(target, source):
    """Copy error state, inertial system and estimates from the arrays of a run to those of its open loop, or back."""
    _copy(target.x, source.x)
    _copy(target.nav, source.nav)
    _copy(target.clock_hat, source.clock_hat)
    _copy(target.extra, source.extra)
    for b in range(source.par.shape[0]):
        _copy(target.par[b], source.par[b])


@jit
def apply_correction(work, open_loop, mode_state, model):
    """Set the estimates to the sum of inertial system and error state; `remove_correction` restores them.

    While a mode logic (ModeState, or None) does not correct the outputs, its held error state takes the place of the
    filter's. It is zero before the first correction, so that the outputs are those of the inertial system.
    """
    _copy_estimates(open_loop, work)
    if mode_state is not None:
        for i in range(work.x.shape[0]):
            correcting = is_correcting(mode_state.state[MODE])
            work.x[i] = where(correcting > 0.0, work.x[i], mode_state.held_correction[i])
    ekf.correct(work, None, None, model)


@jit
def remove_correction(work, open_loop, model):
    """Undo `apply_correction`, so that no estimate enters the strapdown."""
    _copy_estimates(work, open_loop)
    processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)


@jit
def compare_receiver(work, state_history, case, delays, epoch):
    """Correct the innovations of delayed receiver measurements for the change of the error state since their time of
    validity (open loop; DelayProcessing, or None).
    """
    if delays is not None and not delays.is_extrapolated:
        model = case.model
        place = ring_index(delays, delays.receiver_line, epoch)
        for row in range(ekf.receiver_row_count(model, case.signals, epoch)):
            channel = ekf.receiver_channel(model, case.signals, epoch, row)
            n = model.n_entry[channel]
            entries = model.entry[channel, :n]
            columns = model.column[channel, :n]
            change = prediction_change(state_history, place, work.H[row], entries, columns, work.x)
            work.z[row] = work.z[row] - change


@jit
def _compare_sensor(work, state_history, case, open_loop, delays, k, epoch):
    """Correct the innovations of sensor k as `compare_receiver` does, for the error state before this epoch."""
    if open_loop is not None and delays is not None and delays.sensor_line[k] >= 0:
        model = case.model
        place = ring_index(delays, delays.sensor_line[k], epoch)
        first_channel = case.sensors.channel[k]
        first_row = ekf.sensor_row(model, work, first_channel)
        for i in range(case.sensors.scalars[k]):
            channel = first_channel + i
            row = first_row + i
            n = model.n_entry[channel]
            entries = model.entry[channel, :n]
            columns = model.column[channel, :n]
            change = prediction_change(state_history, place, work.H[row], entries, columns, open_loop.x)
            work.z[row] = work.z[row] - change


@inline_jit
def fill_sensor_at_state(work, optional_state, case, k, epoch):
    """Set the rows of sensor k at the present navigation state; in an open loop correct those of a late sensor."""
    delays = case.options.delay_processing
    ekf.fill_sensor(work, optional_state.state_history, delays, case.model, case.signals, case.sensors, k, epoch)
    _compare_sensor(work, optional_state.state_history, case, optional_state.open_loop, delays, k, epoch)


@inline_jit
def store_prior_state(open_loop, x):
    """Store the error state x (n,) at the beginning of an epoch of an open loop (OpenLoop, or None)."""
    if open_loop is not None:
        _copy(open_loop.x, x)
