"""Mode logic of a filter: when it starts, which measurements it accepts, when it stops and starts again.

The logic of an open-loop filter (Thomas et al., section 5) is a state machine with one step per epoch, for one run or
for eight lanes. The checks at the input (flags, freshness, dilution of precision) have the same result in every run and
are in `ModeRules.is_good`. Residuals and covariance differ from run to run and are checked here.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.ekf import receiver_channel
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import magnitude, number_like, where, zeros_of
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.quantities.records import AIDING, CONVERGING, PREDICTING, STOPPED, WAITING, Bools, Floats

(NONE, GOOD_SAMPLES, CONVERGED, DATA_LOST, DATA_AGAIN, LOSS_PERSISTS, RESIDUAL_PERSISTS, COVARIANCE_PERSISTS) = range(8)
"""Reasons of a mode transition; their texts are in records.REASONS."""

INERTIAL, HELD, PREDICTED = range(3)
"""Outputs after a stop, by number: the inertial system's own, the last correction held, the same propagated."""

MODE, COUNT, RUN_TIME, ERROR_TIME, STOP_REASON = range(5)
"""Elements of `ModeState.state`: mode, successive good samples, seconds since the filter started, seconds since the
last epoch without an error, reason of the last stop.
"""
N_WATCH = 5
N_SPREAD = 6


class ModeRules(NamedTuple):
    """Rules of the mode logic, as numbers.

    interval : s. Time between epochs.
    is_good : (n_epoch,). Whether the receiver's sample passes all checks at the input.
    residual_limits : (n_receiver,) SI. Largest residual by receiver channel; infinite for no limit.
    variance_limits : (6,) SI squared. Largest variance of position error and velocity error; infinite for no limit.
    start_after : Good samples in succession before the filter starts.
    correct_after : s after the start. Time from which outputs are corrected; infinite for never.
    stop_after : s. Duration of an error after which the filter stops; infinite for never.
    after_stop : Outputs from a stop until the filter corrects again: `INERTIAL`, `HELD` or `PREDICTED`.
    restarts : (3,). Whether the filter restarts after a persistent data loss, residual error, covariance error.
    from_gnss : Whether position and velocity start from the receiver's sample.
    start_covariance : (n, n). Covariance of the filter at a start.
    """

    interval: float
    is_good: Bools
    residual_limits: Floats
    variance_limits: Floats
    start_after: float
    correct_after: float
    stop_after: float
    after_stop: int
    restarts: Floats
    from_gnss: bool
    start_covariance: Floats


class ModeState(NamedTuple):
    """State of the mode logic of a run, updated in place.

    state : (N_WATCH,). Mode, counters and timers, see `MODE`.
    previous_innovation : (n_receiver,). Previous sample by channel minus the inertial prediction; not-a-number if there
        is none.
    z : (n_row,). Measured minus predicted by the inertial system alone; in linear covariance its mean.
    predicted_innovation : (n_row,). Prediction of z by the error state; at a start from the receiver, the variances of
        its rows.
    sample : (2,). Whether the sample of this epoch is used, and whether the filter starts with it.
    mode : (n_epoch,). Mode after each epoch.
    reason : (n_epoch,). Reason of a mode transition at the epoch; 0: no transition.
    held_correction : (n_state,). Error state that corrects the outputs while the filter does not; zero for none.
    """

    state: Floats
    previous_innovation: Floats
    z: Floats
    predicted_innovation: Floats
    sample: Floats
    mode: Floats
    reason: Floats
    held_correction: Floats


def new_mode_state(n_epoch: int, n_receiver: int = 6, n_row: int = 6, lanes: int = 0, n_state: int = 1) -> ModeState:
    """Return the arrays of a mode logic: one run, or `lanes` runs on the last axis."""
    shapes = {
        "state": (N_WATCH,),
        "previous_innovation": (max(1, n_receiver),),
        "z": (n_row,),
        "predicted_innovation": (n_row,),
        "sample": (2,),
        "mode": (n_epoch,),
        "reason": (n_epoch,),
        "held_correction": (n_state,),
    }
    return ModeState(**zeros_of(shapes, lanes))


@jit
def begin_mode_logic(mode_state):
    """Reset the mode logic (ModeState, or None) to waiting for the first samples."""
    if mode_state is not None:
        for i in range(N_WATCH):
            mode_state.state[i] = number_like(mode_state.previous_innovation[0], 0.0)
        for i in range(mode_state.previous_innovation.shape[0]):
            mode_state.previous_innovation[i] = number_like(mode_state.previous_innovation[0], np.nan)
        for i in range(mode_state.held_correction.shape[0]):
            mode_state.held_correction[i] = number_like(mode_state.previous_innovation[0], 0.0)


@jit
def is_running(mode):
    """Return 1 where the filter runs, 0 where it waits or has stopped."""
    return where((mode == CONVERGING) | (mode == AIDING) | (mode == PREDICTING), 1.0, 0.0)


@jit
def is_correcting(mode):
    """Return 1 where the outputs are corrected, 0 where they are those of the uncorrected inertial system."""
    return where((mode == AIDING) | (mode == PREDICTING), 1.0, 0.0)


@jit
def hold_correction(mode_state, rules, x):
    """Hold the error state x (n,) that the outputs are corrected by, for the time after a stop; called before an epoch
    is processed, so that what is held at a stop is the estimate up to the epoch of the stop.
    """
    if mode_state is not None and rules.after_stop != INERTIAL:
        correcting = is_correcting(mode_state.state[MODE])
        for i in range(mode_state.held_correction.shape[0]):
            mode_state.held_correction[i] = where(correcting > 0.0, x[i], mode_state.held_correction[i])


@jit
def _may_start(state, rules):
    """Return 1 where the filter may start: it has not stopped, or its rules permit a restart after this error."""
    is_permitted = where(state[MODE] == STOPPED, 0.0, 1.0)
    for error in range(3):
        is_permitted = where(state[STOP_REASON] == LOSS_PERSISTS + error, rules.restarts[error], is_permitted)
    return is_permitted


@jit
def check_measurements(mode_state, rules, differences, model, signals, epoch, z, n_row):
    """Check the sample of an epoch: set `mode_state.sample` and count successive good samples.

    While the filter runs, a sample is wild if a residual exceeds its limit. Before a start there is no estimate, so
    the sample is compared with the previous one.

    Parameters
    ----------
    mode_state : ModeState, whose `predicted_innovation` is the prediction of z by the error state
    rules : ModeRules
    differences : DifferenceProcessing, or None
    model, signals : FilterModel, Signals
    epoch : index
    z : (n_row,) measured minus predicted by the inertial system alone; not read if the sample fails the checks at the
        input
    n_row : number of rows of the receiver
    """
    state = mode_state.state
    zero = number_like(state[MODE], 0.0)
    if not rules.is_good[epoch]:
        state[COUNT] = zero
        mode_state.sample[0] = zero
        mode_state.sample[1] = zero
        return
    is_wild = zero
    is_inconsistent = zero
    for row in range(n_row):
        channel = receiver_channel(model, signals, epoch, row)
        if not is_present(differences, model, epoch, channel):
            continue
        limit = rules.residual_limits[channel]
        residual = z[row] - mode_state.predicted_innovation[row]
        is_wild = where(magnitude(residual) <= limit, is_wild, 1.0)
        # before a start only the previous sample predicts this one: the inertial error changes little in between
        previous_innovation = mode_state.previous_innovation[channel]
        has_previous = previous_innovation == previous_innovation
        change = z[row] - where(has_previous, previous_innovation, z[row])
        is_inconsistent = where(magnitude(change) <= limit, is_inconsistent, 1.0)
        mode_state.previous_innovation[channel] = z[row]
    is_inconsistent = where(state[COUNT] > 0.0, is_inconsistent, 0.0)
    state[COUNT] = where(is_inconsistent > 0.0, 1.0, state[COUNT] + 1.0)
    running = is_running(state[MODE])
    is_ready = where(state[COUNT] >= rules.start_after, 1.0, 0.0)
    mode_state.sample[0] = running * (1.0 - is_wild)
    mode_state.sample[1] = (1.0 - running) * is_ready * _may_start(state, rules)


@jit
def _nav_state(row):
    """Return the state that a scalar of the solution measures: position (0 to 2), velocity (3 to 5)."""
    return POS + row if row < 3 else VEL + row - 3


@jit
def start_filter(P, x, mode_state, rules, z):
    """Set error state and covariance of the runs whose filter starts at this epoch.

    With `rules.from_gnss` the sample itself is the initial position and velocity, with the variances in
    `mode_state.predicted_innovation` (6,) and no correlation with other states. Otherwise the sample is processed as a
    measurement.

    Parameters
    ----------
    P, x : (n, n) covariance and (n,) error state, updated in place
    mode_state, rules : ModeState, ModeRules
    z : (6,) measured minus predicted by the inertial system alone
    """
    is_starting = mode_state.sample[1] > 0.0
    n = rules.start_covariance.shape[0]
    for i in range(n):
        x[i] = where(is_starting, 0.0, x[i])
        for j in range(n):
            P[i, j] = where(is_starting, rules.start_covariance[i, j], P[i, j])
    if not rules.from_gnss:
        mode_state.sample[0] = where(is_starting, 1.0, mode_state.sample[0])
        return
    for row in range(N_SPREAD):
        state = _nav_state(row)
        x[state] = where(is_starting, z[row], x[state])
        for j in range(n):
            P[state, j] = where(is_starting, 0.0, P[state, j])
            P[j, state] = where(is_starting, 0.0, P[j, state])
        P[state, state] = where(is_starting, mode_state.predicted_innovation[row], P[state, state])


@jit
def _covariance_error(P, rules):
    """Return 1 where a variance of position or velocity exceeds its limit, is not positive or is not a number."""
    error = number_like(P[0, 0], 0.0)
    for row in range(N_SPREAD):
        state = _nav_state(row)
        variance = P[state, state]
        is_allowed = (variance > 0.0) & (variance <= rules.variance_limits[row])
        error = where(is_allowed, error, 1.0)
    return error


@jit
def _transition_reason(previous_mode, mode, stop_reason):
    """Return the reason of a mode transition, 0 without a transition; a stop has the reason `stop_reason`."""
    reason = where(mode == CONVERGING, GOOD_SAMPLES, DATA_LOST)
    aiding_reason = where(previous_mode == CONVERGING, CONVERGED, DATA_AGAIN)
    reason = where(mode == AIDING, aiding_reason, reason)
    reason = where(mode == STOPPED, stop_reason, reason)
    return where(mode == previous_mode, 0.0, reason)


@jit
def update_mode(mode_state, rules, epoch, P):
    """Set the mode of the filter from this epoch on, and log mode and reason.

    Called after the sample was processed or rejected. P (n, n) is the covariance after the update.
    """
    state = mode_state.state
    is_accepted = mode_state.sample[0]
    is_starting = mode_state.sample[1] > 0.0
    previous_mode = state[MODE]
    is_good = rules.is_good[epoch]
    bad_covariance = _covariance_error(P, rules)
    # a filter that starts at this epoch counts as running and converging from here on
    running = where(is_starting, 1.0, is_running(previous_mode))
    mode = where(is_starting, CONVERGING, previous_mode)
    state[RUN_TIME] = where(is_starting, 0.0, state[RUN_TIME] + rules.interval)
    good_sample = where(is_starting, 1.0, is_accepted)
    error_free_sample = where(bad_covariance > 0.0, 0.0, good_sample)
    has_error = running * (1.0 - error_free_sample) > 0.0
    state[ERROR_TIME] = where(has_error, state[ERROR_TIME] + rules.interval, 0.0)
    # with a good sample converging becomes aiding after a delay, and predicting becomes aiding; without a good sample
    # converging becomes waiting, and aiding becomes predicting
    if is_good:
        is_correction_due = (
            (state[RUN_TIME] >= rules.correct_after) & (is_accepted > 0.0) & (previous_mode == CONVERGING)
        )
        is_resumed = (previous_mode == PREDICTING) & (is_accepted > 0.0)
        mode = where(is_correction_due, AIDING, mode)
        mode = where(is_resumed, AIDING, mode)
    else:
        mode = where(previous_mode == CONVERGING, WAITING, mode)
        mode = where(previous_mode == AIDING, PREDICTING, mode)
    has_persistent_error = (state[ERROR_TIME] >= rules.stop_after) & (is_running(mode) > 0.0)
    mode = where(has_persistent_error, STOPPED, mode)
    stop_reason = where(bad_covariance > 0.0, COVARIANCE_PERSISTS, RESIDUAL_PERSISTS if is_good else LOSS_PERSISTS)
    previous_reason = where(is_starting, 0.0, state[STOP_REASON])
    state[STOP_REASON] = where(has_persistent_error, stop_reason, previous_reason)
    state[MODE] = mode
    mode_state.mode[epoch] = mode
    mode_state.reason[epoch] = _transition_reason(previous_mode, mode, stop_reason)
