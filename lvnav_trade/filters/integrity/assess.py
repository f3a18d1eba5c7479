"""Detection, isolation and recovery in one epoch, of one run or of eight at once, before its update.

Detection: normalised innovations of the prediction, one by one and summed over a window. What is detected is isolated
by the ranges: if a fit of position and clock leaves residuals beyond chance, single satellites are excluded, the
largest innovation first; if it does not, its shift of position and that of the clock, each over its own covariance, say
whether the inertial solution or the clock has failed (Trigo and Theil, section 6.3 and figure 13); if neither is clear,
`common.py` asks whether the satellites disagree with the prediction together, or one alone. A solution has no
redundancy: what disagrees with it for as long as the hold time is taken for a failure of the inertial solution.
"""

from lvnav_trade.filters.delayed import is_present
from lvnav_trade.filters.ekf import channel_of, n_measured
from lvnav_trade.filters.integrity.common import compare, find_common, inflate, learn, persists
from lvnav_trade.filters.integrity.fit import fit, limit
from lvnav_trade.filters.integrity.state import N_FIT, clear_innovations
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.observables.base import H_POS, H_VEL
from lvnav_trade.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL

RETURNING = 0.5
"""Value of `out` where the hold time of a channel is over: the channel is used again if it passes its test."""


@jit
def _innovation_variance(P, h, entries, columns):
    total = like(P[0, 0], 0.0)
    for i in range(columns.shape[0]):
        for j in range(columns.shape[0]):
            total = total + h[entries[i]] * P[columns[i], columns[j]] * h[entries[j]]
    return total


@jit
def _test_rows(own, P, H, case, epoch, n_row):
    """Set the squared normalised innovation of every row that is in use, or may be again, and its inverse variance."""
    zero, z, model, signals = like(P[0, 0], 0.0), own.z, case.model, case.signals
    tests, delayed = case.options.integrity, case.options.delayed
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
def _isolate_satellites(own, H, case, fails, first, kind, epoch, n_row):
    """Exclude satellites while a fit to the rows of a kind leaves residuals beyond chance; return 1 where some were,
    and whether what is left agrees (1).

    Which one: the largest innovation. The residuals of the fit say that a satellite has failed, but of two failures
    the largest is often that of a sound one.
    """
    found, agrees = like(fails, 0.0), like(fails, 0.0)
    tests, model, z = case.options.integrity, case.model, own.z
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
                _exclude_row(own, tests, this, model, case.signals, epoch, row)
    return found, agrees


@jit
def _exclude_row(own, tests, wanted, model, signals, epoch, row):
    """Exclude the satellite of a row, all its rows, in the runs that want it (1)."""
    base = row - row % model.n_kind
    for k in range(model.n_kind):
        own.weight[base + k] = where(wanted > 0.0, 0.0, own.weight[base + k])
    _exclude(own, tests, wanted, model.n_kind, epoch, channel_of(model, signals, epoch, row))


@jit
def _count_out(own, model, signals, epoch, n_row):
    """Return how many satellites are excluded, and how many are not."""
    excluded, used = like(own.fit[0], 0.0), like(own.fit[0], 0.0)
    for row in range(0, n_row, model.n_kind):
        out = own.out[channel_of(model, signals, epoch, row)]
        excluded, used = where(out > 0.0, excluded + 1.0, excluded), where(out > 0.0, used, used + 1.0)
    return excluded, used


@jit
def _readmit(own, tests, running, model, signals, epoch, n_row):
    """Exclude satellites whose hold time is over and that the prediction still disagrees with; use the others again.
    Return 1 where some are excluded: a satellite that has failed does not return into the fit of the sound ones. With
    fewer than five of these, or while an error of the unit persists, the prediction may be what is wrong, and all
    return.
    """
    again = like(own.fit[0], 0.0)
    _, sound = _count_out(own, model, signals, epoch, n_row)
    trusted = where((sound > N_FIT) & (persists(own) == 0.0), running, 0.0)
    for row in range(n_row):
        returning = own.out[channel_of(model, signals, epoch, row)] == RETURNING
        this = where(returning & (trusted > 0.0) & (own.square[row] > tests.single), 1.0, 0.0)
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
def _assess_ranges(own, work, case, running, epoch, n_row):
    """Isolate what has failed by the ranges and range rates of an epoch, and recover. Range rates come first: what they
    show of velocity or drift is looked for in position or bias too.
    """
    tests, P, model, signals = case.options.integrity, work.P, case.model, case.signals
    factor, clock = tests.recovery * tests.recovery, model.clock
    again = _readmit(own, tests, running, model, signals, epoch, n_row)
    fails = running * _left(own, tests, model, signals, epoch, -1, n_row)
    zero = like(fails, 0.0)
    isolated, seen_motion, seen_clock, speed = zero, zero, zero, zero
    for step in range(2):
        kind = 1 - step
        first, at = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        found, agrees = _isolate_satellites(own, work.H, case, fails, first, kind, epoch, n_row)
        isolated = where((found > 0.0) & (isolated == 0.0), OF_CHANNEL, isolated)
        left = agrees * fails * _left(own, tests, model, signals, epoch, kind, n_row)
        shift, drift, size, offset = compare(own, tests, P, at, clock + kind)
        motion = where((shift > 1.0) & (agrees * fails * where(seen_motion > 0.0, 1.0, left) > 0.0), 1.0, 0.0)
        of_clock = where((drift > 1.0) & (agrees * fails * where(seen_clock > 0.0, 1.0, left) > 0.0), 1.0, 0.0)
        seen_clock = where(of_clock > 0.0, 1.0, seen_clock)
        seen_motion = where((motion > 0.0) & ((of_clock == 0.0) | (shift > drift)), 1.0, seen_motion)
        inflate(P, at, 3, motion, factor * size)
        inflate(P, clock + kind, 1, of_clock, factor * offset)
        speed = where(motion > 0.0, size, zero) if kind == 1 else speed
    isolated = where(seen_clock > seen_motion, OF_CLOCK, where(seen_motion > 0.0, OF_INERTIAL, isolated))
    excluded, used = _count_out(own, model, signals, epoch, n_row)
    common, faster = find_common(own, work, case, where(isolated == 0.0, fails, 0.0), excluded, n_row)
    isolated, speed = where(common > 0.0, common, isolated), where(common > 0.0, faster, speed)
    learn(own, tests, P, model, where(isolated == OF_INERTIAL, 1.0, 0.0), speed)
    # what excluded satellites disagreed with was the prediction, if these are more than the fit can do without
    for c in range(own.out.shape[0]):
        mistaken = (isolated == OF_INERTIAL) & (used <= N_FIT) & (own.out[c] < tests.hold)
        own.out[c] = where(mistaken, 0.0, own.out[c])
    # neither a satellite alone nor what they have in common: rows that are beyond their limits are left out
    alone = where(isolated == 0.0, fails, 0.0)
    for row in range(n_row):
        this = where((alone > 0.0) & (own.square[row] > tests.single) & (own.weight[row] > 0.0), 1.0, 0.0)
        _exclude(own, tests, this, model.n_kind, epoch, channel_of(model, signals, epoch, row))
        isolated = where(this > 0.0, OF_CHANNEL, isolated)
    clear_innovations(own, where(isolated > OF_CHANNEL, 1.0, 0.0))
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
    clear_innovations(own, over)
    own.waited[0] = where(over > 0.0, 0.0, own.waited[0])
    return where(over > 0.0, OF_INERTIAL, where(fails > 0.0, OF_CHANNEL, 0.0))


@jit
def assess(own, work, case, running, epoch):
    """Test the receiver's rows of an epoch, exclude or inflate what failed, and log it.

    Parameters
    ----------
    own : Monitor, whose `z` and `variance` are those of the rows; work : of a run, with rows and predicted covariance,
        which is inflated where something is recovered; case : FilterCase; running : 1 in the runs whose filter runs
    """
    model, signals, tests = case.model, case.signals, case.options.integrity
    own.isolated[epoch] = like(own.fit[0], 0.0)
    for c in range(own.out.shape[0]):
        own.excluded[epoch, c] = like(own.fit[0], 0.0)
    _count_down(own, RETURNING if model.tight else 0.0)
    n_row = n_measured(model, signals, epoch)
    if n_row > 0:
        _test_rows(own, work.P, work.H, case, epoch, n_row)
        if model.tight:
            isolated = _assess_ranges(own, work, case, running, epoch, n_row)
        else:
            fails = running * _left(own, tests, model, signals, epoch, -1, n_row)
            isolated = _assess_solution(own, tests, work.P, fails, model.n_receiver)
        own.isolated[epoch] = isolated
