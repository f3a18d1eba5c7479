"""Detection, isolation and recovery in one epoch, of one run or of eight at once, before its update.

Detection: normalised innovations of the prediction, one by one and summed over a window. What is detected is isolated
by the ranges: if a fit of position and clock leaves residuals beyond chance, single satellites are excluded, the
largest innovation first; if it does not, its shift of position and that of the clock, each over its own covariance, say
whether the inertial solution or the clock has failed (Trigo and Theil, section 6.3 and figure 13). A solution has no
redundancy: what disagrees with it for as long as the hold time is taken for a failure of the inertial solution.
"""

from lvnav_trade.filters.delayed import is_present
from lvnav_trade.filters.ekf import channel_of, n_measured
from lvnav_trade.filters.integrity.fit import fit, invert, limit
from lvnav_trade.filters.integrity.state import N_FIT, forget
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, POS, VEL
from lvnav_trade.observables.base import H_POS, H_VEL
from lvnav_trade.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL

RETURNING = 0.5
"""Value of `out` where the hold time of a channel is over: the channel is used again if it passes its test."""
N_PERSISTENT = 3.0
"""Number of successive inertial decisions, each within the hold time of the one before, from which on an error of the
unit is taken for persistent."""


@jit
def _innovation_variance(P, h, entries, columns):
    total = like(P[0, 0], 0.0)
    for i in range(columns.shape[0]):
        for j in range(columns.shape[0]):
            total = total + h[entries[i]] * P[columns[i], columns[j]] * h[entries[j]]
    return total


@jit
def _test_rows(own, tests, P, H, z, delayed, model, signals, epoch, n_row):
    """Set the squared normalised innovation of every row that is in use, or may be again, and its inverse variance."""
    zero = like(P[0, 0], 0.0)
    at = epoch // model.every % tests.window
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        own.weight[row], own.square[row] = zero, zero
        if not model.measured[channel] or not is_present(delayed, model, epoch, channel):
            continue
        n = model.n_entry[channel]
        entries, columns = model.entry[channel, :n], model.column[channel, :n]
        s = _innovation_variance(P, H[row], entries, columns) + own.variance[row]
        in_use = (own.out[channel] <= RETURNING) & (z[row] == z[row])
        square = where(in_use, z[row] * z[row] / s, 0.0)
        own.past[channel, at], own.square[row] = square, square
        own.weight[row] = where(in_use, 1.0 / own.variance[row], 0.0)


@jit
def _count_down(own, ends):
    """Let an epoch of every hold time pass; `ends` is what is set where it is over."""
    for c in range(own.out.shape[0]):
        out = own.out[c]
        own.out[c] = where(out > 1.0, out - 1.0, where(out == 1.0, ends, 0.0))


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
    """Exclude satellites while a fit to the rows of a kind leaves residuals beyond chance; return 1 where some were,
    and whether what is left agrees (1).

    Which one: the largest innovation. The residuals of the fit say that a satellite has failed, but of two failures
    the largest is often that of a sound one.
    """
    found, agrees = like(fails, 0.0), like(fails, 0.0)
    for attempt in range(tests.exclusions + 1):
        square, dof = fit(own, H, z, first, kind, model.n_kind, n_row)
        beyond = where(square > limit(tests.consistent, dof), 1.0, 0.0)
        agrees = where((dof >= 0.0) & (beyond == 0.0), 1.0, 0.0)
        if attempt < tests.exclusions:
            worst = like(fails, 0.0)
            for row in range(kind, n_row, model.n_kind):
                square = where(own.weight[row] > 0.0, own.square[row], 0.0)
                worst = where(square > worst, square, worst)
            wanted = where((fails > 0.0) & (beyond > 0.0) & (dof >= 1.0), 1.0, 0.0)
            found = where(wanted > 0.0, 1.0, found)
            for row in range(kind, n_row, model.n_kind):
                this = where((wanted > 0.0) & (own.square[row] == worst) & (own.weight[row] > 0.0), 1.0, 0.0)
                _exclude_row(own, tests, this, model, signals, epoch, row)
    return found, agrees


@jit
def _exclude_row(own, tests, wanted, model, signals, epoch, row):
    """Exclude the satellite of a row, all its rows, in the runs that want it (1)."""
    base = row - row % model.n_kind
    for k in range(model.n_kind):
        own.weight[base + k] = where(wanted > 0.0, 0.0, own.weight[base + k])
    _exclude(own, tests, wanted, model.n_kind, epoch, channel_of(model, signals, epoch, row))


@jit
def _readmit(own, tests, running, model, signals, epoch, n_row):
    """Exclude satellites whose hold time is over and that the prediction still disagrees with; use the others again.
    Return 1 where some are excluded: a satellite that has failed does not return into the fit of the sound ones. With
    fewer than five of these the prediction may be what is wrong, and all return.
    """
    again, sound = like(own.fit[0], 0.0), like(own.fit[0], 0.0)
    for row in range(0, n_row, model.n_kind):
        sound = where(own.out[channel_of(model, signals, epoch, row)] == 0.0, sound + 1.0, sound)
    for row in range(n_row):
        returning = own.out[channel_of(model, signals, epoch, row)] == RETURNING
        wanted = returning & (running > 0.0) & (sound > N_FIT) & (own.square[row] > tests.single)
        this = where(wanted, 1.0, 0.0)
        _exclude_row(own, tests, this, model, signals, epoch, row)
        again = where(this > 0.0, 1.0, again)
    for c in range(own.out.shape[0]):
        own.out[c] = where(own.out[c] == RETURNING, 0.0, own.out[c])
    return again


@jit
def _left(own, tests, model, signals, epoch, kind, n_row):
    """Return 1 where a row of a kind that is in use is beyond its limits; kind -1: any row. Carrier phases, and
    differences, count among either kind.
    """
    fails = like(own.fit[0], 0.0)
    for row in range(n_row):
        own_kind = row % model.n_kind if model.tight else -1
        if kind >= 0 and own_kind != kind and own_kind < 2:
            continue
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
def _persists(own, tests, P, model, inertial, speed):
    """Count successive inertial decisions, each within the hold time of the one before. From the third on the error of
    the unit persists: the variances of the accelerometer biases grow by the shift of velocity over an interval.
    """
    left, count = own.waited[0], own.waited[1]
    count = where(left > 0.0, count, 0.0) + inertial
    own.waited[0] = where(inertial > 0.0, tests.hold, where(left > 0.0, left - 1.0, 0.0))
    own.waited[1] = count
    wanted = where((inertial > 0.0) & (count >= N_PERSISTENT), 1.0, 0.0)
    size = tests.recovery / tests.interval
    for b in range(model.par_offset.shape[0]):
        if model.par_sensor[b] == ACCEL and model.par_driver[b] == CONSTANT and model.par_offset[b] < model.n_estimated:
            _inflate(P, model.par_offset[b], 3, wanted, size * size * speed)


@jit
def _assess_ranges(own, tests, P, H, z, running, model, signals, epoch, n_row):
    """Isolate what has failed by the ranges and range rates of an epoch, and recover. Range rates come first: what they
    show of velocity or drift is looked for in position or bias too.
    """
    factor, clock = tests.recovery * tests.recovery, model.clock
    again = _readmit(own, tests, running, model, signals, epoch, n_row)
    fails = running * _left(own, tests, model, signals, epoch, -1, n_row)
    zero = like(fails, 0.0)
    isolated, seen_motion, seen_clock, speed = zero, zero, zero, zero
    for step in range(2):
        kind = 1 - step
        first, at = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        found, agrees = _isolate_satellites(own, tests, H, z, fails, first, kind, model, signals, epoch, n_row)
        isolated = where((found > 0.0) & (isolated == 0.0), OF_CHANNEL, isolated)
        left = _left(own, tests, model, signals, epoch, kind, n_row)
        motion, of_clock, size, offset = _compare(own, tests, P, agrees * fails, at, clock + kind)
        motion, of_clock = motion * where(seen_motion > 0.0, 1.0, left), of_clock * where(seen_clock > 0.0, 1.0, left)
        seen_clock = where(of_clock > 0.0, 1.0, seen_clock)
        seen_motion = where((motion > 0.0) & (of_clock == 0.0), 1.0, seen_motion)
        _inflate(P, at, 3, motion, factor * size)
        _inflate(P, clock + kind, 1, of_clock, factor * offset)
        speed = where(motion > 0.0, size, zero) if kind == 1 else speed
    isolated = where(seen_clock > 0.0, OF_CLOCK, where(seen_motion > 0.0, OF_INERTIAL, isolated))
    _persists(own, tests, P, model, where(isolated == OF_INERTIAL, 1.0, 0.0), speed)
    # neither a satellite alone nor what they have in common: rows that are beyond their limits are left out
    alone = where(isolated == 0.0, fails, 0.0)
    for row in range(n_row):
        this = where((alone > 0.0) & (own.square[row] > tests.single) & (own.weight[row] > 0.0), 1.0, 0.0)
        _exclude(own, tests, this, model.n_kind, epoch, channel_of(model, signals, epoch, row))
        isolated = where(this > 0.0, OF_CHANNEL, isolated)
    forget(own, where(isolated > OF_CHANNEL, 1.0, 0.0))
    return where((isolated == 0.0) & (again > 0.0), OF_CHANNEL, isolated)


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
    forget(own, over)
    own.waited[0] = where(over > 0.0, 0.0, own.waited[0])
    return where(over > 0.0, OF_INERTIAL, where(fails > 0.0, OF_CHANNEL, 0.0))


@jit
def assess(own, tests, P, H, z, running, delayed, model, signals, epoch):
    """Test the receiver's rows of an epoch, exclude or inflate what failed, and log it (Monitor and Tests, or None).

    Parameters
    ----------
    own : Monitor, whose `variance` is that of the rows; P : (n, n) predicted covariance, inflated where something is
    recovered; H, z : rows, measured minus predicted; running : 1 in the runs whose filter runs
    """
    if own is not None:
        own.isolated[epoch] = like(own.fit[0], 0.0)
        for c in range(own.out.shape[0]):
            own.excluded[epoch, c] = like(own.fit[0], 0.0)
        _count_down(own, RETURNING if model.tight else 0.0)
        n_row = n_measured(model, signals, epoch)
        if n_row > 0:
            _test_rows(own, tests, P, H, z, delayed, model, signals, epoch, n_row)
            if model.tight:
                isolated = _assess_ranges(own, tests, P, H, z, running, model, signals, epoch, n_row)
            else:
                fails = running * _left(own, tests, model, signals, epoch, -1, n_row)
                isolated = _assess_solution(own, tests, P, fails, model.n_receiver)
            own.isolated[epoch] = isolated
