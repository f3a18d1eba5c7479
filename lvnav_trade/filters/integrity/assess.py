"""Detection, isolation and recovery in one epoch, of one run or of eight at once, before its update.

Detection: normalised innovations of the prediction, one by one and summed over a window. What is detected is isolated
by the ranges alone: if a fit of position and clock leaves residuals beyond chance, single satellites are excluded, the
worst first; if it does not, its shift of position and that of the clock, each over its own covariance, say whether the
inertial solution or the clock has failed (Trigo and Theil, section 6.3 and figure 13). A solution has no redundancy:
what disagrees with it for as long as the hold time is taken for a failure of the inertial solution.
"""

from lvnav_trade.filters.delayed import is_present
from lvnav_trade.filters.ekf import channel_of, n_measured
from lvnav_trade.filters.integrity.fit import fit, invert, limit
from lvnav_trade.filters.integrity.state import N_FIT
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.observables.base import H_POS, H_VEL
from lvnav_trade.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL


@jit
def _innovation_variance(P, h, entries, columns):
    total = like(P[0, 0], 0.0)
    for i in range(columns.shape[0]):
        for j in range(columns.shape[0]):
            total = total + h[entries[i]] * P[columns[i], columns[j]] * h[entries[j]]
    return total


@jit
def _test_rows(own, tests, P, H, z, whitened, delayed, model, signals, epoch, n_row):
    """Test every row that is in use; return 1 where one of them is beyond its limits."""
    fails, zero = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
    at = epoch % tests.window
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        own.weight[row], own.square[row], own.stat[row] = zero, zero, zero
        if not model.measured[channel] or not is_present(delayed, model, epoch, channel):
            continue
        n = model.n_entry[channel]
        entries, columns = model.entry[channel, :n], model.column[channel, :n]
        variance = 1.0 if whitened else signals.variance[epoch, channel]
        s = _innovation_variance(P, H[row], entries, columns) + own.spread[row] + variance
        in_use = (own.out[channel] <= 0.0) & (z[row] == z[row])
        square = where(in_use, z[row] * z[row] / s, 0.0)
        own.past[channel, at], own.square[row] = square, square
        own.weight[row] = where(in_use, 1.0 / variance, 0.0)
        total = zero
        for k in range(own.past.shape[1]):
            total = total + own.past[channel, k]
        fails = where((square > tests.single) | (total > tests.windowed), 1.0, fails)
    return fails


@jit
def _exclude(own, tests, wanted, n_kind, epoch, channel):
    """Exclude the satellite of a channel in the runs that want it (1)."""
    first = channel - channel % n_kind
    for c in range(first, first + n_kind):
        own.out[c] = where(wanted > 0.0, tests.hold, own.out[c])
        own.excluded[epoch, c] = where(wanted > 0.0, 1.0, own.excluded[epoch, c])
        for k in range(own.past.shape[1]):
            own.past[c, k] = where(wanted > 0.0, 0.0, own.past[c, k])


@jit
def _isolate_satellites(own, tests, H, z, fails, first, kind, model, signals, epoch, n_row):
    """Exclude satellites whose residuals a fit of the others does not explain; return 1 where some were, and whether
    what is left agrees (1).
    """
    found, agrees = like(fails, 0.0), like(fails, 0.0)
    for attempt in range(tests.exclusions + 1):
        square, dof = fit(own, H, z, first, kind, model.n_kind, n_row)
        beyond = where(square > limit(tests.consistent, dof), 1.0, 0.0)
        agrees = where((dof >= 0.0) & (beyond == 0.0), 1.0, 0.0)
        if attempt < tests.exclusions:
            worst = like(fails, 0.0)
            for row in range(kind, n_row, model.n_kind):
                worst = where(own.stat[row] > worst, own.stat[row], worst)
            wanted = where((fails > 0.0) & (beyond > 0.0) & (dof >= 2.0), 1.0, 0.0)
            found = where(wanted > 0.0, 1.0, found)
            for row in range(kind, n_row, model.n_kind):
                this = where((wanted > 0.0) & (own.stat[row] == worst) & (own.weight[row] > 0.0), 1.0, 0.0)
                base = row - kind
                for k in range(model.n_kind):
                    own.weight[base + k] = where(this > 0.0, 0.0, own.weight[base + k])
                _exclude(own, tests, this, model.n_kind, epoch, channel_of(model, signals, epoch, row))
    return found, agrees


@jit
def _left(own, tests, model, signals, epoch, n_row):
    """Return 1 where a row that is still in use is beyond its limits."""
    fails = like(own.fit[0], 0.0)
    for row in range(n_row):
        channel, total = channel_of(model, signals, epoch, row), like(own.fit[0], 0.0)
        for k in range(own.past.shape[1]):
            total = total + own.past[channel, k]
        beyond = (own.square[row] > tests.single) | (total > tests.windowed)
        fails = where((own.weight[row] > 0.0) & beyond, 1.0, fails)
    return fails


@jit
def _shift_square(own, P, at):
    """Return the square of the fitted shift of three states over its covariance, prediction and fit together."""
    for i in range(N_FIT):
        for j in range(N_FIT):
            own.A[i, j] = like(own.fit[0], 1.0 if i == j else 0.0)
    # the fourth row and column stay those of the identity: the inverse of the first three is that of their block
    for i in range(3):
        for j in range(3):
            own.A[i, j] = P[at + i, at + j] + own.inverse[i, j]
    invert(own.inverse, own.A)
    total = like(own.fit[0], 0.0)
    for i in range(3):
        for j in range(3):
            total = total + own.fit[i] * own.inverse[i, j] * own.fit[j]
    return total


@jit
def _compare(own, tests, P, fails, at, clock):
    """Return 1 where the shift of three states, and 1 where that of the clock's state, is beyond its limit; their sizes
    squared.
    """
    offset = own.fit[3] * own.fit[3]
    of_clock = where((fails > 0.0) & (offset > tests.offset * (P[clock, clock] + own.inverse[3, 3])), 1.0, 0.0)
    size = own.fit[0] * own.fit[0] + own.fit[1] * own.fit[1] + own.fit[2] * own.fit[2]
    of_motion = where((fails > 0.0) & (_shift_square(own, P, at) > tests.shift), 1.0, 0.0)
    return of_motion, of_clock, size, offset


@jit
def _inflate(P, at, count, wanted, variance):
    for i in range(count):
        P[at + i, at + i] = P[at + i, at + i] + where(wanted > 0.0, variance, 0.0)


@jit
def _forget(own, wanted):
    """Forget past innovations in the runs that want it (1): they were of what has been corrected."""
    for c in range(own.past.shape[0]):
        for k in range(own.past.shape[1]):
            own.past[c, k] = where(wanted > 0.0, 0.0, own.past[c, k])


@jit
def _assess_ranges(own, tests, P, H, z, model, signals, epoch, n_row, fails):
    """Isolate what has failed by the ranges and range rates of an epoch, and recover."""
    factor, clock = tests.recovery * tests.recovery, model.clock
    isolated = like(fails, 0.0)
    for kind in range(2):
        first, at = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        found, agrees = _isolate_satellites(own, tests, H, z, fails, first, kind, model, signals, epoch, n_row)
        isolated = where(found > 0.0, OF_CHANNEL, isolated)
        left = _left(own, tests, model, signals, epoch, n_row) * agrees * fails
        motion, of_clock, size, offset = _compare(own, tests, P, left, at, clock + kind)
        isolated = where(of_clock > 0.0, OF_CLOCK, isolated)
        isolated = where((motion > 0.0) & (of_clock == 0.0), OF_INERTIAL, isolated)
        _inflate(P, at, 3, motion, factor * size)
        _inflate(P, clock + kind, 1, of_clock, factor * offset)
    # neither a satellite alone nor what they have in common: rows that are beyond their limits are left out
    alone = where(isolated == 0.0, fails, 0.0)
    for row in range(n_row):
        this = where((alone > 0.0) & (own.square[row] > tests.single), 1.0, 0.0)
        _exclude(own, tests, this, model.n_kind, epoch, channel_of(model, signals, epoch, row))
        isolated = where(this > 0.0, OF_CHANNEL, isolated)
    _forget(own, where(isolated > OF_CHANNEL, 1.0, 0.0))
    return isolated


@jit
def _assess_solution(own, tests, P, fails, n_channel):
    """Leave a solution out that the prediction disagrees with; once it has for the hold time, inflate position and
    velocity by its normalised innovation instead.
    """
    own.waited[0] = where(fails > 0.0, own.waited[0] + 1.0, 0.0)
    over, worst = where(own.waited[0] >= tests.hold, 1.0, 0.0), like(fails, 0.0)
    for row in range(6):
        worst = where(own.square[row] > worst, own.square[row], worst)
    growth = where(over > 0.0, tests.recovery * tests.recovery * worst, 0.0)
    for i in range(3):
        P[POS + i, POS + i] = P[POS + i, POS + i] * (1.0 + growth)
        P[VEL + i, VEL + i] = P[VEL + i, VEL + i] * (1.0 + growth)
    for c in range(n_channel):
        own.out[c] = where((fails > 0.0) & (over == 0.0), 1.0, own.out[c])
    _forget(own, over)
    own.waited[0] = where(over > 0.0, 0.0, own.waited[0])
    return where(over > 0.0, OF_INERTIAL, where(fails > 0.0, OF_CHANNEL, 0.0))


@jit
def assess(own, tests, P, H, z, running, whitened, delayed, model, signals, epoch):
    """Test the receiver's rows of an epoch, exclude or inflate what failed, and log it (Monitor and Tests, or None).

    Parameters
    ----------
    P : (n, n) predicted covariance, inflated where something is recovered; H, z : rows, measured minus predicted
    running : 1 in the runs whose filter runs; whitened : the rows are decorrelated, of variance one
    """
    if own is not None:
        own.isolated[epoch] = like(own.fit[0], 0.0)
        for c in range(own.out.shape[0]):
            own.out[c] = where(own.out[c] > 0.0, own.out[c] - 1.0, 0.0)
            own.excluded[epoch, c] = like(own.fit[0], 0.0)
        n_row = n_measured(model, signals, epoch)
        if n_row > 0:
            fails = running * _test_rows(own, tests, P, H, z, whitened, delayed, model, signals, epoch, n_row)
            if model.tight:
                isolated = _assess_ranges(own, tests, P, H, z, model, signals, epoch, n_row, fails)
            else:
                isolated = _assess_solution(own, tests, P, fails, model.n_receiver)
            own.isolated[epoch] = isolated
