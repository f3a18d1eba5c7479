"""One flight of one run, or of eight at once: truth corrupts, belief navigates, and they meet in measurements only."""

from __future__ import annotations

from lvnav_trade.engines.sensing import begin, begin_solver, measure_height, observe, sense
from lvnav_trade.filters.belief import INERTIAL, TIGHT
from lvnav_trade.filters.ekf import clear_epoch, predict_window
from lvnav_trade.filters.feedforward import add_up, carry, feed_back, take, take_apart
from lvnav_trade.filters.late import keep
from lvnav_trade.filters.monitor import begin_watch
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.covariance import normalised_square
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, size, sqrt, where
from lvnav_trade.kernels.strapdown import Q, R, V, mechanise
from lvnav_trade.kernels.transition import ATT, CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2, POS, VEL


@jit
def true_parameter(tables, sensor, kind, axis):
    """Return the true value of what a filter's parameter stands for: all true parameters of the same driver."""
    table = tables[sensor]
    if kind == CONSTANT:
        return table[processes.BIAS + axis]
    if OWN_0 <= kind and kind <= OWN_2:
        return table[processes.OWN + 3 * axis + (axis + kind - OWN_0) % 3]
    if OTHER_0 <= kind and kind <= OTHER_2:
        return table[processes.OTHER + 3 * axis + kind - OTHER_0]
    return table[processes.SQUARES + axis]


@jit
def _turned_sigma(work, at, c0, c1, c2):
    """Return the sigma of a block's component along a direction (c0, c1, c2)."""
    P = work.P
    a = P[at, at] * c0 * c0 + P[at + 1, at + 1] * c1 * c1 + P[at + 2, at + 2] * c2 * c2
    b = P[at, at + 1] * c0 * c1 + P[at, at + 2] * c0 * c2 + P[at + 1, at + 2] * c1 * c2
    return sqrt(a + 2.0 * b)


@jit
def _extra_errors(work, shared, belief):
    """Set the errors of the filter's extra states: the true errors that they stand for, as of the last epoch, minus the
    estimates.
    """
    for e in range(belief.extra_offset.shape[0]):
        work.x[belief.extra_offset[e]] = -work.extra[e]
    for m in range(shared.extra.shape[0]):
        if shared.extra[m] >= 0:
            at = belief.extra_offset[shared.extra[m]]
            work.x[at] = work.x[at] + work.shared[m]


@jit
def record(work, history, shared, belief, hist):
    """Write errors (truth minus estimate), the filter's sigma and NEES at a history time, in reporting axes."""
    nav, x = work.nav, work.x
    q = history.q[hist]
    x[ATT], x[ATT + 1], x[ATT + 2] = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]
    for b in range(belief.par_offset.shape[0]):
        for i in range(3):
            true = true_parameter(work.true_tables, belief.par_sensor[b], belief.par_driver[b], i)
            x[belief.par_offset[b] + i] = true - work.par[b, i]
    if belief.clock >= 0:
        # the true clock steps at epochs; between them its bias moves on by its drift
        x[belief.clock] = work.clock[0] + history.since[hist] * work.clock[1] - work.clock_hat[0]
        x[belief.clock + 1] = work.clock[1] - work.clock_hat[1]
    _extra_errors(work, shared, belief)
    c = matrix(q[0], q[1], q[2], q[3])
    axes = history.axes[hist]
    for i in range(3):
        work.err[hist, ATT + i] = c[i] * x[ATT] + c[3 + i] * x[ATT + 1] + c[6 + i] * x[ATT + 2]
        work.sigma[hist, ATT + i] = _turned_sigma(work, ATT, c[i], c[3 + i], c[6 + i])
        for at in (VEL, POS):
            work.err[hist, at + i] = axes[i, 0] * x[at] + axes[i, 1] * x[at + 1] + axes[i, 2] * x[at + 2]
            work.sigma[hist, at + i] = _turned_sigma(work, at, axes[i, 0], axes[i, 1], axes[i, 2])
    for i in range(9, belief.n_state):
        work.err[hist, i] = x[i]
        work.sigma[hist, i] = sqrt(work.P[i, i])
    work.nees[hist] = normalised_square(work.P, work.X, work.K, x, belief.n_estimated)
    _judge(work, history, hist)
    for i in range(belief.n_state):
        x[i] = like(x[i], 0.0)


@jit
def _judge(work, history, hist):
    """Mark a run whose position error is not finite (1) or beyond the limit (2), with the time when it was first so."""
    x, failed = work.x, work.failed[0]
    square = x[POS] * x[POS] + x[POS + 1] * x[POS + 1] + x[POS + 2] * x[POS + 2] + 0.0 * work.P[ATT, ATT]
    good = square <= history.limit * history.limit
    code = where(square > history.limit * history.limit, 2.0, 1.0)
    now = where(good, failed, where(failed > 0.0, failed, code))
    work.t_failed[0] = where((now > 0.0) & (failed == 0.0), history.t[hist], work.t_failed[0])
    work.failed[0] = now


@jit
def _hand_out(work, aside, history, shared, belief, hist):
    """Record at a history time: of an open loop the sum of inertial system and error state, which goes nowhere else."""
    if aside is None:
        record(work, history, shared, belief, hist)
    else:
        add_up(work, aside, work.watch, belief)
        record(work, history, shared, belief, hist)
        take_apart(work, aside, belief)


@inlined
def fly(work, schedule, unit, signals, start, history, belief, options, k0, k1):
    """Fly one run (float64 arrays) or eight (lane views) from start to end; `work` is filled.

    Parameters
    ----------
    work : Work; schedule : Schedule; unit : Unit; signals : Signals; start : Start; history : Record; belief : Belief
    options : Options
    k0, k1 : key words of the campaign's seed
    """
    begin(work, unit, signals, start, belief, k0, k1)
    begin_solver(work, options.solver)
    begin_watch(work.watch)
    tight, dt = belief.kind == TIGHT, unit.dt * belief.group
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            sense(work, unit, first, n_tick, k0, k1)
            processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], belief.lean, unit.dt)
            if belief.group > 1:
                processes.combine(work.increments, n_tick, belief.group)
            mechanise(
                work.nav, work.sums, work.previous, work.increments, n_tick // belief.group, dt, belief.gravity
            )  # fmt: skip
            predict_window(work, belief, schedule.length[w])
            keep(work.past, work.nav, work.previous, options.late, w, dt, belief.gravity)
            carry(work, work.aside, belief, schedule.length[w])
        epoch = schedule.epoch[w]
        if epoch >= 0:
            clear_epoch(work, epoch, size(work.innovation, 1))
        if epoch >= 0 and belief.kind != INERTIAL:
            observe(work, options.solver, signals, tight, epoch, k0, k1)
            measure_height(work, options.altimeter, signals, epoch, k0, k1)
            take(work, options.rules, options.late, options.gains, options.altimeter, belief, signals, epoch, dt)
            feed_back(work, work.aside, belief)
        if schedule.hist[w] >= 0:
            _hand_out(work, work.aside, history, signals.shared, belief, schedule.hist[w])
