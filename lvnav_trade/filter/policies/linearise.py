"""Choice between Jacobians and sigma points, for the propagation of a window and for the measurement rows.

An extended filter uses Jacobians, an unscented filter its sigma points (SigmaPoints, or None). Measurements compared
with a stored state are linearised at that state by Jacobians in both.
"""

from lvnav_trade.filter.ekf import fill_receiver, n_measured, predict_window, row_of
from lvnav_trade.filter.policies.open_loop import fill_sensor_at_state
from lvnav_trade.filter.policies.regression import clear_spread, regress_receiver, regress_sensor
from lvnav_trade.filter.policies.unscented import propagate_by_points
from lvnav_trade.kernels.jit import inlined, jit


@inlined
def propagate_estimate(work, case, sigma_points, open_loop, w):
    """Propagate covariance and estimates over window w: by the transition matrix, or by sigma points (SigmaPoints)."""
    if sigma_points is None:
        predict_window(work, case.model, case.schedule.length[w], case.schedule.injection[w])
    else:
        propagate_by_points(work, case, sigma_points, open_loop, w)


@jit
def is_receiver_stored(late):
    """Return whether measurements of the receiver are compared with a stored state (DelayProcessing, or None)."""
    if late is None:
        return False
    return not late.extrapolated and late.receiver >= 0


@jit
def is_sensor_stored(late, k):
    """Return whether measurements of sensor k are compared with a stored state (DelayProcessing, or None)."""
    return False if late is None else late.of_sensor[k] >= 0


@inlined
def fill_receiver_rows(work, parts, case, sigma_points, late, epoch):
    """Set Jacobian rows and innovations of the receiver's measurements.

    Parameters
    ----------
    sigma_points : SigmaPoints of an unscented filter, whose regression gives the rows; None: Jacobians
    late : DelayProcessing, or None. Measurements compared with a stored state have Jacobians in any case.
    """
    if sigma_points is None:
        fill_receiver(work, parts.previous_epoch, case.options.delayed, case.model, case.signals, epoch)
    elif is_receiver_stored(late):
        fill_receiver(work, parts.previous_epoch, case.options.delayed, case.model, case.signals, epoch)
        clear_spread(sigma_points, 0, n_measured(case.model, case.signals, epoch))
    else:
        regress_receiver(work, parts, case, sigma_points, epoch)


@inlined
def fill_sensor_rows(work, parts, case, sigma_points, late, k, epoch):
    """Set Jacobian rows and innovations of sensor k; parameters as in `fill_receiver_rows`."""
    if sigma_points is None:
        fill_sensor_at_state(work, parts, case, k, epoch)
    elif is_sensor_stored(late, k):
        fill_sensor_at_state(work, parts, case, k, epoch)
        clear_spread(sigma_points, row_of(case.model, work, case.sensors.channel[k]), case.sensors.scalars[k])
    else:
        regress_sensor(work, parts, case, sigma_points, k, epoch)
