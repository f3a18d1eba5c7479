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
from lvnav_trade.kernels.lanes import number_like, where, zeros_of
from lvnav_trade.quantities.records import Floats

FAR = 1e300


class RedundancyWork(NamedTuple):
    """Work arrays of redundant IMUs in a run.

    exclusion_flag : (n_unit,). 1 for an excluded IMU.
    exclusion_tick : (n_unit,). Tick from which the IMU is excluded.
    alarm : (1,). Tick of the first detection if no IMU is excluded; 0 before.
    axis_weights : (n_triad, 2, 3, 3). Weights by which the axes of the remaining IMUs enter the mean.
    reduction_flag : (1,). 1 once the mean is no longer that of all IMUs.
    filter_weights : (n_triad, 2, 3, 3). Weights of the mean that the filter was last informed of.
    value : (n_triad, 3) rad or m/s. Increments of a tick along the axes.
    sums : (2, n_triad, 3) rad, m/s. Sums of these since the last test.
    order : (n_unit,). Scratch: readings of the IMUs, sorted for their middle value.
    ratio : (n_unit,). Scratch: residual without the IMU, over its limit.
    A : (3, 3). Scratch: normal matrix of the fit.
    inverse : (3, 3). Scratch: inverse of the normal matrix.
    b : (3,). Scratch: right-hand side of the fit.
    fit : (3,). Scratch: solution of the fit.
    prototype : (1,). Scratch: a value of the type of the lanes.
    """

    exclusion_flag: Floats
    exclusion_tick: Floats
    alarm: Floats
    axis_weights: Floats
    reduction_flag: Floats
    filter_weights: Floats
    value: Floats
    sums: Floats
    order: Floats
    ratio: Floats
    A: Floats
    inverse: Floats
    b: Floats
    fit: Floats
    prototype: Floats


def new_redundant(n_unit: int, n_triad: int, lanes: int = 0) -> RedundancyWork:
    """Return the arrays of redundant IMUs.

    Parameters
    ----------
    n_unit, n_triad
        Number of IMUs and of their triads.
    lanes
        Number of runs on the last axis; 0 for one run without this axis.
    """
    shapes = {
        "exclusion_flag": (n_unit,),
        "exclusion_tick": (n_unit,),
        "alarm": (1,),
        "axis_weights": (n_triad, 2, 3, 3),
        "reduction_flag": (1,),
        "filter_weights": (n_triad, 2, 3, 3),
        "value": (n_triad, 3),
        "sums": (2, n_triad, 3),
        "order": (n_unit,),
        "ratio": (n_unit,),
        "A": (3, 3),
        "inverse": (3, 3),
        "b": (3,),
        "fit": (3,),
        "prototype": (1,),
    }
    return RedundancyWork(**zeros_of(shapes, lanes))


@jit
def begin_redundant(work, units):
    """Reset the arrays at the start of a run: every IMU is in use (RedundancyWork, or None)."""
    if work is not None:
        zero = number_like(work.prototype[0], 0.0)
        work.reduction_flag[0] = zero
        work.alarm[0] = zero
        for u in range(work.exclusion_flag.shape[0]):
            work.exclusion_flag[u] = zero
            work.exclusion_tick[u] = zero
        _clear(work)
        for k in range(work.value.shape[0]):
            for sensor in range(2):
                combination = units.axis_weights[0, k, sensor]
                mean_combination = units.redundant.mean[0, k, sensor]
                for i in range(3):
                    for c in range(3):
                        work.axis_weights[k, sensor, i, c] = number_like(zero, combination[i, c])
                        work.filter_weights[k, sensor, i, c] = number_like(zero, mean_combination[i, c])


@jit
def _clear(work):
    """Reset the sums of a test window."""
    for sensor in range(2):
        for k in range(work.value.shape[0]):
            for c in range(3):
                work.sums[sensor, k, c] = number_like(work.prototype[0], 0.0)


def entry_weight(work: Any, units: Any, tick: Any, k: Any, sensor: Any, i: Any, c: Any) -> Any:
    """Return the weight with which a sensing axis enters the combined triad at a tick.

    Parameters
    ----------
    work
        RedundancyWork, or None.
    units
        ImuArray.
    tick
        Index of the tick.
    k, sensor
        Triad; 0 gyro or 1 accelerometer.
    i, c
        Axis of the combined triad, sensing axis of the triad.
    """
    stage = units.stage_without_exclusion[tick]
    planned_weight = units.axis_weights[stage, k, sensor, i, c]
    if work is None:
        return planned_weight
    is_reduced = work.reduction_flag[0] > 0.0
    return where(is_reduced, work.axis_weights[k, sensor, i, c], planned_weight)


@overload(entry_weight)
def _entry_weight(work, units, tick, k, sensor, i, c):
    if work == types.none:
        return lambda work, units, tick, k, sensor, i, c: units.axis_weights[0, k, sensor, i, c]
    return lambda work, units, tick, k, sensor, i, c: where(
        work.reduction_flag[0] > 0.0,
        work.axis_weights[k, sensor, i, c],
        units.axis_weights[units.stage_without_exclusion[tick], k, sensor, i, c],
    )


@jit
def store_increment(work, sensor, k, c, value):
    """Store an increment along an axis for selection and test.

    Parameters
    ----------
    work : RedundancyWork, updated in place
    sensor : 0 gyro, 1 accelerometer
    k, c : triad, sensing axis
    value : rad or m/s, increment of a tick
    """
    work.value[k, c] = value
    work.sums[sensor, k, c] = work.sums[sensor, k, c] + value


@jit
def combine(increments, work, units, redundancy, row, sensor):
    """Set the combined increments of a tick: mean of the IMUs in use, or their middle value on each axis.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, body axes, updated in place
    work, units, redundancy : RedundancyWork, ImuArray, ImuRedundancy
    row : index of the tick in the window
    sensor : 0 gyro, 1 accelerometer
    """
    n = units.n_axis.shape[0]
    first = 3 * sensor
    for i in range(3):
        if redundancy.uses_middle_value:
            zero = number_like(work.prototype[0], 0.0)
            for u in range(work.order.shape[0]):
                is_excluded = work.exclusion_flag[u] > 0.0
                work.order[u] = where(is_excluded, FAR, zero)
            for k in range(n):
                u = redundancy.owner[k]
                for c in range(units.n_axis[k]):
                    reading = redundancy.imu_weights[k, i, c] * work.value[k, c]
                    work.order[u] = work.order[u] + reading
            increments[row, first + i] = _median_reading(work)
        else:
            total = number_like(work.prototype[0], 0.0)
            for k in range(n):
                for c in range(units.n_axis[k]):
                    share = work.axis_weights[k, sensor, i, c] * work.value[k, c]
                    total = total + share
            increments[row, first + i] = total


@jit
def _median_reading(work):
    """Return the median of `work.order`, which is sorted here; excluded IMUs are sorted to the end.

    With an even number of IMUs it is the mean of the middle two.
    """
    n = work.order.shape[0]
    n_used = number_like(work.prototype[0], 0.0)
    for u in range(n):
        is_excluded = work.exclusion_flag[u] > 0.0
        n_used = n_used + where(is_excluded, 0.0, 1.0)
    # bubble sort without branches, since lanes have different orders
    for last in range(n - 1, 0, -1):
        for u in range(last):
            a = work.order[u]
            b = work.order[u + 1]
            is_descending = b < a
            work.order[u] = where(is_descending, b, a)
            work.order[u + 1] = where(is_descending, a, b)
    median = work.order[0]
    for m in range(2, n + 1):
        lower = work.order[(m - 1) // 2]
        upper = work.order[m // 2]
        middle = 0.5 * (lower + upper)
        median = where(n_used == float(m), middle, median)
    return median


@jit
def _weight(work, skip, redundancy, weights, k, c):
    """Return the weight of an axis in the fit: 0 if its IMU is excluded or omitted (`skip`)."""
    u = redundancy.owner[k]
    is_excluded = work.exclusion_flag[u] > 0.0
    weight = 0.0 if u == skip else weights[k, c]
    return where(is_excluded, 0.0, weight)


@jit
def _residual(work, units, redundancy, sensor, window, skip):
    """Return the weighted sum of squared residuals of a fit without one IMU, and its degrees of freedom.

    Parameters
    ----------
    work, units, redundancy : RedundancyWork, ImuArray, ImuRedundancy
    sensor : 0 gyro, 1 accelerometer
    window : index of the test window
    skip : IMU that is omitted, -1 none
    """
    weights = redundancy.weight[window, sensor]
    n = units.n_axis.shape[0]
    zero = number_like(work.prototype[0], 0.0)
    A = work.A
    b = work.b
    fit = work.fit
    inverse = work.inverse
    regular = 1e-12 * weights[0, 0]  # the normal matrix is regular also with too few axes
    for i in range(3):
        b[i] = zero
        for j in range(3):
            A[i, j] = zero + (regular if i == j else 0.0)
    dof = zero - 3.0
    for k in range(n):
        for c in range(units.n_axis[k]):
            h = units.frames[k, c, 0]
            w = _weight(work, skip, redundancy, weights, k, c)
            dof = dof + where(w > 0.0, 1.0, 0.0)
            y = work.sums[sensor, k, c]
            for i in range(3):
                weighted_entry = w * h[i]
                b[i] = b[i] + weighted_entry * y
                for j in range(3):
                    A[i, j] = A[i, j] + weighted_entry * h[j]
    invert(inverse, A)
    for i in range(3):
        fit[i] = inverse[i, 0] * b[0] + inverse[i, 1] * b[1] + inverse[i, 2] * b[2]
    square = zero
    for k in range(n):
        for c in range(units.n_axis[k]):
            h = units.frames[k, c, 0]
            w = _weight(work, skip, redundancy, weights, k, c)
            fitted_increment = h[0] * fit[0] + h[1] * fit[1] + h[2] * fit[2]
            residual = work.sums[sensor, k, c] - fitted_increment
            square = square + w * residual * residual
    return square, dof


@jit
def _use_flag(work, u, uses_prime):
    """Return 1 if an IMU enters the combined increments: it is not excluded, and with a prime IMU no IMU before it is
    in use.
    """
    is_excluded = work.exclusion_flag[u] > 0.0
    use_flag = where(is_excluded, 0.0, number_like(work.prototype[0], 1.0))
    if uses_prime:
        for prior_imu in range(u):
            is_prior_excluded = work.exclusion_flag[prior_imu] > 0.0
            use_flag = where(is_prior_excluded, use_flag, 0.0)
    return use_flag


@jit
def _reduce(work, units, redundancy):
    """Set the weights of the axes in the mean of the IMUs in use: (H' W H)^-1 H' W."""
    n = units.n_axis.shape[0]
    zero = number_like(work.prototype[0], 0.0)
    A = work.A
    inverse = work.inverse
    for sensor in range(2):
        for i in range(3):
            for j in range(3):
                A[i, j] = zero + (1e-12 if i == j else 0.0)
        for k in range(n):
            w = _share(work, redundancy, sensor, k)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    weighted_entry = w * h[i]
                    for j in range(3):
                        A[i, j] = A[i, j] + weighted_entry * h[j]
        invert(inverse, A)
        for k in range(n):
            w = _share(work, redundancy, sensor, k)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                for i in range(3):
                    row = inverse[i]
                    weight = w * (row[0] * h[0] + row[1] * h[1] + row[2] * h[2])
                    present = work.axis_weights[k, sensor, i, c]
                    is_reduced = work.reduction_flag[0] > 0.0
                    work.axis_weights[k, sensor, i, c] = where(is_reduced, weight, present)


@jit
def _share(work, redundancy, sensor, k):
    """Return the weight of the axes of a triad in the mean: 0 if its IMU is not in use."""
    use_flag = _use_flag(work, redundancy.owner[k], redundancy.uses_prime)
    return where(use_flag > 0.0, redundancy.shares[sensor, k], 0.0)


@jit
def _hand_over(work, units, redundancy, tick):
    """Exclude the first IMU after a tick."""
    flag = number_like(work.prototype[0], 1.0)
    work.exclusion_flag[0] = flag
    work.exclusion_tick[0] = number_like(work.prototype[0], tick + 1.0)
    work.reduction_flag[0] = flag
    _reduce(work, units, redundancy)


@jit
def _set_ratios(work, units, redundancy, sensor, window):
    """Set the ratio by which IMUs are excluded, the smallest first: the residual without the IMU, over its limit.

    If a failure hands over from a prime IMU, it is 0 for the prime IMU and FAR for the others. It is FAR without
    redundancy.
    """
    for u in range(work.exclusion_flag.shape[0]):
        if redundancy.hands_over_on_failure:
            use_flag = _use_flag(work, u, redundancy.uses_prime)
            work.ratio[u] = where(use_flag > 0.0, 0.0, number_like(work.prototype[0], FAR))
        else:
            square, dof = _residual(work, units, redundancy, sensor, window, u)
            ratio = square / limit(redundancy.limits, dof)
            has_no_ratio = (work.exclusion_flag[u] > 0.0) | (dof < 1.0)
            work.ratio[u] = where(has_no_ratio, FAR, ratio)


@jit
def check(work, units, redundancy, tick):
    """Test the IMUs after a tick that ends a test window; exclude the failed IMU, or record an alarm. Hand over from
    the prime IMU at its given tick.
    """
    if tick + 1 == redundancy.planned_handover_tick:
        _hand_over(work, units, redundancy, tick)
    if redundancy.n_test_tick == 0 or (tick + 1) % redundancy.n_test_tick != 0:
        return
    window = (tick + 1) // redundancy.n_test_tick - 1
    for sensor in range(2):
        square, dof = _residual(work, units, redundancy, sensor, window, -1)
        is_beyond = square > limit(redundancy.limits, dof)
        fails = where((dof >= 1.0) & is_beyond, 1.0, 0.0)
        if redundancy.excludes:
            _set_ratios(work, units, redundancy, sensor, window)
            _exclude_least(work, fails, tick)
        else:
            is_first = (fails > 0.0) & (work.alarm[0] == 0.0)
            work.alarm[0] = where(is_first, tick + 1.0, work.alarm[0])
    _reduce(work, units, redundancy)
    _clear(work)


@jit
def _exclude_least(work, fails, tick):
    """Exclude the IMU with the smallest ratio after a tick, in the runs whose test fails."""
    smallest_ratio = number_like(work.prototype[0], FAR)
    for u in range(work.exclusion_flag.shape[0]):
        ratio = work.ratio[u]
        smallest_ratio = where(ratio < smallest_ratio, ratio, smallest_ratio)
    for u in range(work.exclusion_flag.shape[0]):
        is_least = (work.ratio[u] == smallest_ratio) & (smallest_ratio < FAR)
        is_failed = (fails > 0.0) & is_least
        work.exclusion_flag[u] = where(is_failed, 1.0, work.exclusion_flag[u])
        work.exclusion_tick[u] = where(is_failed, tick + 1.0, work.exclusion_tick[u])
        work.reduction_flag[0] = where(is_failed, 1.0, work.reduction_flag[0])
