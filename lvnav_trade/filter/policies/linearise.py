"""Choice between Jacobians and sigma points, for the propagation of a window and for the measurement rows.

An extended filter uses Jacobians, an unscented filter its sigma points (SigmaPoints, or None). Measurements compared
with a stored state are linearised at that state by Jacobians in both.
"""

from lvnav_trade.filter.ekf import fill_receiver, predict_window, receiver_row_count, sensor_row
from lvnav_trade.filter.policies.open_loop import fill_sensor_at_state
from lvnav_trade.filter.policies.regression import clear_residual_variance, regress_receiver, regress_sensor
from lvnav_trade.filter.policies.unscented import propagate_by_points
from lvnav_trade.kernels.jit import inline_jit, jit


@inline_jit
def propagate_estimate(work, case, sigma_points, open_loop, w):
    """Propagate covariance and estimates over window w: by the transition matrix, or by sigma points (SigmaPoints)."""
    if sigma_points is None:
        predict_window(work, case.model, case.schedule.length_index[w], case.schedule.injection[w])
    else:
        propagate_by_points(work, case, sigma_points, open_loop, w)


@jit
def is_receiver_stored(delays):
    """Return whether measurements of the receiver are compared with a stored state (DelayProcessing, or None)."""
    if delays is None:
        return False
    return not delays.is_extrapolated and delays.receiver_line >= 0


@jit
def is_sensor_stored(delays, k):
    """Return whether measurements of sensor k are compared with a stored state (DelayProcessing, or None)."""
    return False if delays is None else delays.sensor_line[k] >= 0


@inline_jit
def fill_receiver_rows(work, optional_state, case, sigma_points, delays, epoch):
    """Set Jacobian rows and innovations of the receiver's measurements.

    Parameters
    ----------
    sigma_points : SigmaPoints of an unscented filter, whose regression gives the rows; None: Jacobians
    delays : DelayProcessing, or None. Measurements compared with a stored state have Jacobians in any case.
    """
    if sigma_points is None:
        fill_receiver(work, optional_state.previous_epoch, case.options.differences, case.model, case.signals, epoch)
    elif is_receiver_stored(delays):
        fill_receiver(work, optional_state.previous_epoch, case.options.differences, case.model, case.signals, epoch)
        clear_residual_variance(sigma_points, 0, receiver_row_count(case.model, case.signals, epoch))
    else:
        regress_receiver(work, optional_state, case, sigma_points, epoch)


@inline_jit
def fill_sensor_rows(work, optional_state, case, sigma_points, delays, k, epoch):
    """Set Jacobian rows and innovations of sensor k; parameters as in `fill_receiver_rows`."""
    if sigma_points is None:
        fill_sensor_at_state(work, optional_state, case, k, epoch)
    elif is_sensor_stored(delays, k):
        fill_sensor_at_state(work, optional_state, case, k, epoch)
        first_row = sensor_row(case.model, work, case.sensors.channel[k])
        clear_residual_variance(sigma_points, first_row, case.sensors.scalars[k])
    else:
        regress_sensor(work, optional_state, case, sigma_points, k, epoch)
