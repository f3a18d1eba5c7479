"""Redundant IMUs in one run or eight lanes: parity test, exclusion, and selection.

A test sums the increments along the axes over a window, fits angular rate or specific force of the body to them by
weighted least squares, and compares the weighted sum of squared residuals with a chi-square quantile; the degrees of
freedom are the number of axes minus 3 (Sturza, Navigation 35(4), 1988). The IMU whose omission gives the smallest
residual, relative to its limit, is excluded from then on.
"""

from typing import Any, NamedTuple

from numba import types
from numba.extending import overload

from lvnav_trade.filter.policies.integrity.state import invert, limit
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where, zeros_of
from lvnav_trade.kernels.transition import ATT, CONSTANT, GYRO, VEL
from lvnav_trade.quantities.records import Floats

FAR = 1e300


class RedundancyWork(NamedTuple):
    """Work arrays of redundant IMUs in a run.

    out : (n_unit,). 1 for an excluded IMU.
    when : (n_unit,). Tick from which the IMU is excluded.
    alarm : (1,). Tick of the first detection if no IMU is excluded; 0 before.
    solved : (n_triad, 2, 3, 3). Weights by which the axes of the remaining IMUs enter the mean.
    reduced : (1,). 1 once the mean is no longer that of all IMUs.
    informed : (n_triad, 2, 3, 3). Weights of the mean that the filter was last informed of.
    value : (n_triad, 3) rad or m/s. Increments of a tick along the axes.
    sums : (2, n_triad, 3) rad, m/s. Sums of these since the last test.
    order : (n_unit,). Scratch: readings of the IMUs, sorted for their middle value.
    ratio : (n_unit,). Scratch: residual without the IMU, over its limit.
    A : (3, 3). Scratch: normal matrix of the fit.
    inverse : (3, 3). Scratch: inverse of the normal matrix.
    b : (3,). Scratch: right-hand side of the fit.
    fit : (3,). Scratch: solution of the fit.
    over : (1,). Scratch: a value of the type of the lanes.
    """

    out: Floats
    when: Floats
    alarm: Floats
    solved: Floats
    reduced: Floats
    informed: Floats
    value: Floats
    sums: Floats
    order: Floats
    ratio: Floats
    A: Floats
    inverse: Floats
    b: Floats
    fit: Floats
    over: Floats


def new_redundant(n_unit: int, n_triad: int, lanes: int = 0) -> RedundancyWork:
    """Return the arrays of redundant IMUs: one run, or `lanes` runs on the last axis."""
    shapes = {
        "out": (n_unit,),
        "when": (n_unit,),
        "alarm": (1,),
        "solved": (n_triad, 2, 3, 3),
        "reduced": (1,),
        "informed": (n_triad, 2, 3, 3),
        "value": (n_triad, 3),
        "sums": (2, n_triad, 3),
        "order": (n_unit,),
        "ratio": (n_unit,),
        "A": (3, 3),
        "inverse": (3, 3),
        "b": (3,),
        "fit": (3,),
        "over": (1,),
    }
    return RedundancyWork(**zeros_of(shapes, lanes))


@jit
def begin_redundant(work, units):
    """Reset the arrays at the start of a run: every IMU is in use (RedundancyWork, or None)."""
    if work is not None:
        zero = like(work.over[0], 0.0)
        work.reduced[0], work.alarm[0] = zero, zero
        for u in range(work.out.shape[0]):
            work.out[u], work.when[u] = zero, zero
        _clear(work)
        for k in range(work.value.shape[0]):
            for sensor in range(2):
                for i in range(3):
                    for c in range(3):
                        work.solved[k, sensor, i, c] = like(zero, units.solved[0, k, sensor, i, c])
                        work.informed[k, sensor, i, c] = like(zero, units.redundant.mean[0, k, sensor, i, c])


@jit
def _clear(work):
    for sensor in range(2):
        for k in range(work.value.shape[0]):
            for c in range(3):
                work.sums[sensor, k, c] = like(work.over[0], 0.0)


def entering(work: Any, units: Any, tick: Any, k: Any, sensor: Any, i: Any, c: Any) -> Any:
    """Return the weight of axis c of a triad in axis i of the combined triad at a tick (RedundancyWork, or None)."""
    whole = units.solved[units.flown[tick], k, sensor, i, c]
    return whole if work is None else where(work.reduced[0] > 0.0, work.solved[k, sensor, i, c], whole)


@overload(entering)
def _entering(work, units, tick, k, sensor, i, c):
    if work == types.none:
        return lambda work, units, tick, k, sensor, i, c: units.solved[0, k, sensor, i, c]
    return lambda work, units, tick, k, sensor, i, c: where(
        work.reduced[0] > 0.0, work.solved[k, sensor, i, c], units.solved[units.flown[tick], k, sensor, i, c]
    )


@jit
def note(work, sensor, k, c, value):
    """Store an increment along an axis for selection and test."""
    work.value[k, c] = value
    work.sums[sensor, k, c] = work.sums[sensor, k, c] + value


@jit
def combine(increments, work, units, redundancy, row, sensor):
    """Set the combined increments of a tick: mean of the IMUs in use, or their middle value on each axis."""
    n = units.n_axis.shape[0]
    for i in range(3):
        if redundancy.middle:
            for u in range(work.order.shape[0]):
                work.order[u] = where(work.out[u] > 0.0, FAR, like(work.over[0], 0.0))
            for k in range(n):
                u = redundancy.owner[k]
                for c in range(units.n_axis[k]):
                    work.order[u] = work.order[u] + redundancy.alone[k, i, c] * work.value[k, c]
            increments[row, 3 * sensor + i] = _middle_of(work)
        else:
            total = like(work.over[0], 0.0)
            for k in range(n):
                for c in range(units.n_axis[k]):
                    total = total + work.solved[k, sensor, i, c] * work.value[k, c]
            increments[row, 3 * sensor + i] = total


@jit
def _middle_of(work):
    """Return the median of `work.order`, which is sorted here; excluded IMUs are sorted to the end.

    With an even number of IMUs it is the mean of the middle two.
    """
    n = work.order.shape[0]
    used = like(work.over[0], 0.0)
    for u in range(n):
        used = used + where(work.out[u] > 0.0, 0.0, 1.0)
    for last in range(n - 1, 0, -1):
        for u in range(last):
            a = work.order[u]
            b = work.order[u + 1]
            work.order[u], work.order[u + 1] = where(b < a, b, a), where(b < a, a, b)
    median = work.order[0]
    for m in range(2, n + 1):
        median = where(used == float(m), 0.5 * (work.order[(m - 1) // 2] + work.order[m // 2]), median)
    return median


@jit
def _weight(work, skip, redundancy, weights, k, c):
    """Return the weight of an axis in the fit: 0 if its IMU is excluded or omitted (`skip`)."""
    u = redundancy.owner[k]
    return where(work.out[u] > 0.0, 0.0, 0.0 if u == skip else weights[k, c])


@jit
def _residual(work, units, redundancy, sensor, window, skip):
    """Return the weighted sum of squared residuals of a fit without IMU `skip` (-1 none), and its dof."""
    weights = redundancy.weight[window, sensor]
    n = units.n_axis.shape[0]
    zero = like(work.over[0], 0.0)
    for i in range(3):
        work.b[i] = zero
        for j in range(3):
            work.A[i, j] = zero + (1e-12 * weights[0, 0] if i == j else 0.0)  # regular also with too few axes
    dof = zero - 3.0
    for k in range(n):
        for c in range(units.n_axis[k]):
            h = units.frames[k, c, 0]
            w = _weight(work, skip, redundancy, weights, k, c)
            dof = dof + where(w > 0.0, 1.0, 0.0)
            for i in range(3):
                work.b[i] = work.b[i] + w * h[i] * work.sums[sensor, k, c]
                for j in range(3):
                    work.A[i, j] = work.A[i, j] + w * h[i] * h[j]
    invert(work.inverse, work.A)
    for i in range(3):
        work.fit[i] = work.inverse[i, 0] * work.b[0] + work.inverse[i, 1] * work.b[1] + work.inverse[i, 2] * work.b[2]
    square = zero
    for k in range(n):
        for c in range(units.n_axis[k]):
            h = units.frames[k, c, 0]
            w = _weight(work, skip, redundancy, weights, k, c)
            residual = work.sums[sensor, k, c] - (h[0] * work.fit[0] + h[1] * work.fit[1] + h[2] * work.fit[2])
            square = square + w * residual * residual
    return square, dof


@jit
def _in_use(work, u, prime):
    """Return 1 where a unit enters what is fused: it is not out; of a prime, no unit before it is in use either."""
    used = where(work.out[u] > 0.0, 0.0, like(work.over[0], 1.0))
    if prime:
        for before in range(u):
            used = where(work.out[before] > 0.0, used, 0.0)
    return used


@jit
def _reduce(work, units, redundancy):
    """Set the weights of the axes in the mean of the IMUs in use."""
    n = units.n_axis.shape[0]
    zero = like(work.over[0], 0.0)
    for sensor in range(2):
        for i in range(3):
            for j in range(3):
                work.A[i, j] = zero + (1e-12 if i == j else 0.0)
        for k in range(n):
            w = where(_in_use(work, redundancy.owner[k], redundancy.prime) > 0.0, redundancy.shares[sensor, k], 0.0)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    for j in range(3):
                        work.A[i, j] = work.A[i, j] + w * h[i] * h[j]
        invert(work.inverse, work.A)
        for k in range(n):
            w = where(_in_use(work, redundancy.owner[k], redundancy.prime) > 0.0, redundancy.shares[sensor, k], 0.0)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    value = work.inverse[i, 0] * h[0] + work.inverse[i, 1] * h[1] + work.inverse[i, 2] * h[2]
                    present = work.solved[k, sensor, i, c]
                    work.solved[k, sensor, i, c] = where(work.reduced[0] > 0.0, w * value, present)


@jit
def _hand_over(work, units, redundancy, tick):
    """Exclude the first unit after a tick."""
    work.out[0], work.when[0] = like(work.over[0], 1.0), like(work.over[0], tick + 1.0)
    work.reduced[0] = like(work.over[0], 1.0)
    _reduce(work, units, redundancy)


@jit
def _rate_without(work, units, redundancy, sensor, window):
    """Set by what ratio units are excluded, the smallest first: what is left without it, over its limit; of a prime,
    where a failure hands over, 0, and FAR of the others. FAR where nothing is left to exclude.
    """
    for u in range(work.out.shape[0]):
        if redundancy.hands_over:
            work.ratio[u] = where(_in_use(work, u, redundancy.prime) > 0.0, 0.0, like(work.over[0], FAR))
        else:
            square, dof = _residual(work, units, redundancy, sensor, window, u)
            work.ratio[u] = where((work.out[u] > 0.0) | (dof < 1.0), FAR, square / limit(redundancy.limits, dof))


@jit
def check(work, units, redundancy, tick):
    """Test the IMUs after a tick that ends a test window; exclude the failed IMU, or record an alarm. Hand over from
    the prime IMU at its stated tick.
    """
    if tick + 1 == redundancy.hand_over:
        _hand_over(work, units, redundancy, tick)
    if redundancy.ticks == 0 or (tick + 1) % redundancy.ticks != 0:
        return
    window = (tick + 1) // redundancy.ticks - 1
    for sensor in range(2):
        square, dof = _residual(work, units, redundancy, sensor, window, -1)
        fails = where((dof >= 1.0) & (square > limit(redundancy.limits, dof)), 1.0, 0.0)
        if not redundancy.excludes:
            work.alarm[0] = where((fails > 0.0) & (work.alarm[0] == 0.0), tick + 1.0, work.alarm[0])
            continue
        _rate_without(work, units, redundancy, sensor, window)
        least = like(work.over[0], FAR)
        for u in range(work.out.shape[0]):
            least = where(work.ratio[u] < least, work.ratio[u], least)
        for u in range(work.out.shape[0]):
            worst = (fails > 0.0) & (work.ratio[u] == least) & (least < FAR)
            work.out[u], work.when[u] = where(worst, 1.0, work.out[u]), where(worst, tick + 1.0, work.when[u])
            work.reduced[0] = where(worst, 1.0, work.reduced[0])
    _reduce(work, units, redundancy)
    _clear(work)


@jit
def inform(P, work, units, model, seconds):
    """Inflate the covariance of the filter for excluded IMUs over a window (ImuArrayWork and ImuArray, or None).

    The mean of the remaining IMUs has more noise than that of all, which the filter model assumes. seconds : s, of the
    window
    """
    if units is not None:
        _inform(P, work.redundant, units, units.redundant, model, seconds)


@jit
def _inform(P, work, units, redundancy, model, seconds):
    if work is not None:
        grow(P, work.solved, work.informed, work.reduced[0], units.n_axis, redundancy, model, seconds)
        for k in range(work.solved.shape[0]):
            for sensor in range(2):
                for i in range(3):
                    for c in range(3):
                        last = work.informed[k, sensor, i, c]
                        work.informed[k, sensor, i, c] = where(
                            work.reduced[0] > 0.0, work.solved[k, sensor, i, c], last
                        )


@jit
def grow(P, solved, before, wanted, n_axis, redundancy, model, seconds):
    """Inflate a covariance over a window for the additional errors of the mean of some IMUs.

    White noise and random walk of the biases exceed those of the mean of all IMUs. When the weights change, the
    combined bias changes once.

    Parameters
    ----------
    P : (n, n) covariance, updated in place
    solved, before : (n_triad, 2, 3, 3) weights of the axes in the mean now, and at the start of the window
    wanted : 1 in the runs with excluded IMUs
    n_axis, redundancy, model : number of axes of each triad, ImuRedundancy, FilterModel
    seconds : s, length of the window
    """
    for sensor in range(2):
        at = ATT if sensor == GYRO else VEL
        total = like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                for i in range(3):
                    all_units = redundancy.mean[0, k, sensor, i, c]
                    excess = solved[k, sensor, i, c] * solved[k, sensor, i, c] - all_units * all_units
                    total = total + excess * redundancy.noise[sensor, k, c]
        total = where((wanted > 0.0) & (total > 0.0), total * (seconds / 3.0), 0.0)  # mean over the three axes
        for i in range(3):
            P[at + i, at + i] = P[at + i, at + i] + total
    for b in range(model.par_offset.shape[0]):
        if model.par_driver[b] == CONSTANT:
            if redundancy.prime:
                _renew_bias(P, (solved, before), wanted, n_axis, redundancy, model.par_sensor[b], model.par_offset[b])
            _grow_bias(
                P, (solved, before), wanted, n_axis, redundancy, model.par_sensor[b], model.par_offset[b], seconds
            )


@jit
def _renew_bias(P, weights, wanted, n_axis, redundancy, sensor, at):
    """Begin what a filter knows of a bias after a hand-over: uncorrelated, with the variance -P. `_grow_bias` adds
    s1^2 + s2^2.

    The estimate stays, and its error is b2 - b1 + e with e = b1 less the estimate. The estimate of a filter that models
    all errors is uncorrelated with e, so Cov(b1, e) = P and, of any other error x, Cov(x, b1) = Cov(x, e). The new
    variance is s1^2 + s2^2 - P, at least s2^2, and the covariances with other errors are zero.
    """
    solved, before = weights
    for i in range(3):
        change = like(P[0, 0], 0.0)
        fresh = like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                now = solved[k, sensor, i, c]
                off = now - before[k, sensor, i, c]
                change = change + off * off * redundancy.spread[sensor, k, c]
                fresh = fresh + now * now * redundancy.spread[sensor, k, c]
        known = P[at + i, at + i]
        handed = (wanted > 0.0) & (change > 0.0)
        for j in range(P.shape[0]):
            P[at + i, j] = where(handed, 0.0, P[at + i, j])
            P[j, at + i] = where(handed, 0.0, P[j, at + i])
        most = change - fresh  # the variance of the new bias is left at least
        P[at + i, at + i] = where(handed, -where(known < most, known, most), known)


@jit
def _grow_bias(P, weights, wanted, n_axis, redundancy, sensor, at, seconds):
    """Inflate the variances of a bias, three states from `at` on, as `grow` describes; weights : solved, before."""
    solved, before = weights
    for i in range(3):
        total = like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                all_units = redundancy.mean[0, k, sensor, i, c]
                now = solved[k, sensor, i, c]
                change = now - before[k, sensor, i, c]
                total = total + change * change * redundancy.spread[sensor, k, c]
                total = total + (now * now - all_units * all_units) * redundancy.walk[sensor, k, c] * seconds
        P[at + i, at + i] = P[at + i, at + i] + where((wanted > 0.0) & (total > 0.0), total, 0.0)
