"""Mode logic of a filter: when it starts, which measurements it accepts, when it stops and starts again.

The logic of an open-loop filter (Thomas et al., section 5) as a small state machine, one step an epoch, of one run or
of eight at once. What the receiver tells of a sample (flags, freshness, dilution of precision) is the same in every
run and comes in as `Rules.good`; what the filter finds of it (a wild sample, a covariance out of bounds) is each
run's own.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.filters.delayed import is_present
from lvnav_trade.filters.ekf import channel_of
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, magnitude, where, zeros_of
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.records import AIDING, CONVERGING, PREDICTING, STOPPED, WAITING, Bools, Floats

(NONE, GOOD_SAMPLES, CONVERGED, DATA_LOST, DATA_AGAIN, LOSS_PERSISTS, RESIDUAL_PERSISTS, COVARIANCE_PERSISTS) = range(8)
"""Why what it does changes, by number; in words: records.REASONS."""

MODE, COUNT, SINCE, ERROR, WHY = range(5)
"""Where a run's state stands: mode, good samples in a row, seconds since the filter started, seconds since the last
epoch without an error, reason of the last stop.
"""
N_WATCH = 5
N_SPREAD = 6


class Rules(NamedTuple):
    """Rules of the mode logic, as numbers.

    interval : s. Time between epochs.
    good : (n_epoch,). Whether the receiver's sample passes all checks at the input.
    limits : (n_receiver,) SI. Largest residual by receiver channel; infinite for no limit.
    spread : (6,) SI squared. Largest variance of position error and velocity error; infinite for no limit.
    start_after : Good samples in succession before the filter starts.
    correct_after : s after the start. Time from which outputs are corrected; infinite for never.
    stop_after : s. Duration of an error after which the filter stops; infinite for never.
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
    restarts: Floats
    from_gnss: bool
    P: Floats


class Watch(NamedTuple):
    """A run's watch, updated.

    state : (N_WATCH,). What the logic remembers.
    before : (n_receiver,). The sample before by channel, less the inertial prediction; not-a-number: none.
    z : (n_row,). Measured minus predicted by the inertial system alone; in linear covariance its mean.
    predicted : (n_row,). The same as the error state predicts it; of a sample that the filter starts from its variance.
    sample : (2,). Whether the sample of this epoch is used, and whether the filter starts with it.
    mode : (n_epoch,). What the filter does after each epoch.
    reason : (n_epoch,). Why that changed there; 0: it did not.
    """

    state: Floats
    before: Floats
    z: Floats
    predicted: Floats
    sample: Floats
    mode: Floats
    reason: Floats


def new_watch(n_epoch: int, n_receiver: int = 6, n_row: int = 6, lanes: int = 0) -> Watch:
    """Return the arrays of a watch: one run, or `lanes` runs on the last axis."""
    shapes = {
        "state": (N_WATCH,),
        "before": (max(1, n_receiver),),
        "z": (n_row,),
        "predicted": (n_row,),
        "sample": (2,),
        "mode": (n_epoch,),
        "reason": (n_epoch,),
    }
    return Watch(**zeros_of(shapes, lanes))


@jit
def begin_watch(watch):
    """Let a run's filter wait for its first samples, where it has a logic."""
    if watch is not None:
        for i in range(N_WATCH):
            watch.state[i] = like(watch.before[0], 0.0)
        for i in range(watch.before.shape[0]):
            watch.before[i] = like(watch.before[0], np.nan)


@jit
def is_running(mode):
    """Return 1 where the filter runs, 0 where it waits or has stopped."""
    return where((mode == CONVERGING) | (mode == AIDING) | (mode == PREDICTING), 1.0, 0.0)


@jit
def is_correcting(mode):
    """Return 1 where the outputs are corrected, 0 where they are the inertial system's own."""
    return where((mode == AIDING) | (mode == PREDICTING), 1.0, 0.0)


@jit
def check_measurements(watch, rules, delayed, model, signals, epoch, z, n_row):
    """Check an epoch's sample: set `watch.sample`, count good samples in a row.

    Parameters
    ----------
    watch : Watch, with `predicted` set to what the error state predicts of z; rules : Rules
    z : (n_row,) measured minus predicted by the inertial system alone. Not read where the sample fails the checks at
        the input.
    """
    state = watch.state
    zero = like(state[MODE], 0.0)
    if not rules.good[epoch]:
        state[COUNT], watch.sample[0], watch.sample[1] = zero, zero, zero
        return
    wild, apart = zero, zero
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        if not is_present(delayed, model, epoch, channel):
            continue
        limit, before = rules.limits[channel], watch.before[channel]
        wild = where(magnitude(z[row] - watch.predicted[row]) <= limit, wild, 1.0)
        # before the start there is no prediction but the sample before: the inertial error changes little in between
        apart = where(magnitude(z[row] - where(before == before, before, z[row])) <= limit, apart, 1.0)
        watch.before[channel] = z[row]
    apart = where(state[COUNT] > 0.0, apart, 0.0)
    state[COUNT] = where(apart > 0.0, 1.0, state[COUNT] + 1.0)
    running, why = is_running(state[MODE]), state[WHY]
    may = where(state[MODE] == STOPPED, 0.0, 1.0)
    for error in range(3):
        may = where(why == LOSS_PERSISTS + error, rules.restarts[error], may)
    ready = where(state[COUNT] >= rules.start_after, 1.0, 0.0)
    watch.sample[0] = running * (1.0 - wild)
    watch.sample[1] = (1.0 - running) * ready * may


@jit
def start_filter(P, x, watch, rules, z):
    """Set error state and covariance where the filter starts; with `from_gnss` the sample is taken for position and
    velocity as it is, else it is used as any other. `watch.predicted` (6,) holds the variances of its rows then.
    """
    starts = watch.sample[1] > 0.0
    n = rules.P.shape[0]
    for i in range(n):
        x[i] = where(starts, 0.0, x[i])
        for j in range(n):
            P[i, j] = where(starts, rules.P[i, j], P[i, j])
    if not rules.from_gnss:
        watch.sample[0] = where(starts, 1.0, watch.sample[0])
        return
    for row in range(N_SPREAD):
        at = POS + row if row < 3 else VEL + row - 3
        x[at] = where(starts, z[row], x[at])
        for j in range(n):
            P[at, j] = where(starts, 0.0, P[at, j])
            P[j, at] = where(starts, 0.0, P[j, at])
        P[at, at] = where(starts, watch.predicted[row], P[at, at])


@jit
def _covariance_error(P, rules):
    """Return 1 where a variance of position or velocity is out of bounds, or no number."""
    error = like(P[0, 0], 0.0)
    for row in range(N_SPREAD):
        at = POS + row if row < 3 else VEL + row - 3
        error = where((P[at, at] > 0.0) & (P[at, at] <= rules.spread[row]), error, 1.0)
    return error


@jit
def update_mode(watch, rules, epoch, P):
    """Decide, after the sample was processed or not, what the filter does from this epoch on; log it."""
    state, used, starts = watch.state, watch.sample[0], watch.sample[1]
    before, good = state[MODE], rules.good[epoch]
    broken = _covariance_error(P, rules)
    running = where(starts > 0.0, 1.0, is_running(before))
    mode = where(starts > 0.0, CONVERGING, before)
    state[SINCE] = where(starts > 0.0, 0.0, state[SINCE] + rules.interval)
    clean = where(broken > 0.0, 0.0, where(starts > 0.0, 1.0, used))
    state[ERROR] = where(running * (1.0 - clean) > 0.0, state[ERROR] + rules.interval, 0.0)
    if good:
        due = (state[SINCE] >= rules.correct_after) & (used > 0.0) & (before == CONVERGING)
        mode = where(due, AIDING, mode)
        mode = where((before == PREDICTING) & (used > 0.0), AIDING, mode)
    else:
        mode = where(before == CONVERGING, WAITING, mode)
        mode = where(before == AIDING, PREDICTING, mode)
    persists = (state[ERROR] >= rules.stop_after) & (is_running(mode) > 0.0)
    mode = where(persists, STOPPED, mode)
    error = where(broken > 0.0, COVARIANCE_PERSISTS, RESIDUAL_PERSISTS if good else LOSS_PERSISTS)
    state[WHY] = where(persists, error, where(starts > 0.0, 0.0, state[WHY]))
    reason = where(mode == CONVERGING, GOOD_SAMPLES, DATA_LOST)
    reason = where(mode == AIDING, where(before == CONVERGING, CONVERGED, DATA_AGAIN), reason)
    reason = where(mode == STOPPED, error, reason)
    state[MODE] = mode
    watch.mode[epoch] = mode
    watch.reason[epoch] = where(mode == before, 0.0, reason)
