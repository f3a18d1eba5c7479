"""What a simulation run leaves at a history time: errors (truth minus estimate), sigmas, NEES, failure."""

from __future__ import annotations

from lvnav_trade.filters.feedforward import apply_correction, remove_correction
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.covariance import normalised_square
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, sqrt, where
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.kernels.transition import ATT, CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2, POS, VEL
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.receivers.base import BIAS as RX_BIAS
from lvnav_trade.receivers.base import DRIFT as RX_DRIFT
from lvnav_trade.receivers.base import N_STATE as N_RX
from lvnav_trade.receivers.base import POS as RX_POS
from lvnav_trade.receivers.base import VEL as RX_VEL

N_SAMPLE_OUTPUT = 12
"""Outputs beside the states: errors of the IMU's samples of rate and specific force, raw and corrected."""


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
def _turned(P, at, c0, c1, c2):
    """Return the sigma of a block's component along a direction (c0, c1, c2)."""
    a = P[at, at] * c0 * c0 + P[at + 1, at + 1] * c1 * c1 + P[at + 2, at + 2] * c2 * c2
    b = P[at, at + 1] * c0 * c1 + P[at, at + 2] * c0 * c2 + P[at + 1, at + 2] * c1 * c2
    return sqrt(a + 2.0 * b)


@jit
def _extra_errors(work, shared, model):
    """Set the errors of the filter's extra states: the true errors that they stand for, as of the last epoch, minus the
    estimates.
    """
    for e in range(model.extra_offset.shape[0]):
        work.x[model.extra_offset[e]] = -work.extra[e]
    for m in range(shared.extra.shape[0]):
        if shared.extra[m] >= 0:
            at = model.extra_offset[shared.extra[m]]
            work.x[at] = work.x[at] + work.shared[m]


@jit
def _record_states(work, history, shared, model, hist):
    """Write errors (truth minus estimate), the filter's sigma and NEES at a history time, in reporting axes."""
    nav, x = work.nav, work.x
    q = history.q[hist]
    x[ATT], x[ATT + 1], x[ATT + 2] = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]
    for b in range(model.par_offset.shape[0]):
        for i in range(3):
            true = true_parameter(work.true_tables, model.par_sensor[b], model.par_driver[b], i)
            x[model.par_offset[b] + i] = true - work.par[b, i]
    if model.clock >= 0:
        # the true clock steps at epochs; between them its bias moves on by its drift
        x[model.clock] = work.clock[0] + history.since[hist] * work.clock[1] - work.clock_hat[0]
        x[model.clock + 1] = work.clock[1] - work.clock_hat[1]
    _extra_errors(work, shared, model)
    c = matrix(q[0], q[1], q[2], q[3])
    axes = history.axes[hist]
    for i in range(3):
        work.err[hist, ATT + i] = c[i] * x[ATT] + c[3 + i] * x[ATT + 1] + c[6 + i] * x[ATT + 2]
        work.sigma[hist, ATT + i] = _turned(work.P, ATT, c[i], c[3 + i], c[6 + i])
        for at in (VEL, POS):
            work.err[hist, at + i] = axes[i, 0] * x[at] + axes[i, 1] * x[at + 1] + axes[i, 2] * x[at + 2]
            work.sigma[hist, at + i] = _turned(work.P, at, axes[i, 0], axes[i, 1], axes[i, 2])
    for i in range(9, model.n_state):
        work.err[hist, i] = x[i]
        work.sigma[hist, i] = sqrt(work.P[i, i])
    work.nees[hist] = normalised_square(work.P, work.X, work.K, x, model.n_estimated)
    _check(work, history, hist)
    for i in range(model.n_state):
        x[i] = like(x[i], 0.0)


@jit
def _check(work, history, hist):
    """Mark a run whose position error is not finite (1) or beyond the limit (2), with the time when it was first so."""
    x, failed = work.x, work.failed[0]
    square = x[POS] * x[POS] + x[POS + 1] * x[POS + 1] + x[POS + 2] * x[POS + 2] + 0.0 * work.P[ATT, ATT]
    good = square <= history.limit * history.limit
    code = where(square > history.limit * history.limit, 2.0, 1.0)
    now = where(good, failed, where(failed > 0.0, failed, code))
    work.t_failed[0] = where((now > 0.0) & (failed == 0.0), history.t[hist], work.t_failed[0])
    work.failed[0] = now


@jit
def _motion_errors(work, vehicle, tick):
    """Set the errors of the states of the vehicle's motion: those of the tick that ends here."""
    if vehicle is not None:
        for i in range(3):
            work.x[vehicle.motion + i] = vehicle.rate[tick, i] - work.motion.rate[i]
            work.x[vehicle.motion + 3 + i] = vehicle.force[tick, i] - work.motion.force[i]


@jit
def _record_samples(work, samples, model, tick, hist):
    """Write the errors of the last samples of rate and specific force: raw, and corrected by the estimated bias."""
    if samples is not None:
        n = model.n_state
        for i in range(N_SAMPLE):
            true = samples.rate[tick, i % 3] if i < 3 else samples.force[tick, i % 3]
            error = true - work.motion.sample[i]
            work.err[hist, n + i] = error
            work.sigma[hist, n + i] = sqrt(like(error, samples.raw[i]))
            block, state = samples.par[i // 3], samples.bias[i]
            variance = like(error, samples.raw[i])
            if state >= 0:
                error = error + work.par[block, i % 3]
                variance = work.P[state, state] + samples.variance[i]
            work.err[hist, n + 6 + i] = error
            work.sigma[hist, n + 6 + i] = sqrt(variance)


@jit
def _own_error(work, filtering, point_model, point):
    """Set the error of the receiver's own estimate, frame i, where there is a solution, and its own covariance."""
    rx, held = work.rx, work.held
    valid = rx.solution[0] == rx.solution[0]
    for i in range(N_RX):
        for j in range(N_RX):
            if filtering is not None:
                held.covariance[i, j] = where(valid, rx.P[i, j], held.covariance[i, j])
    if filtering is None:
        for i in range(4):
            a, b = RX_POS + i if i < 3 else RX_BIAS, RX_VEL + i if i < 3 else RX_DRIFT
            for j in range(4):
                c, d = RX_POS + j if j < 3 else RX_BIAS, RX_VEL + j if j < 3 else RX_DRIFT
                inverse = rx.inverse[i, j]
                held.covariance[a, c] = where(valid, point_model.range_variance * inverse, held.covariance[a, c])
                held.covariance[b, d] = where(valid, point_model.rate_variance * inverse, held.covariance[b, d])
    for i in range(3):
        place = rx.fix[i] if filtering is None else rx.nav[RX_POS + i]
        speed = rx.fix[3 + i] if filtering is None else rx.nav[RX_VEL + i]
        held.error[RX_POS + i] = where(valid, point[i] - place, held.error[RX_POS + i])
        held.error[RX_VEL + i] = where(valid, point[3 + i] - speed, held.error[RX_VEL + i])
    bias = rx.fix[6] if filtering is None else rx.nav[RX_BIAS]
    drift = rx.fix[7] if filtering is None else rx.nav[RX_DRIFT]
    held.error[RX_BIAS] = where(valid, work.clock[0] - bias, held.error[RX_BIAS])
    held.error[RX_DRIFT] = where(valid, work.clock[1] - drift, held.error[RX_DRIFT])


@jit
def hold_solution(work, solver, report, epoch):
    """Hold the error of the receiver's last solution, as of its time of validity, and its filter's innovations."""
    if report is not None:
        _own_error(work, solver.filter, solver.point, report.point[epoch])
        if report.own_channels:
            at = report.first_channel
            for i in range(report.n_channel):
                work.innovation[epoch, at + i] = work.rx.innovation[i]


@jit
def _record_solution(work, report, history, model, hist):
    """Write the error of the receiver's last solution in reporting axes: velocity, position, clock."""
    if report is not None:
        held, axes, at = work.held, history.axes[hist], report.first_output
        for block in range(2):
            first = RX_VEL if block == 0 else RX_POS
            for i in range(3):
                c0, c1, c2 = axes[i, 0], axes[i, 1], axes[i, 2]
                e = held.error
                work.err[hist, at + 3 * block + i] = c0 * e[first] + c1 * e[first + 1] + c2 * e[first + 2]
                work.sigma[hist, at + 3 * block + i] = _turned(held.covariance, first, c0, c1, c2)
        for k in range(2):
            state = RX_BIAS + k
            work.err[hist, at + 6 + k] = held.error[state]
            work.sigma[hist, at + 6 + k] = sqrt(held.covariance[state, state])


@jit
def _true_error(work, history, model, hist):
    """Set `misses.error` to truth minus the uncorrected inertial system at a history time, frame i."""
    nav, q, x = work.nav, history.q[hist], work.misses.error[hist]
    x[ATT], x[ATT + 1], x[ATT + 2] = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]
    for b in range(model.par_offset.shape[0]):
        for i in range(3):
            at = model.par_offset[b] + i
            x[at] = true_parameter(work.true_tables, model.par_sensor[b], model.par_driver[b], i)


@jit
def _record_misses(work, misses, history, model, hist):
    """Write the error of the inertial system, and what the filter's transition missed of it since the history time
    before; the error state starts from the error again.
    """
    if misses is not None:
        _true_error(work, history, model, hist)
        for i in range(model.n_state):
            error = work.misses.error[hist, i]
            work.misses.missed[hist, i] = error - work.x[i] if hist > 0 else like(error, 0.0)
            work.x[i] = error


@inlined
def record(work, open_loop, vehicle, samples, report, misses, history, shared, model, tick, hist):
    """Record at a history time: of an open loop the sum of inertial system and error state, which goes nowhere else."""
    if misses is not None:
        _record_misses(work, misses, history, model, hist)
        return
    if open_loop is None:
        _motion_errors(work, vehicle, tick)
        _record_states(work, history, shared, model, hist)
    else:
        apply_correction(work, open_loop, work.watch, model)
        _motion_errors(work, vehicle, tick)
        _record_states(work, history, shared, model, hist)
        remove_correction(work, open_loop, model)
    _record_samples(work, samples, model, tick, hist)
    _record_solution(work, report, history, model, hist)
