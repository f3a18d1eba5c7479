"""Measurement rows of the unscented filter by regression over its sigma points, in place of Jacobians.

The rows of an extended filter are evaluated at every sigma point of the navigation errors. The Jacobian row is the
slope of the regression over the points; see `unscented.py` for odd and even parts.
"""

from lvnav_trade.filter.ekf import fill_receiver, place_antenna, receiver_row_count, sensor_row
from lvnav_trade.filter.policies.open_loop import fill_sensor_at_state
from lvnav_trade.filter.policies.unscented import N_NAV, REACH, factorise
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.transition import ATT, correct_motion
from lvnav_trade.sensors.jacobian_row import H_ATT


@jit
def _copy(target, source, n):
    for i in range(n):
        target[i] = source[i]


@jit
def _set_state(work, sigma_points, column, reach):
    """Set the navigation state to the sigma point at the estimate plus `reach` times a column of the factor."""
    _copy(work.nav, sigma_points.state, 10)
    for i in range(N_NAV):
        sigma_points.x[i] = reach * sigma_points.root[i, column]
    correct_motion(work.nav, sigma_points.x)


@jit
def _begin_regression(work, sigma_points, model):
    """Store the navigation state, replace it by the estimate, and factorise the covariance of navigation errors."""
    factorise(sigma_points.root, work.P, model, N_NAV)
    _copy(sigma_points.nav, work.nav, 10)
    correct_motion(work.nav, work.x)
    _copy(sigma_points.state, work.nav, 10)


@jit
def _store_rows(work, sigma_points, column, is_plus, first, n_row):
    """Store the innovations at a sigma point; after the second of a pair, odd and even parts of the prediction."""
    for row in range(first, first + n_row):
        if is_plus:
            sigma_points.row_odd[row, column] = work.z[row]
        else:
            plus = sigma_points.row_odd[row, column]
            minus = work.z[row]
            mean = 0.5 * (plus + minus)
            sigma_points.row_odd[row, column] = (-0.5 / REACH) * (plus - minus)
            sigma_points.row_even[row, column] = sigma_points.z[row] - mean


@jit
def _entry(state):
    """Return the entry of a Jacobian row for a navigation error: rows begin with position, attitude, velocity."""
    return (state + H_ATT - ATT) % N_NAV


@jit
def _regress(work, sigma_points, first, n_row):
    """Set the navigation entries of Jacobian rows to the regression slope over the sigma points.

    The slope solves root' h = odd part by back substitution. The innovation is shifted by the mean of the even parts;
    it remains relative to the uncorrected state. `sigma_points.residual_variance` is the variance that the slope does
    not explain.
    """
    for row in range(first, first + n_row):
        h = work.H[row]
        residual_variance = number_like(work.x[0], 0.0)
        shift = number_like(work.x[0], 0.0)
        for column in range(N_NAV - 1, -1, -1):
            slope = sigma_points.row_odd[row, column]
            for later_column in range(column + 1, N_NAV):
                later_slope = h[_entry(later_column)]
                slope = slope - later_slope * sigma_points.root[later_column, column]
            pivot = sigma_points.root[column, column]
            divisor = where(pivot > 0.0, pivot, 1.0)
            entry = _entry(column)
            h[entry] = where(pivot > 0.0, slope / divisor, 0.0)
            even = sigma_points.row_even[row, column]
            residual_variance = residual_variance + (1.0 / 3.0) * even * even
            shift = shift - (1.0 / 3.0) * even + h[entry] * work.x[column]
        work.z[row] = sigma_points.z[row] + shift
        sigma_points.residual_variance[row] = residual_variance


@jit
def _fill_receiver(work, optional_state, case, epoch):
    """Set the rows of the receiver's measurements at the present navigation state."""
    place_antenna(work, optional_state.state_history, case.options.delay_processing, case.model, case.step, epoch)
    fill_receiver(work, optional_state.previous_epoch, case.options.differences, case.model, case.signals, epoch)


@jit
def clear_residual_variance(sigma_points, first, n_row):
    """Set the unexplained variance of rows that are linearised by Jacobians to zero."""
    for row in range(first, first + n_row):
        sigma_points.residual_variance[row] = number_like(sigma_points.x[0], 0.0)


@inline_jit
def regress_receiver(work, optional_state, case, sigma_points, epoch):
    """Set the rows of the receiver's measurements by regression over the sigma points."""
    n_row = receiver_row_count(case.model, case.signals, epoch)
    _begin_regression(work, sigma_points, case.model)
    _fill_receiver(work, optional_state, case, epoch)
    _copy(sigma_points.z, work.z, n_row)
    for column in range(N_NAV):
        for side in range(2):
            _set_state(work, sigma_points, column, (1.0 - 2.0 * side) * REACH)
            _fill_receiver(work, optional_state, case, epoch)
            _store_rows(work, sigma_points, column, side == 0, 0, n_row)
    _copy(work.nav, sigma_points.state, 10)
    _fill_receiver(work, optional_state, case, epoch)
    _regress(work, sigma_points, 0, n_row)
    _copy(work.nav, sigma_points.nav, 10)
    place_antenna(work, optional_state.state_history, case.options.delay_processing, case.model, case.step, epoch)


@inline_jit
def regress_sensor(work, optional_state, case, sigma_points, k, epoch):
    """Set the rows of sensor k by regression over the sigma points."""
    n_row = case.sensors.scalars[k]
    first = sensor_row(case.model, work, case.sensors.channel[k])
    _begin_regression(work, sigma_points, case.model)
    fill_sensor_at_state(work, optional_state, case, k, epoch)
    for row in range(first, first + n_row):
        sigma_points.z[row] = work.z[row]
    for column in range(N_NAV):
        for side in range(2):
            _set_state(work, sigma_points, column, (1.0 - 2.0 * side) * REACH)
            fill_sensor_at_state(work, optional_state, case, k, epoch)
            _store_rows(work, sigma_points, column, side == 0, first, n_row)
    _copy(work.nav, sigma_points.state, 10)
    fill_sensor_at_state(work, optional_state, case, k, epoch)
    _regress(work, sigma_points, first, n_row)
    _copy(work.nav, sigma_points.nav, 10)
