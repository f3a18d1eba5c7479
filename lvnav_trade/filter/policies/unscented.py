"""The unscented filter: covariance and measurement rows from sigma points about the estimate, in place of Jacobians.

Julier and Uhlmann (1997). The sigma points lie at plus and minus sqrt(3) times a column of the Cholesky factor of the
covariance, each with weight 1/6. Let d+ and d- be the values of a function at the two points of a pair, minus its
value at the estimate. With o = (d+ - d-) / 2 and e = (d+ + d-) / 2,

    mean = f(estimate) + sum e / 3,   covariance = sum (o o' + e e') / 3.

The covariance is taken about f(estimate), not about the mean: it is positive definite for any number of states.

Only the nonlinear part uses points. In the propagation that is the motion, a function of navigation errors and IMU
parameters; all other states decay or are linear (clock). In a measurement it is the dependence on the navigation
errors: the Jacobian row is the slope of the regression over the points, the innovation includes the shift of the mean,
and the noise variance includes the residual variance of the regression. Gate, stored gains, delay compensation and mode
logic are then those of the extended filter.
"""

from typing import NamedTuple

from lvnav_trade.filter.ekf import (
    apply_robustness,
    fill_transition,
    inject,
    propagate_estimates,
)
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import multiply
from lvnav_trade.kernels.covariance import add_axis_noise, finish_window
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, sqrt, where, zeros_of
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, Q, R, V
from lvnav_trade.kernels.transition import ATT, POS, VEL, correct_motion
from lvnav_trade.quantities.records import Floats

N_NAV = 9
REACH = 3.0**0.5  # distance of a point in columns of the factor; matches the fourth moment of a normal distribution
SMALLEST = 1e-12  # conditional variance of a state as a fraction of its variance; below, it is rounding


class SigmaPoints(NamedTuple):
    """Work arrays of the sigma points. A column is one of the n columns of the covariance's factor, with a pair of
    points.

    nav : (10,). Navigation state at the start of a window.
    previous : (6,) rad, m/s. Increments before the window.
    increments : (n_tick, 6) rad, m/s. Increments of the window as the IMU outputs them.
    state : (10,). Navigation state of a point.
    last : (6,) rad, m/s. Last increments of a point.
    sums : (18,). Strapdown integrals of a point over the window.
    compensated_increments : (n_tick, 6) rad, m/s. Increments compensated by the IMU parameters of a point.
    par : (n_par, 3). IMU parameters of a point.
    tables : (2, N_TABLE). Compensation tables of gyro and accelerometer, from these parameters.
    x : (9,). Navigation error of a point relative to the estimate.
    root : (n_state, n). Columns of the Cholesky factor of the covariance.
    odd : (n, 9). Half the difference of the errors of a pair after the window, by column.
    even : (n, 9). Mean of the errors of a pair after the window, less that of the estimate, by column.
    centre : (9,). Navigation error of the estimate at the end of the window.
    mean : (9,). Mean navigation error of all points at the end of the window.
    z : (n_row,). Measurement minus its prediction at the estimate.
    row_odd : (n_row, 9). Odd part of the predicted measurement, by navigation error.
    row_even : (n_row, 9). Even part of the predicted measurement, by navigation error.
    residual_variance : (n_row,). Variance of the prediction that its regression slope does not explain.
    """

    nav: Floats
    previous: Floats
    increments: Floats
    state: Floats
    last: Floats
    sums: Floats
    compensated_increments: Floats
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
    residual_variance: Floats


def new_sigma_points(n_state: int, n_par: int, n_tick: int, n_row: int, lanes: int = 0) -> SigmaPoints:
    """Return the arrays of the points: one run, or `lanes` runs on the last axis."""
    n = N_NAV + 3 * n_par
    shapes = {
        "nav": (10,),
        "previous": (6,),
        "increments": (n_tick, 6),
        "state": (10,),
        "last": (6,),
        "sums": (N_SUM,),
        "compensated_increments": (n_tick, 6),
        "par": (max(1, n_par), 3),
        "tables": (2, processes.N_TABLE),
        "x": (N_NAV,),
        "root": (n_state, n),
        "odd": (n, N_NAV),
        "even": (n, N_NAV),
        "centre": (N_NAV,),
        "mean": (N_NAV,),
        "z": (n_row,),
        "row_odd": (n_row, N_NAV),
        "row_even": (n_row, N_NAV),
        "residual_variance": (n_row,),
    }
    return SigmaPoints(**zeros_of(shapes, lanes))


@jit
def _copy(target, source, n):
    for i in range(n):
        target[i] = source[i]


@inline_jit
def store_window_start(sigma_points, work, n_tick):
    """Store the navigation state and the increments at the start of a window, from which every point is propagated."""
    if sigma_points is not None:
        _copy(sigma_points.nav, work.nav, 10)
        _copy(sigma_points.previous, work.previous, 6)
        for k in range(n_tick):
            _copy(sigma_points.increments[k], work.increments[k], 6)


@jit
def _motion_state(model, a):
    """Return the index of the a-th state that the motion depends on: navigation errors, then IMU parameters."""
    if a < N_NAV:
        return a
    return model.par_offset[(a - N_NAV) // 3] + (a - N_NAV) % 3


@jit
def factorise(root, P, model, n):
    """Set the first n columns of the Cholesky factor of P, with the states in the order of `_motion_state`.

    root root' equals P for these n states, and for their covariance with all other states. The column of a state that
    the states before it determine completely is zero.

    Parameters
    ----------
    root : (n_state, n) factor, set here
    P : (n_state, n_state) covariance
    model : FilterModel
    n : number of columns
    """
    for a in range(n):
        j = _motion_state(model, a)
        pivot = P[j, j]
        for b in range(a):
            pivot = pivot - root[j, b] * root[j, b]
        is_positive = pivot > SMALLEST * P[j, j]
        square = where(is_positive, pivot, 1.0)
        scale = where(is_positive, 1.0 / sqrt(square), 0.0)
        for i in range(P.shape[0]):
            value = P[i, j]
            for b in range(a):
                value = value - root[i, b] * root[j, b]
            root[i, a] = value * scale
        for b in range(a):
            root[_motion_state(model, b), a] = 0.0 * pivot


@jit
def _arcsine_series(square):
    """Return asin(s) / s as a series in the square of s."""
    return 1.0 + square * (
        1 / 6
        + square * (3 / 40 + square * (5 / 112 + square * (35 / 1152 + square * (63 / 2816 + square * (231 / 13312)))))
    )


@jit
def rotation_between(p, q):
    """Return the rotation vector (rad, inertial axes) from attitude q (4,) to attitude p (4,).

    The vector is 2 asin(s) d / s with d the vector part of p q* and s its length; the series of the arc sine is
    accurate to 1e-5 at a rotation of one radian.
    """
    d0, d1, d2, d3 = multiply(
        p[Q],
        p[Q + 1],
        p[Q + 2],
        p[Q + 3],
        q[Q],
        -q[Q + 1],
        -q[Q + 2],
        -q[Q + 3],
    )
    sine_square = d1 * d1 + d2 * d2 + d3 * d3
    series = _arcsine_series(sine_square)
    factor = where(d0 < 0.0, -2.0, 2.0) * series
    return factor * d1, factor * d2, factor * d3


@jit
def _fill_point(sigma_points, work, model, column, reach):
    """Set navigation state and IMU parameters of a sigma point: estimate plus `reach` times a column of the factor."""
    for i in range(N_NAV):
        sigma_points.x[i] = work.x[i] + reach * sigma_points.root[i, column]
    _copy(sigma_points.state, sigma_points.nav, 10)
    correct_motion(sigma_points.state, sigma_points.x)
    for b in range(model.par_offset.shape[0]):
        for i in range(3):
            state = model.par_offset[b] + i
            point_offset = reach * sigma_points.root[state, column]
            sigma_points.par[b, i] = work.par[b, i] + work.x[state] + point_offset
    processes.gather(sigma_points.tables, sigma_points.par, model.par_sensor, model.par_driver)


@jit
def _propagate_point(sigma_points, work, case, column, reach, w):
    """Propagate a sigma point over window w and set `sigma_points.x` to its error at the end, relative to `work.nav`.

    The point lies at the estimate plus `reach` times a column of the Cholesky factor.
    """
    model = case.model
    n_tick = case.schedule.n_tick[w]
    _fill_point(sigma_points, work, model, column, reach)
    _copy(sigma_points.last, sigma_points.previous, 6)
    for k in range(n_tick):
        _copy(sigma_points.compensated_increments[k], sigma_points.increments[k], 6)
    processes.compensate(
        sigma_points.compensated_increments,
        n_tick,
        sigma_points.tables[0],
        sigma_points.tables[1],
        model.biases_only,
        case.tick,
    )
    mechanise(
        sigma_points.state,
        sigma_points.sums,
        sigma_points.last,
        sigma_points.compensated_increments,
        n_tick // model.strapdown.subsamples,
        case.step,
        model.strapdown,
        case.tick * case.schedule.first_tick[w],
    )
    sigma_points.x[ATT], sigma_points.x[ATT + 1], sigma_points.x[ATT + 2] = rotation_between(
        sigma_points.state, work.nav
    )
    for i in range(3):
        sigma_points.x[VEL + i] = sigma_points.state[V + i] - work.nav[V + i]
        sigma_points.x[POS + i] = sigma_points.state[R + i] - work.nav[R + i]


@jit
def _propagate_points(sigma_points, work, case, open_loop, w):
    """Propagate all sigma points over window w: sets their odd and even parts, centre and mean."""
    for i in range(N_NAV):
        sigma_points.centre[i] = number_like(work.x[0], 0.0)
    if open_loop is not None:  # the strapdown is uncorrected, so the estimate needs a propagation of its own
        _propagate_point(sigma_points, work, case, 0, 0.0, w)
        _copy(sigma_points.centre, sigma_points.x, N_NAV)
    _copy(sigma_points.mean, sigma_points.centre, N_NAV)
    for column in range(sigma_points.odd.shape[0]):
        odd = sigma_points.odd[column]
        even = sigma_points.even[column]
        _propagate_point(sigma_points, work, case, column, REACH, w)
        _copy(odd, sigma_points.x, N_NAV)
        _propagate_point(sigma_points, work, case, column, -REACH, w)
        for i in range(N_NAV):
            plus = odd[i]
            minus = sigma_points.x[i]
            mean = 0.5 * (plus + minus)
            # the odd part is scaled to one column of the factor, so that sum (odd odd') replaces sum (o o') / 3
            odd[i] = (0.5 / REACH) * (plus - minus)
            even[i] = mean - sigma_points.centre[i]
            sigma_points.mean[i] = sigma_points.mean[i] + (1.0 / 3.0) * even[i]


@jit
def _set_navigation_covariance(P, sigma_points):
    """Set the rows and columns of the navigation errors in a covariance from the propagated sigma points."""
    n = P.shape[0]
    for i in range(N_NAV):
        for j in range(i, n):
            total = number_like(P[0, 0], 0.0)
            for column in range(sigma_points.odd.shape[0]):
                odd = sigma_points.odd[column]
                even = sigma_points.even[column]
                if j < N_NAV:
                    total = total + odd[i] * odd[j]
                    total = total + (1.0 / 3.0) * even[i] * even[j]
                else:
                    total = total + odd[i] * sigma_points.root[j, column]
            P[i, j] = total
            P[j, i] = total


@inline_jit
def propagate_by_points(work, case, sigma_points, open_loop, w):
    """Propagate covariance and estimates over window w by sigma points.

    Process noise enters in two halves, before and after the propagation, as in the extended filter.

    Parameters
    ----------
    work : arrays of the run
    case : FilterCase
    sigma_points : SigmaPoints, with the start of the window stored by `store_window_start`
    open_loop : OpenLoop, whose error state is propagated too; None in a closed loop
    w : window
    """
    model = case.model
    P = work.P
    length_index = case.schedule.length_index[w]
    noise = model.noise[length_index]
    seconds = model.seconds[length_index]
    fill_transition(work, model, length_index)  # the error state of an open loop and a backup strapdown need it
    apply_robustness(P, model, length_index)
    for i in range(P.shape[0]):
        P[i, i] = P[i, i] + 0.5 * noise[i]
    add_axis_noise(P, model.excess_density, work.sums, seconds)
    # the points spread by the covariance with half of the noise, about the estimate before the window
    factorise(sigma_points.root, P, model, sigma_points.odd.shape[0])
    _propagate_points(sigma_points, work, case, open_loop, w)
    _set_navigation_covariance(P, sigma_points)
    finish_window(P, model.decay[length_index], noise, model.clock, seconds)
    add_axis_noise(P, model.excess_density, work.sums, seconds)
    inject(P, model, case.schedule.injection[w])
    if open_loop is None:
        correct_motion(work.nav, sigma_points.mean)
    propagate_estimates(work, model, length_index)
