"""The unscented filter: covariance and rows by points about the estimate, in place of Jacobians.

Julier and Uhlmann (1997): points stand at plus and minus sqrt(3) columns of the Cholesky factor of the covariance, each
of weight 1/6. With d+ and d- what a pair makes of a function, less what the estimate makes of it, o = (d+ - d-) / 2 and
e = (d+ + d-) / 2,

    mean = f(estimate) + sum e / 3,   covariance = sum (o o' + e e') / 3

which is taken about the estimate, the form of theirs that stays positive however many states there are. Only what is
not linear is propagated so: of a window the motion, by navigation errors and parameters of the unit; the rest is decay
and clock. Of a measurement the entries of the navigation errors: a row gets the slope of the regression over its
points, its innovation the shift of the mean, its variance what the slope leaves. From there on gate, stored gains,
latency and mode logic are those of the extended filter.
"""

from typing import NamedTuple

from lvnav_trade.filters.ekf import (
    fill_receiver,
    fill_sensor,
    fill_transition,
    forget,
    inject,
    n_measured,
    place_antenna,
    predict_window,
    propagate_estimates,
)  # fmt: skip
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import multiply
from lvnav_trade.kernels.covariance import finish_window
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, sqrt, where, zeros_of
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, V, mechanise
from lvnav_trade.kernels.transition import ATT, POS, VEL, correct_motion
from lvnav_trade.observables.base import H_ATT
from lvnav_trade.records import Floats

N_NAV = 9
REACH = 3.0**0.5  # of a point, in columns of the factor: fourth moments of a normal distribution are met
SMALLEST = 1e-12  # share of a variance that is left of it where another state is known: below, it is rounding


class Points(NamedTuple):
    """Work arrays: start of a window, nav (10,), previous (6,) and increments (n_tick, 6) as the unit puts them out; of
    a point state (10,), last (6,), sums (18,), taken (n_tick, 6), par (n_par, 3), tables (2, N_TABLE), x (9,); root
    (n_state, n) columns of the factor; odd, even (n, 9) what pairs make of the motion; centre, mean (9,) error state at
    the end of a window by the estimate and by all points; z (n_row,), row_odd, row_even (n_row, 9) what they make of
    rows, spread (n_row,) variance beyond a row's slope.
    """

    nav: Floats
    previous: Floats
    increments: Floats
    state: Floats
    last: Floats
    sums: Floats
    taken: Floats
    par: Floats
    tables: Floats
    x: Floats
    root: Floats
    odd: Floats
    even: Floats
    centre: Floats
    mean: Floats
    z: Floats
    row_odd: Floats
    row_even: Floats
    spread: Floats


def new_points(n_state: int, n_par: int, n_tick: int, n_row: int, lanes: int = 0) -> Points:
    """Return the arrays of the points: one run, or `lanes` runs on the last axis."""
    n = N_NAV + 3 * n_par
    shapes = {
        "nav": (10,), "previous": (6,), "increments": (n_tick, 6), "state": (10,), "last": (6,), "sums": (N_SUM,),
        "taken": (n_tick, 6), "par": (max(1, n_par), 3), "tables": (2, processes.N_TABLE), "x": (N_NAV,),
        "root": (n_state, n), "odd": (n, N_NAV), "even": (n, N_NAV), "centre": (N_NAV,), "mean": (N_NAV,),
        "z": (n_row,), "row_odd": (n_row, N_NAV), "row_even": (n_row, N_NAV), "spread": (n_row,),
    }  # fmt: skip
    return Points(**zeros_of(shapes, lanes))


@jit
def _copy(to, source, n):
    for i in range(n):
        to[i] = source[i]


@inlined
def hold_window(points, work, n_tick):
    """Hold the state and the increments that a window starts with."""
    if points is not None:
        _copy(points.nav, work.nav, 10)
        _copy(points.previous, work.previous, 6)
        for k in range(n_tick):
            _copy(points.increments[k], work.increments[k], 6)


@jit
def _state(model, a):
    """Return the state, by number, that motion depends on: navigation errors, then parameters of the unit."""
    return a if a < N_NAV else model.par_offset[(a - N_NAV) // 3] + (a - N_NAV) % 3


@jit
def factorise(root, P, model, n):
    """Set the first n columns of the Cholesky factor of P in the order of `_state`: P = root root' of those states, and
    root (n_state, n) has the covariance of every other one with them. A state that the ones before it fix has none.
    """
    for a in range(n):
        j = _state(model, a)
        pivot = P[j, j]
        for b in range(a):
            pivot = pivot - root[j, b] * root[j, b]
        fine = pivot > SMALLEST * P[j, j]
        scale = where(fine, 1.0 / sqrt(where(fine, pivot, 1.0)), 0.0)
        for i in range(P.shape[0]):
            value = P[i, j]
            for b in range(a):
                value = value - root[i, b] * root[j, b]
            root[i, a] = value * scale
        for b in range(a):
            root[_state(model, b), a] = 0.0 * pivot


@jit
def rotation_between(p, q):
    """Return the rotation vector (inertial axes) from attitude q (4,) to attitude p (4,); series of the arc sine, to
    1e-5 at a rotation of one radian.
    """
    d0, d1, d2, d3 = multiply(p[Q], p[Q + 1], p[Q + 2], p[Q + 3], q[Q], -q[Q + 1], -q[Q + 2], -q[Q + 3])
    s = d1 * d1 + d2 * d2 + d3 * d3
    series = 1.0 + s * (1 / 6 + s * (3 / 40 + s * (5 / 112 + s * (35 / 1152 + s * (63 / 2816 + s * (231 / 13312))))))
    factor = where(d0 < 0.0, -2.0, 2.0) * series
    return factor * d1, factor * d2, factor * d3


@jit
def _fly_point(points, work, model, unit, column, reach, first, n_tick, dt):
    """Fly a point over a window and set points.x to its error at the end, relative to work.nav; it stands `reach`
    columns of the factor from the estimate.
    """
    _copy(points.state, points.nav, 10)
    _copy(points.last, points.previous, 6)
    for k in range(n_tick):
        _copy(points.taken[k], points.increments[k], 6)
    for i in range(N_NAV):
        points.x[i] = work.x[i] + reach * points.root[i, column]
    correct_motion(points.state, points.x)
    for b in range(model.par_offset.shape[0]):
        for i in range(3):
            at = model.par_offset[b] + i
            points.par[b, i] = work.par[b, i] + work.x[at] + reach * points.root[at, column]
    processes.gather(points.tables, points.par, model.par_sensor, model.par_driver)
    processes.compensate(points.taken, n_tick, points.tables[0], points.tables[1], model.biases_only, unit.dt)
    how = model.strapdown
    mechanise(points.state, points.sums, points.last, points.taken, n_tick // how.subsamples, dt, how, unit.dt * first)
    points.x[ATT], points.x[ATT + 1], points.x[ATT + 2] = rotation_between(points.state, work.nav)
    for i in range(3):
        points.x[VEL + i] = points.state[V + i] - work.nav[V + i]
        points.x[POS + i] = points.state[R + i] - work.nav[R + i]


@jit
def _fly_points(points, work, open_loop, model, unit, first, n_tick, dt):
    """Fly all points over a window: sets odd and even parts, centre and mean."""
    for i in range(N_NAV):
        points.centre[i] = like(work.x[0], 0.0)
    if open_loop is not None:  # the estimate is not what the strapdown has flown
        _fly_point(points, work, model, unit, 0, 0.0, first, n_tick, dt)
        _copy(points.centre, points.x, N_NAV)
    _copy(points.mean, points.centre, N_NAV)
    for a in range(points.odd.shape[0]):
        _fly_point(points, work, model, unit, a, REACH, first, n_tick, dt)
        _copy(points.odd[a], points.x, N_NAV)
        _fly_point(points, work, model, unit, a, -REACH, first, n_tick, dt)
        for i in range(N_NAV):
            plus, minus = points.odd[a, i], points.x[i]
            points.odd[a, i] = (0.5 / REACH) * (plus - minus)
            points.even[a, i] = 0.5 * (plus + minus) - points.centre[i]
            points.mean[i] = points.mean[i] + (1.0 / 3.0) * points.even[a, i]


@jit
def _join(P, points):
    """Set the navigation rows and columns of a covariance to what the points say."""
    n = P.shape[0]
    for i in range(N_NAV):
        for j in range(i, n):
            total = like(P[0, 0], 0.0)
            for a in range(points.odd.shape[0]):
                if j < N_NAV:
                    total = total + points.odd[a, i] * points.odd[a, j]
                    total = total + (1.0 / 3.0) * points.even[a, i] * points.even[a, j]
                else:
                    total = total + points.odd[a, i] * points.root[j, a]
            P[i, j], P[j, i] = total, total


@inlined
def predict(work, points, open_loop, model, unit, schedule, w, dt):
    """Propagate covariance and estimates over window w: by the transition, or by the points (Points, or None)."""
    length, injection = schedule.length[w], schedule.injection[w]
    if points is None:
        predict_window(work, model, length, injection)
    else:
        P, noise = work.P, model.noise[length]
        fill_transition(work, model, length)  # for what else is propagated by it
        forget(P, model, length)
        for i in range(P.shape[0]):
            P[i, i] = P[i, i] + 0.5 * noise[i]
        factorise(points.root, P, model, points.odd.shape[0])
        _fly_points(points, work, open_loop, model, unit, schedule.first_tick[w], schedule.n_tick[w], dt)
        _join(P, points)
        finish_window(P, model.decay[length], noise, model.clock, model.seconds[length])
        inject(P, model, injection)
        if open_loop is None:
            correct_motion(work.nav, points.mean)
        propagate_estimates(work, model, length)


@jit
def _set_state(work, points, column, reach):
    """Set the navigation state to the centre's, `reach` columns of the factor away."""
    _copy(work.nav, points.state, 10)
    for i in range(N_NAV):
        points.x[i] = reach * points.root[i, column]
    correct_motion(work.nav, points.x)


@jit
def _begin_regression(work, points, model):
    """Store the navigation state, let it be the estimate, and set the points' directions."""
    factorise(points.root, work.P, model, N_NAV)
    _copy(points.nav, work.nav, 10)
    correct_motion(work.nav, work.x)
    _copy(points.state, work.nav, 10)


@jit
def _store_rows(work, points, column, is_plus, first, n_row):
    """Store what a point has made of rows; after the second of a pair, odd and even parts of what is predicted."""
    for row in range(first, first + n_row):
        if is_plus:
            points.row_odd[row, column] = work.z[row]
        else:
            plus, minus = points.row_odd[row, column], work.z[row]
            points.row_odd[row, column] = (-0.5 / REACH) * (plus - minus)
            points.row_even[row, column] = points.z[row] - 0.5 * (plus + minus)


@jit
def _entry(state):
    """Return the entry of a row for a navigation error: rows begin with position, attitude, velocity."""
    return (state + H_ATT - ATT) % N_NAV


@jit
def _regress(work, points, first, n_row):
    """Set a row's navigation entries to the slope over the points; shift its innovation, which stays relative to the
    uncorrected state; set the spread that the slope leaves.
    """
    for row in range(first, first + n_row):
        h, left, shift = work.H[row], like(work.x[0], 0.0), like(work.x[0], 0.0)
        for column in range(N_NAV - 1, -1, -1):
            slope = points.row_odd[row, column]
            for later in range(column + 1, N_NAV):
                slope = slope - h[_entry(later)] * points.root[later, column]
            pivot = points.root[column, column]
            h[_entry(column)] = where(pivot > 0.0, slope / where(pivot > 0.0, pivot, 1.0), 0.0)
            even = points.row_even[row, column]
            left = left + (1.0 / 3.0) * even * even
            shift = shift - (1.0 / 3.0) * even + h[_entry(column)] * work.x[column]
        work.z[row] = points.z[row] + shift
        points.spread[row] = left


@inlined
def measure_receiver(work, points, past, earlier, late, delayed, model, signals, epoch, dt):
    """Set the rows of what the receiver measures: by Jacobians, or over the points (Points, or None). What is compared
    with a stored state is linearised there.
    """
    if points is None:
        fill_receiver(work, earlier, delayed, model, signals, epoch)
    elif late is not None and not late.extrapolated and late.line[0] >= 0:
        fill_receiver(work, earlier, delayed, model, signals, epoch)
        for row in range(n_measured(model, signals, epoch)):
            points.spread[row] = like(work.x[0], 0.0)
    else:
        n_row = n_measured(model, signals, epoch)
        _begin_regression(work, points, model)
        place_antenna(work, past, late, model, dt, epoch)
        fill_receiver(work, earlier, delayed, model, signals, epoch)
        _copy(points.z, work.z, n_row)
        for column in range(N_NAV):
            for side in range(2):
                _set_state(work, points, column, (1.0 - 2.0 * side) * REACH)
                place_antenna(work, past, late, model, dt, epoch)
                fill_receiver(work, earlier, delayed, model, signals, epoch)
                _store_rows(work, points, column, side == 0, 0, n_row)
        _copy(work.nav, points.state, 10)
        place_antenna(work, past, late, model, dt, epoch)
        fill_receiver(work, earlier, delayed, model, signals, epoch)
        _regress(work, points, 0, n_row)
        _copy(work.nav, points.nav, 10)
        place_antenna(work, past, late, model, dt, epoch)


@inlined
def measure_sensor(work, points, past, open_loop, late, model, signals, sensors, k, at, epoch):
    """Set the rows of sensor k, from row `at` on: by Jacobians, or over the points (Points, or None)."""
    n_row = sensors.scalars[k]
    if points is None:
        fill_sensor(work, past, open_loop, late, model, signals, sensors, k, at, epoch)
    elif late is not None and late.of_sensor[k] >= 0:
        fill_sensor(work, past, open_loop, late, model, signals, sensors, k, at, epoch)
        for row in range(at, at + n_row):
            points.spread[row] = like(work.x[0], 0.0)
    else:
        _begin_regression(work, points, model)
        fill_sensor(work, past, open_loop, late, model, signals, sensors, k, at, epoch)
        for row in range(at, at + n_row):
            points.z[row] = work.z[row]
        for column in range(N_NAV):
            for side in range(2):
                _set_state(work, points, column, (1.0 - 2.0 * side) * REACH)
                fill_sensor(work, past, open_loop, late, model, signals, sensors, k, at, epoch)
                _store_rows(work, points, column, side == 0, at, n_row)
        _copy(work.nav, points.state, 10)
        fill_sensor(work, past, open_loop, late, model, signals, sensors, k, at, epoch)
        _regress(work, points, at, n_row)
        _copy(work.nav, points.nav, 10)
