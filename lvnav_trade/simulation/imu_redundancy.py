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
def begin_redundant(own, units):
    """Reset the arrays at the start of a run: every IMU is in use (RedundancyWork, or None)."""
    if own is not None:
        zero = like(own.over[0], 0.0)
        own.reduced[0], own.alarm[0] = zero, zero
        for u in range(own.out.shape[0]):
            own.out[u], own.when[u] = zero, zero
        _clear(own)
        for k in range(own.value.shape[0]):
            for sensor in range(2):
                for i in range(3):
                    for c in range(3):
                        own.solved[k, sensor, i, c] = like(zero, units.solved[0, k, sensor, i, c])
                        own.informed[k, sensor, i, c] = like(zero, units.redundant.mean[0, k, sensor, i, c])


@jit
def _clear(own):
    for sensor in range(2):
        for k in range(own.value.shape[0]):
            for c in range(3):
                own.sums[sensor, k, c] = like(own.over[0], 0.0)


def entering(own: Any, units: Any, tick: Any, k: Any, sensor: Any, i: Any, c: Any) -> Any:
    """Return the weight of axis c of a triad in axis i of the combined triad at a tick (RedundancyWork, or None)."""
    whole = units.solved[units.flown[tick], k, sensor, i, c]
    return whole if own is None else where(own.reduced[0] > 0.0, own.solved[k, sensor, i, c], whole)


@overload(entering)
def _entering(own, units, tick, k, sensor, i, c):
    if own == types.none:
        return lambda own, units, tick, k, sensor, i, c: units.solved[0, k, sensor, i, c]
    return lambda own, units, tick, k, sensor, i, c: where(
        own.reduced[0] > 0.0, own.solved[k, sensor, i, c], units.solved[units.flown[tick], k, sensor, i, c]
    )


@jit
def note(own, sensor, k, c, value):
    """Store an increment along an axis for selection and test."""
    own.value[k, c] = value
    own.sums[sensor, k, c] = own.sums[sensor, k, c] + value


@jit
def combine(increments, own, units, vote, row, sensor):
    """Set the combined increments of a tick: mean of the IMUs in use, or their middle value on each axis."""
    n = units.n_axis.shape[0]
    for i in range(3):
        if vote.middle:
            for u in range(own.order.shape[0]):
                own.order[u] = where(own.out[u] > 0.0, FAR, like(own.over[0], 0.0))
            for k in range(n):
                u = vote.owner[k]
                for c in range(units.n_axis[k]):
                    own.order[u] = own.order[u] + vote.alone[k, i, c] * own.value[k, c]
            increments[row, 3 * sensor + i] = _middle_of(own)
        else:
            total = like(own.over[0], 0.0)
            for k in range(n):
                for c in range(units.n_axis[k]):
                    total = total + own.solved[k, sensor, i, c] * own.value[k, c]
            increments[row, 3 * sensor + i] = total


@jit
def _middle_of(own):
    """Return the median of `own.order`, which is sorted here; excluded IMUs are sorted to the end.

    With an even number of IMUs it is the mean of the middle two.
    """
    n, used = own.order.shape[0], like(own.over[0], 0.0)
    for u in range(n):
        used = used + where(own.out[u] > 0.0, 0.0, 1.0)
    for last in range(n - 1, 0, -1):
        for u in range(last):
            a, b = own.order[u], own.order[u + 1]
            own.order[u], own.order[u + 1] = where(b < a, b, a), where(b < a, a, b)
    median = own.order[0]
    for m in range(2, n + 1):
        median = where(used == float(m), 0.5 * (own.order[(m - 1) // 2] + own.order[m // 2]), median)
    return median


@jit
def _weight(own, skip, vote, weights, k, c):
    """Return the weight of an axis in the fit: 0 if its IMU is excluded or omitted (`skip`)."""
    u = vote.owner[k]
    return where(own.out[u] > 0.0, 0.0, 0.0 if u == skip else weights[k, c])


@jit
def _residual(own, units, vote, sensor, window, skip):
    """Return the weighted sum of squared residuals of a fit without IMU `skip` (-1 none), and its dof."""
    weights, n, zero = vote.weight[window, sensor], units.n_axis.shape[0], like(own.over[0], 0.0)
    for i in range(3):
        own.b[i] = zero
        for j in range(3):
            own.A[i, j] = zero + (1e-12 * weights[0, 0] if i == j else 0.0)  # regular also with too few axes
    dof = zero - 3.0
    for k in range(n):
        for c in range(units.n_axis[k]):
            h, w = units.frames[k, c, 0], _weight(own, skip, vote, weights, k, c)
            dof = dof + where(w > 0.0, 1.0, 0.0)
            for i in range(3):
                own.b[i] = own.b[i] + w * h[i] * own.sums[sensor, k, c]
                for j in range(3):
                    own.A[i, j] = own.A[i, j] + w * h[i] * h[j]
    invert(own.inverse, own.A)
    for i in range(3):
        own.fit[i] = own.inverse[i, 0] * own.b[0] + own.inverse[i, 1] * own.b[1] + own.inverse[i, 2] * own.b[2]
    square = zero
    for k in range(n):
        for c in range(units.n_axis[k]):
            h, w = units.frames[k, c, 0], _weight(own, skip, vote, weights, k, c)
            residual = own.sums[sensor, k, c] - (h[0] * own.fit[0] + h[1] * own.fit[1] + h[2] * own.fit[2])
            square = square + w * residual * residual
    return square, dof


@jit
def _in_use(own, u, prime):
    """Return 1 where a unit enters what is fused: it is not out; of a prime, no unit before it is in use either."""
    used = where(own.out[u] > 0.0, 0.0, like(own.over[0], 1.0))
    if prime:
        for before in range(u):
            used = where(own.out[before] > 0.0, used, 0.0)
    return used


@jit
def _reduce(own, units, vote):
    """Set the weights of the axes in the mean of the IMUs in use."""
    n, zero = units.n_axis.shape[0], like(own.over[0], 0.0)
    for sensor in range(2):
        for i in range(3):
            for j in range(3):
                own.A[i, j] = zero + (1e-12 if i == j else 0.0)
        for k in range(n):
            w = where(_in_use(own, vote.owner[k], vote.prime) > 0.0, vote.shares[sensor, k], 0.0)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    for j in range(3):
                        own.A[i, j] = own.A[i, j] + w * h[i] * h[j]
        invert(own.inverse, own.A)
        for k in range(n):
            w = where(_in_use(own, vote.owner[k], vote.prime) > 0.0, vote.shares[sensor, k], 0.0)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    value = own.inverse[i, 0] * h[0] + own.inverse[i, 1] * h[1] + own.inverse[i, 2] * h[2]
                    present = own.solved[k, sensor, i, c]
                    own.solved[k, sensor, i, c] = where(own.reduced[0] > 0.0, w * value, present)


@jit
def _hand_over(own, units, vote, tick):
    """Exclude the first unit after a tick."""
    own.out[0], own.when[0] = like(own.over[0], 1.0), like(own.over[0], tick + 1.0)
    own.reduced[0] = like(own.over[0], 1.0)
    _reduce(own, units, vote)


@jit
def _rate_without(own, units, vote, sensor, window):
    """Set by what ratio units are excluded, the smallest first: what is left without it, over its limit; of a prime,
    where a failure hands over, 0, and FAR of the others. FAR where nothing is left to exclude.
    """
    for u in range(own.out.shape[0]):
        if vote.hands_over:
            own.ratio[u] = where(_in_use(own, u, vote.prime) > 0.0, 0.0, like(own.over[0], FAR))
        else:
            square, dof = _residual(own, units, vote, sensor, window, u)
            own.ratio[u] = where((own.out[u] > 0.0) | (dof < 1.0), FAR, square / limit(vote.limits, dof))


@jit
def check(own, units, vote, tick):
    """Test the IMUs after a tick that ends a test window; exclude the failed IMU, or record an alarm. Hand over from
    the prime IMU at its stated tick.
    """
    if tick + 1 == vote.hand_over:
        _hand_over(own, units, vote, tick)
    if vote.ticks == 0 or (tick + 1) % vote.ticks != 0:
        return
    window = (tick + 1) // vote.ticks - 1
    for sensor in range(2):
        square, dof = _residual(own, units, vote, sensor, window, -1)
        fails = where((dof >= 1.0) & (square > limit(vote.limits, dof)), 1.0, 0.0)
        if not vote.excludes:
            own.alarm[0] = where((fails > 0.0) & (own.alarm[0] == 0.0), tick + 1.0, own.alarm[0])
            continue
        _rate_without(own, units, vote, sensor, window)
        least = like(own.over[0], FAR)
        for u in range(own.out.shape[0]):
            least = where(own.ratio[u] < least, own.ratio[u], least)
        for u in range(own.out.shape[0]):
            worst = (fails > 0.0) & (own.ratio[u] == least) & (least < FAR)
            own.out[u], own.when[u] = where(worst, 1.0, own.out[u]), where(worst, tick + 1.0, own.when[u])
            own.reduced[0] = where(worst, 1.0, own.reduced[0])
    _reduce(own, units, vote)
    _clear(own)


@jit
def inform(P, own, units, model, seconds):
    """Inflate the covariance of the filter for excluded IMUs over a window (UnitWork and Units, or None).

    The mean of the remaining IMUs has more noise than that of all, which the filter model assumes. seconds : s, of the
    window
    """
    if units is not None:
        _inform(P, own.redundant, units, units.redundant, model, seconds)


@jit
def _inform(P, own, units, vote, model, seconds):
    if own is not None:
        grow(P, own.solved, own.informed, own.reduced[0], units.n_axis, vote, model, seconds)
        for k in range(own.solved.shape[0]):
            for sensor in range(2):
                for i in range(3):
                    for c in range(3):
                        last = own.informed[k, sensor, i, c]
                        own.informed[k, sensor, i, c] = where(own.reduced[0] > 0.0, own.solved[k, sensor, i, c], last)


@jit
def grow(P, solved, before, wanted, n_axis, vote, model, seconds):
    """Inflate a covariance over a window for the additional errors of the mean of some IMUs.

    White noise and random walk of the biases exceed those of the mean of all IMUs. When the weights change, the
    combined bias changes once.

    Parameters
    ----------
    P : (n, n) covariance, updated in place
    solved, before : (n_triad, 2, 3, 3) weights of the axes in the mean now, and at the start of the window
    wanted : 1 in the runs with excluded IMUs
    n_axis, vote, model : number of axes of each triad, ImuRedundancy, FilterModel
    seconds : s, length of the window
    """
    for sensor in range(2):
        at, total = (ATT if sensor == GYRO else VEL), like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                for i in range(3):
                    all_units = vote.mean[0, k, sensor, i, c]
                    excess = solved[k, sensor, i, c] * solved[k, sensor, i, c] - all_units * all_units
                    total = total + excess * vote.noise[sensor, k, c]
        total = where((wanted > 0.0) & (total > 0.0), total * (seconds / 3.0), 0.0)  # mean over the three axes
        for i in range(3):
            P[at + i, at + i] = P[at + i, at + i] + total
    for b in range(model.par_offset.shape[0]):
        if model.par_driver[b] == CONSTANT:
            if vote.prime:
                _renew_bias(P, (solved, before), wanted, n_axis, vote, model.par_sensor[b], model.par_offset[b])
            _grow_bias(P, (solved, before), wanted, n_axis, vote, model.par_sensor[b], model.par_offset[b], seconds)


@jit
def _renew_bias(P, weights, wanted, n_axis, vote, sensor, at):
    """Begin what a filter knows of a bias after a hand-over: uncorrelated, with the variance -P. `_grow_bias` adds
    s1^2 + s2^2.

    The estimate stays, and its error is b2 - b1 + e with e = b1 less the estimate. The estimate of a filter that models
    all errors is uncorrelated with e, so Cov(b1, e) = P and, of any other error x, Cov(x, b1) = Cov(x, e). The new
    variance is s1^2 + s2^2 - P, at least s2^2, and the covariances with other errors are zero.
    """
    solved, before = weights
    for i in range(3):
        change, fresh = like(P[0, 0], 0.0), like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                now = solved[k, sensor, i, c]
                off = now - before[k, sensor, i, c]
                change = change + off * off * vote.spread[sensor, k, c]
                fresh = fresh + now * now * vote.spread[sensor, k, c]
        known, handed = P[at + i, at + i], (wanted > 0.0) & (change > 0.0)
        for j in range(P.shape[0]):
            P[at + i, j] = where(handed, 0.0, P[at + i, j])
            P[j, at + i] = where(handed, 0.0, P[j, at + i])
        most = change - fresh  # the variance of the new bias is left at least
        P[at + i, at + i] = where(handed, -where(known < most, known, most), known)


@jit
def _grow_bias(P, weights, wanted, n_axis, vote, sensor, at, seconds):
    """Inflate the variances of a bias, three states from `at` on, as `grow` describes; weights : solved, before."""
    solved, before = weights
    for i in range(3):
        total = like(P[0, 0], 0.0)
        for k in range(n_axis.shape[0]):
            for c in range(n_axis[k]):
                all_units, now = vote.mean[0, k, sensor, i, c], solved[k, sensor, i, c]
                change = now - before[k, sensor, i, c]
                total = total + change * change * vote.spread[sensor, k, c]
                total = total + (now * now - all_units * all_units) * vote.walk[sensor, k, c] * seconds
        P[at + i, at + i] = P[at + i, at + i] + where((wanted > 0.0) & (total > 0.0), total, 0.0)
