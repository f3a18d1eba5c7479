"""The filter's update by what is measured at an epoch, scalar by scalar."""

import numpy as np

from lvnav_trade.filters.delayed import correct_earlier, is_present
from lvnav_trade.filters.differenced import is_reference, leave_out, take_reference
from lvnav_trade.filters.ekf import channel_of, correct, n_measured, place_antenna, row_of
from lvnav_trade.filters.integrity.state import permitted
from lvnav_trade.filters.iterated import hold, linearise_receiver, linearise_sensor
from lvnav_trade.filters.unscented import measure_receiver, measure_sensor
from lvnav_trade.kernels.covariance import update_scalar, update_with_gain
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where


@jit
def _assumed(work, points, signals, epoch, row, channel):
    """Return the variance that the filter assumes of a row, with what its points (Points, or None) leave of it."""
    variance = like(work.x[0], signals.variance[epoch, channel])
    return variance if points is None else variance + points.spread[row]


@jit
def noise_variance(work, points, gains, signals, epoch, row, channel, whitened):
    """Return the variance of a row's noise as the filter assumes it. Of a solution that comes with a covariance
    (whitened) rows are decorrelated, of variance one; with stored gains (Gains, or None) they are not.
    """
    if whitened:
        return like(work.x[0], 1.0) if gains is None else work.reported[row, row]
    return _assumed(work, points, signals, epoch, row, channel)


@inlined
def update_and_count(work, points, gains, model, signals, epoch, row, channel, whitened, gate_squared):
    """Update by one filled row of a channel, with a stored gain (Gains) or, without (None), that of the covariance;
    store its innovation and count it: accepted, or rejected by the gate.
    """
    n = model.n_entry[channel]
    entries, columns = model.entry[channel, :n], model.column[channel, :n]
    variance = noise_variance(work, points, gains, signals, epoch, row, channel, whitened)
    if gains is None:
        normalised, weight = update_scalar(
            work.P, work.x, work.K, work.H[row], entries, columns, work.z[row], variance, gate_squared,
            model.n_estimated, model.joseph, signals.beta[epoch, channel],
        )  # fmt: skip
    else:
        normalised, weight = update_with_gain(
            work.P, work.x, work.K, work.H[row], entries, columns, gains.gain[epoch, channel], work.z[row], variance,
            gate_squared, model.n_estimated, signals.beta[epoch, channel],
        )  # fmt: skip
    work.innovation[epoch, channel] = normalised
    accepted = weight > 0.0
    rejected = (normalised == normalised) & (weight == 0.0)  # what is not a number is no row
    work.nis[epoch] = work.nis[epoch] + where(accepted, normalised * normalised, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(accepted, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(rejected, 1.0, 0.0)


@jit
def _correct_receiver_row(work, points, past, earlier, late, delayed, direct, model, signals, epoch, dt):
    """In a direct filter (direct, or None) correct the total state by a row, and linearise the rows that are left at
    it. A solution with a covariance of its own is one measurement: it is linearised once.
    """
    if direct is not None and not model.has_covariance:
        correct_earlier(work.x, earlier, delayed, model)
        correct(work, past, late, model)
        place_antenna(work, past, late, model, dt, epoch)
        measure_receiver(work, points, past, earlier, late, delayed, model, signals, epoch, dt)


@inlined
def update_receiver(
    work, points, past, earlier, late, delayed, direct, own, gains, model, signals, epoch, dt, gate_squared, starts
):
    """Update by what the receiver measures at an epoch: the observables of every satellite in use, or position and
    velocity of a solution axis by axis, as far as they are among the filter's measurements and not excluded (own:
    Monitor, or None). starts: where the filter starts at this epoch (lanes), or None.
    """
    n_row = n_measured(model, signals, epoch)
    limit = where(gate_squared >= 0.0, np.inf, gate_squared)
    take_reference(work, own, delayed, model, signals, epoch, n_row, limit, starts)
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        if is_present(delayed, model, epoch, channel) and not is_reference(model, signals, epoch, row):
            leave_out(work.z, starts, delayed, model, row)
            whitened, gate = model.has_covariance, permitted(own, channel, gate_squared)
            update_and_count(work, points, gains, model, signals, epoch, row, channel, whitened, gate)
            _correct_receiver_row(work, points, past, earlier, late, delayed, direct, model, signals, epoch, dt)
    _correct_at_once(work, past, late, direct, model)


@jit
def is_stored(late):
    """Return whether what the receiver measures is compared with a stored state (Late, or None)."""
    if late is None:
        return False
    return not late.extrapolated and late.line[0] >= 0


@jit
def iterate_receiver(
    work, again, passes, rx, past, earlier, late, delayed, own, gains, model, signals, epoch, dt, gate_squared, starts
):
    """Repeat the update by what the receiver measures, with rows linearised at what it has found (Again and Passes, or
    None).
    """
    if again is not None:
        for _ in range(0 if is_stored(late) else passes.repeats):
            linearise_receiver(work, again, passes, rx, past, earlier, late, delayed, gains, model, signals, epoch, dt)
            update_receiver(
                work, None, past, earlier, late, delayed, None, own, gains, model, signals, epoch, dt, gate_squared,
                starts,
            )  # fmt: skip


@jit
def _iterate_sensor(
    work, again, passes, past, open_loop, late, gains, sensors, model, signals, epoch, gate_squared, k, at
):
    """Do the same with what sensor k measures."""
    if again is not None:
        for _ in range(0 if late is not None and late.of_sensor[k] >= 0 else passes.repeats):
            linearise_sensor(work, again, passes, past, open_loop, late, model, signals, sensors, k, at, epoch)
            for i in range(sensors.scalars[k]):
                update_and_count(
                    work, None, gains, model, signals, epoch, at + i, sensors.channel[k] + i, False, gate_squared
                )


@jit
def _correct_at_once(work, past, late, direct, model):
    """Correct the total state of a direct filter (direct, or None)."""
    if direct is not None:
        correct(work, past, late, model)


@inlined
def update_sensors(
    work, points, again, passes, past, open_loop, direct, late, gains, sensors, model, signals, epoch, gate_squared
):
    """Update by what the sensors beside the receiver (Sensors, or None) measure at an epoch."""
    if sensors is not None:
        for k in range(sensors.code.shape[0]):
            if sensors.on[k, epoch] and model.measured[sensors.channel[k]]:
                at = row_of(model, work, sensors.channel[k])
                measure_sensor(work, points, past, open_loop, late, model, signals, sensors, k, at, epoch)
                hold(again, work, epoch)
                for i in range(sensors.scalars[k]):
                    update_and_count(
                        work, points, gains, model, signals, epoch, at + i, sensors.channel[k] + i, False, gate_squared
                    )
                    if direct is not None:
                        correct(work, past, late, model)
                        measure_sensor(work, points, past, open_loop, late, model, signals, sensors, k, at, epoch)
                _iterate_sensor(
                    work, again, passes, past, open_loop, late, gains, sensors, model, signals, epoch, gate_squared, k,
                    at,
                )  # fmt: skip
