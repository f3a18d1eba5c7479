"""Mode logic of a filter: when it starts, which measurements it accepts, when it stops and starts again.

The logic of an open-loop filter (Thomas et al., section 5) is a state machine with one step per epoch, for one run or
for eight lanes. The checks at the input (flags, freshness, dilution of precision) have the same result in every run and
are in `ModeRules.good`. Residuals and covariance differ from run to run and are checked here.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.ekf import channel_of
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, magnitude, where, zeros_of
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.quantities.records import AIDING, CONVERGING, PREDICTING, STOPPED, WAITING, Bools, Floats

(NONE, GOOD_SAMPLES, CONVERGED, DATA_LOST, DATA_AGAIN, LOSS_PERSISTS, RESIDUAL_PERSISTS, COVARIANCE_PERSISTS) = range(8)
"""Reasons of a mode transition; their texts are in records.REASONS."""

INERTIAL, HELD, PREDICTED = range(3)
"""Outputs after a stop, by number: the inertial system's own, the last correction held, the same propagated."""

MODE, COUNT, SINCE, ERROR, WHY = range(5)
"""Elements of `ModeState.state`: mode, successive good samples, seconds since the filter started, seconds since the
last epoch without an error, reason of the last stop.
"""
N_WATCH = 5
N_SPREAD = 6


class ModeRules(NamedTuple):
    """Rules of the mode logic, as numbers.

    interval : s. Time between epochs.
    good : (n_epoch,). Whether the receiver's sample passes all checks at the input.
    limits : (n_receiver,) SI. Largest residual by receiver channel; infinite for no limit.
    spread : (6,) SI squared. Largest variance of position error and velocity error; infinite for no limit.
    start_after : Good samples in succession before the filter starts.
    correct_after : s after the start. Time from which outputs are corrected; infinite for never.
    stop_after : s. Duration of an error after which the filter stops; infinite for never.
    after_stop : Outputs from a stop until the filter corrects again: `INERTIAL`, `HELD` or `PREDICTED`.
    restarts : (3,). Whether the filter restarts after a persistent data loss, residual error, covariance error.
    from_gnss : Whether position and velocity start from the receiver's sample.
    P : (n, n). Covariance of the filter at a start.
    """

    interval: float
    good: Bools
    limits: Floats
    spread: Floats
    start_after: float
    correct_after: float
    stop_after: float
    after_stop: int
    restarts: Floats
    from_gnss: bool
    P: Floats


class ModeState(NamedTuple):
    """State of the mode logic of a run, updated in place.

    state : (N_WATCH,). Mode, counters and timers, see `MODE`.
    before : (n_receiver,). Previous sample by channel minus the inertial prediction; not-a-number if there is none.
    z : (n_row,). Measured minus predicted by the inertial system alone; in linear covariance its mean.
    predicted : (n_row,). Prediction of z by the error state; at a start from the receiver, the variances of its rows.
    sample : (2,). Whether the sample of this epoch is used, and whether the filter starts with it.
    mode : (n_epoch,). Mode after each epoch.
    reason : (n_epoch,). Reason of a mode transition at the epoch; 0: no transition.
    held : (n_state,). Error state that corrects the outputs while the filter does not; zero for none.
    """

    state: Floats
    before: Floats
    z: Floats
    predicted: Floats
    sample: Floats
    mode: Floats
    reason: Floats
    held: Floats


def new_mode_state(n_epoch: int, n_receiver: int = 6, n_row: int = 6, lanes: int = 0, n_state: int = 1) -> ModeState:
    """Return the arrays of a mode logic: one run, or `lanes` runs on the last axis."""
    shapes = {
        "state": (N_WATCH,),
        "before": (max(1, n_receiver),),
        "z": (n_row,),
        "predicted": (n_row,),
        "sample": (2,),
        "mode": (n_epoch,),
        "reason": (n_epoch,),
        "held": (n_state,),
    }
    return ModeState(**zeros_of(shapes, lanes))


@jit
def begin_mode_logic(mode_state):
    """Reset the mode logic (ModeState, or None) to waiting for the first samples."""
    if mode_state is not None:
        for i in range(N_WATCH):
            mode_state.state[i] = like(mode_state.before[0], 0.0)
        for i in range(mode_state.before.shape[0]):
            mode_state.before[i] = like(mode_state.before[0], np.nan)
        for i in range(mode_state.held.shape[0]):
            mode_state.held[i] = like(mode_state.before[0], 0.0)


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
        for i in range(mode_state.held.shape[0]):
            mode_state.held[i] = where(correcting > 0.0, x[i], mode_state.held[i])


@jit
def _may_start(state, rules):
    """Return 1 where the filter may start: it has not stopped, or its rules permit a restart after this error."""
    permitted = where(state[MODE] == STOPPED, 0.0, 1.0)
    for error in range(3):
        permitted = where(state[WHY] == LOSS_PERSISTS + error, rules.restarts[error], permitted)
    return permitted


@jit
def check_measurements(mode_state, rules, delayed, model, signals, epoch, z, n_row):
    """Check the sample of an epoch: set `mode_state.sample` and count successive good samples.

    While the filter runs, a sample is wild if a residual exceeds its limit. Before a start there is no estimate, so
    the sample is compared with the previous one.

    Parameters
    ----------
    mode_state : ModeState, whose `predicted` is the prediction of z by the error state
    rules : ModeRules
    delayed : DifferenceProcessing, or None
    model, signals : FilterModel, Signals
    epoch : index
    z : (n_row,) measured minus predicted by the inertial system alone; not read if the sample fails the checks at the
        input
    n_row : number of rows of the receiver
    """
    state = mode_state.state
    zero = like(state[MODE], 0.0)
    if not rules.good[epoch]:
        state[COUNT] = zero
        mode_state.sample[0] = zero
        mode_state.sample[1] = zero
        return
    wild = zero
    inconsistent = zero
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        if not is_present(delayed, model, epoch, channel):
            continue
        limit = rules.limits[channel]
        residual = z[row] - mode_state.predicted[row]
        wild = where(magnitude(residual) <= limit, wild, 1.0)
        # before a start only the previous sample predicts this one: the inertial error changes little in between
        before = mode_state.before[channel]
        has_previous = before == before
        change = z[row] - where(has_previous, before, z[row])
        inconsistent = where(magnitude(change) <= limit, inconsistent, 1.0)
        mode_state.before[channel] = z[row]
    inconsistent = where(state[COUNT] > 0.0, inconsistent, 0.0)
    state[COUNT] = where(inconsistent > 0.0, 1.0, state[COUNT] + 1.0)
    running = is_running(state[MODE])
    ready = where(state[COUNT] >= rules.start_after, 1.0, 0.0)
    mode_state.sample[0] = running * (1.0 - wild)
    mode_state.sample[1] = (1.0 - running) * ready * _may_start(state, rules)


@jit
def _nav_state(row):
    """Return the state that a scalar of the solution measures: position (0 to 2), velocity (3 to 5)."""
    return POS + row if row < 3 else VEL + row - 3


@jit
def start_filter(P, x, mode_state, rules, z):
    """Set error state and covariance of the runs whose filter starts at this epoch.

    With `rules.from_gnss` the sample itself is the initial position and velocity, with the variances in
    `mode_state.predicted` (6,) and no correlation with other states. Otherwise the sample is processed as a
    measurement.

    Parameters
    ----------
    P, x : (n, n) covariance and (n,) error state, updated in place
    mode_state, rules : ModeState, ModeRules
    z : (6,) measured minus predicted by the inertial system alone
    """
    starts = mode_state.sample[1] > 0.0
    n = rules.P.shape[0]
    for i in range(n):
        x[i] = where(starts, 0.0, x[i])
        for j in range(n):
            P[i, j] = where(starts, rules.P[i, j], P[i, j])
    if not rules.from_gnss:
        mode_state.sample[0] = where(starts, 1.0, mode_state.sample[0])
        return
    for row in range(N_SPREAD):
        state = _nav_state(row)
        x[state] = where(starts, z[row], x[state])
        for j in range(n):
            P[state, j] = where(starts, 0.0, P[state, j])
            P[j, state] = where(starts, 0.0, P[j, state])
        P[state, state] = where(starts, mode_state.predicted[row], P[state, state])


@jit
def _covariance_error(P, rules):
    """Return 1 where a variance of position or velocity exceeds its limit, is not positive or is not a number."""
    error = like(P[0, 0], 0.0)
    for row in range(N_SPREAD):
        state = _nav_state(row)
        variance = P[state, state]
        is_allowed = (variance > 0.0) & (variance <= rules.spread[row])
        error = where(is_allowed, error, 1.0)
    return error


@jit
def _transition_reason(before, mode, error):
    """Return the reason of a mode transition, 0 without a transition; a stop has the reason `error`."""
    reason = where(mode == CONVERGING, GOOD_SAMPLES, DATA_LOST)
    aiding_reason = where(before == CONVERGING, CONVERGED, DATA_AGAIN)
    reason = where(mode == AIDING, aiding_reason, reason)
    reason = where(mode == STOPPED, error, reason)
    return where(mode == before, 0.0, reason)


@jit
def update_mode(mode_state, rules, epoch, P):
    """Set the mode of the filter from this epoch on, and log mode and reason.

    Called after the sample was processed or rejected. P (n, n) is the covariance after the update.
    """
    state = mode_state.state
    accepted = mode_state.sample[0]
    starts = mode_state.sample[1] > 0.0
    before = state[MODE]
    good = rules.good[epoch]
    bad_covariance = _covariance_error(P, rules)
    # a filter that starts at this epoch counts as running and converging from here on
    running = where(starts, 1.0, is_running(before))
    mode = where(starts, CONVERGING, before)
    state[SINCE] = where(starts, 0.0, state[SINCE] + rules.interval)
    good_sample = where(starts, 1.0, accepted)
    no_error = where(bad_covariance > 0.0, 0.0, good_sample)
    has_error = running * (1.0 - no_error) > 0.0
    state[ERROR] = where(has_error, state[ERROR] + rules.interval, 0.0)
    # with a good sample converging becomes aiding after a delay, and predicting becomes aiding; without a good sample
    # converging becomes waiting, and aiding becomes predicting
    if good:
        due = (state[SINCE] >= rules.correct_after) & (accepted > 0.0) & (before == CONVERGING)
        again = (before == PREDICTING) & (accepted > 0.0)
        mode = where(due, AIDING, mode)
        mode = where(again, AIDING, mode)
    else:
        mode = where(before == CONVERGING, WAITING, mode)
        mode = where(before == AIDING, PREDICTING, mode)
    persists = (state[ERROR] >= rules.stop_after) & (is_running(mode) > 0.0)
    mode = where(persists, STOPPED, mode)
    error = where(bad_covariance > 0.0, COVARIANCE_PERSISTS, RESIDUAL_PERSISTS if good else LOSS_PERSISTS)
    previous_reason = where(starts, 0.0, state[WHY])
    state[WHY] = where(persists, error, previous_reason)
    state[MODE] = mode
    mode_state.mode[epoch] = mode
    mode_state.reason[epoch] = _transition_reason(before, mode, error)
