"""Fault detection, isolation and recovery at one epoch, before its update; for one run or eight lanes.

Detection: each normalised innovation is tested alone, and the sum of squares of each channel over a window.

Isolation with ranges (Trigo and Theil, section 6.3 and figure 13): position and clock are fitted to the innovations. If
the residuals of the fit are significant, single satellites are excluded, the largest innovation first. If they are not,
the shifts of position and clock, each normalised by its covariance, show whether the inertial solution or the clock has
failed. If neither shift is significant, `common.py` tests whether all satellites disagree with the prediction, or one.

Isolation with a receiver solution, which has no redundancy: the solution is not used while it disagrees with the
prediction. If it still does after the hold time, the inertial solution has failed.
"""

from lvnav_trade.filter.ekf import receiver_channel, receiver_row_count
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.filter.policies.integrity.common import (
    compare_shifts,
    count_inertial_faults,
    has_persistent_error,
    inflate,
    isolate_common_fault,
)
from lvnav_trade.filter.policies.integrity.state import N_FIT, clear_innovations, fit, limit
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.quantities.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL
from lvnav_trade.sensors.jacobian_row import H_POS, H_VEL

RETURNING = 0.5
"""Value of `Monitor.remaining_hold` at the end of the hold time: the channel is used again if it passes its test."""


@jit
def _innovation_variance(P, h, entries, columns):
    """Return h P h', the variance of an innovation due to the state."""
    total = number_like(P[0, 0], 0.0)
    for i in range(columns.shape[0]):
        for j in range(columns.shape[0]):
            covariance = P[columns[i], columns[j]]
            total = total + h[entries[i]] * covariance * h[entries[j]]
    return total


@jit
def _test_rows(monitor, P, H, case, epoch, n_row):
    """Set the squared normalised innovation and the weight (inverse noise variance) of every row in use."""
    model = case.model
    z = monitor.z
    zero = number_like(P[0, 0], 0.0)
    place = epoch // model.decimation % case.options.fault_tests.window
    for row in range(n_row):
        channel = receiver_channel(model, case.signals, epoch, row)
        monitor.weight[row] = zero
        monitor.square[row] = zero
        if not model.is_processed[channel] or not is_present(case.options.differences, model, epoch, channel):
            continue
        n = model.n_entry[channel]
        entries = model.entry[channel, :n]
        columns = model.column[channel, :n]
        noise_variance = monitor.variance[row]
        state_variance = _innovation_variance(P, H[row], entries, columns)
        innovation_variance = state_variance + noise_variance
        is_measured = z[row] == z[row]
        is_active = (monitor.remaining_hold[channel] <= RETURNING) & is_measured
        square = where(is_active, z[row] * z[row] / innovation_variance, 0.0)
        monitor.recent_squares[channel, place] = square
        monitor.square[row] = square
        monitor.weight[row] = where(is_active, 1.0 / noise_variance, 0.0)


@jit
def _count_down(monitor, expiry_value):
    """Reduce every hold time by one epoch; a hold time that ends is set to `expiry_value`."""
    for c in range(monitor.remaining_hold.shape[0]):
        remaining_hold = monitor.remaining_hold[c]
        expired_hold = where(remaining_hold == 1.0, expiry_value, 0.0)
        monitor.remaining_hold[c] = where(remaining_hold > 1.0, remaining_hold - 1.0, expired_hold)


@jit
def _exclude(monitor, tests, selection, n_observable, epoch, channel):
    """Exclude the satellite of a channel in the runs where `selection` is 1, and clear its stored innovations."""
    first = channel - channel % n_observable
    is_excluded = selection > 0.0
    for c in range(first, first + n_observable):
        monitor.remaining_hold[c] = where(is_excluded, tests.hold, monitor.remaining_hold[c])
        monitor.is_excluded[epoch, c] = where(is_excluded, 1.0, monitor.is_excluded[epoch, c])
        for k in range(monitor.recent_squares.shape[1]):
            monitor.recent_squares[c, k] = where(is_excluded, 0.0, monitor.recent_squares[c, k])


@jit
def _largest_square(monitor, observable, n_observable, n_row):
    """Return the largest squared normalised innovation of an observable over the rows in use."""
    largest = number_like(monitor.fit[0], 0.0)
    for row in range(observable, n_row, n_observable):
        square = where(monitor.weight[row] > 0.0, monitor.square[row], 0.0)
        largest = where(square > largest, square, largest)
    return largest


@jit
def _isolate_satellites(monitor, H, case, has_fault, first, observable, epoch, n_row):
    """Exclude satellites while the residuals of a fit to one observable are significant.

    The satellite with the largest innovation is excluded, not that with the largest residual: with two failures, the
    largest residual often belongs to a healthy satellite.

    Returns
    -------
    has_exclusion : 1 where satellites were excluded
    is_consistent : 1 where the residuals of the remaining satellites are not significant
    """
    tests = case.options.fault_tests
    model = case.model
    has_exclusion = number_like(has_fault, 0.0)
    is_consistent = number_like(has_fault, 0.0)
    for attempt in range(tests.exclusions + 1):
        residuals, dof = fit(monitor, H, monitor.z, first, observable, model.n_observable, n_row)
        threshold = limit(tests.residual_limits, dof)
        is_significant = where(residuals > threshold, 1.0, 0.0)
        is_consistent = where((dof >= 0.0) & (is_significant == 0.0), 1.0, 0.0)
        if attempt < tests.exclusions:
            largest = _largest_square(monitor, observable, model.n_observable, n_row)
            # an exclusion takes one of the redundant satellites
            is_faulty = (has_fault > 0.0) & (is_significant > 0.0) & (dof >= 1.0)
            fault_mask = where(is_faulty, 1.0, 0.0)
            has_exclusion = where(fault_mask > 0.0, 1.0, has_exclusion)
            for row in range(observable, n_row, model.n_observable):
                is_largest = (monitor.square[row] == largest) & (monitor.weight[row] > 0.0)
                selection = where((fault_mask > 0.0) & is_largest, 1.0, 0.0)
                _exclude_row(monitor, tests, selection, model, case.signals, epoch, row)
    return has_exclusion, is_consistent


@jit
def _exclude_row(monitor, tests, selection, model, signals, epoch, row):
    """Exclude the satellite of a row, with all its observables, in the runs where `selection` is 1."""
    first = row - row % model.n_observable
    for k in range(model.n_observable):
        monitor.weight[first + k] = where(selection > 0.0, 0.0, monitor.weight[first + k])
    channel = receiver_channel(model, signals, epoch, row)
    _exclude(monitor, tests, selection, model.n_observable, epoch, channel)


@jit
def _count_excluded(monitor, model, signals, epoch, n_row):
    """Return the number of excluded satellites, and the number of satellites in use."""
    excluded_count = number_like(monitor.fit[0], 0.0)
    active_count = number_like(monitor.fit[0], 0.0)
    for row in range(0, n_row, model.n_observable):
        remaining_hold = monitor.remaining_hold[receiver_channel(model, signals, epoch, row)]
        excluded_count = where(remaining_hold > 0.0, excluded_count + 1.0, excluded_count)
        active_count = where(remaining_hold > 0.0, active_count, active_count + 1.0)
    return excluded_count, active_count


@jit
def _readmit(monitor, tests, running, model, signals, epoch, n_row):
    """Readmit satellites whose hold time is over, or exclude them again if they still disagree with the prediction.

    A failed satellite thus does not return into the fit of the healthy satellites. With fewer than five healthy
    satellites, or while an IMU error persists, the prediction itself may be wrong, so all satellites are readmitted.
    Returns 1 where satellites were excluded again.
    """
    repeat_exclusion = number_like(monitor.fit[0], 0.0)
    _, healthy_count = _count_excluded(monitor, model, signals, epoch, n_row)
    imu_is_sound = has_persistent_error(monitor) == 0.0
    is_prediction_sound = where((healthy_count > N_FIT) & imu_is_sound, running, 0.0)
    for row in range(n_row):
        channel = receiver_channel(model, signals, epoch, row)
        is_returning = monitor.remaining_hold[channel] == RETURNING
        is_inconsistent = monitor.square[row] > tests.single_limit
        selection = where(is_returning & (is_prediction_sound > 0.0) & is_inconsistent, 1.0, 0.0)
        _exclude_row(monitor, tests, selection, model, signals, epoch, row)
        repeat_exclusion = where(selection > 0.0, 1.0, repeat_exclusion)
    for c in range(monitor.remaining_hold.shape[0]):
        monitor.remaining_hold[c] = where(monitor.remaining_hold[c] == RETURNING, 0.0, monitor.remaining_hold[c])
    return repeat_exclusion


@jit
def _is_detected(monitor, tests, model, signals, epoch, observable, n_row):
    """Return 1 where a row in use exceeds a limit, alone or in its window.

    observable : 0 ranges, 1 range rates, -1 all rows. Carrier phases and differences count with ranges and with range
        rates.
    """
    has_fault = number_like(monitor.fit[0], 0.0)
    for row in range(n_row):
        row_observable = row % model.n_observable if model.tight else -1
        if observable >= 0 and row_observable != observable and row_observable < 2:
            continue
        channel = receiver_channel(model, signals, epoch, row)
        window_sum = number_like(monitor.fit[0], 0.0)
        for k in range(monitor.recent_squares.shape[1]):
            window_sum = window_sum + monitor.recent_squares[channel, k]
        is_beyond_limit = (monitor.square[row] > tests.single_limit) | (window_sum > tests.window_limit)
        has_fault = where((monitor.weight[row] > 0.0) & is_beyond_limit, 1.0, has_fault)
    return has_fault


@jit
def _readmit_after_inertial_fault(monitor, tests, fault_type, active_count):
    """Readmit satellites that were excluded before an inertial fault was isolated with four or fewer satellites in use:
    these exclusions were due to the wrong prediction.
    """
    for c in range(monitor.remaining_hold.shape[0]):
        is_mistaken = (fault_type == OF_INERTIAL) & (active_count <= N_FIT) & (monitor.remaining_hold[c] < tests.hold)
        monitor.remaining_hold[c] = where(is_mistaken, 0.0, monitor.remaining_hold[c])


@jit
def _exclude_beyond_limits(monitor, case, has_fault, fault_type, epoch, n_row):
    """Exclude the satellites beyond their limits if the fault is neither a single satellite nor common to all; return
    the kind of fault.
    """
    tests = case.options.fault_tests
    model = case.model
    open_fault = where(fault_type == 0.0, has_fault, 0.0)
    for row in range(n_row):
        is_beyond_limit = (monitor.square[row] > tests.single_limit) & (monitor.weight[row] > 0.0)
        selection = where((open_fault > 0.0) & is_beyond_limit, 1.0, 0.0)
        channel = receiver_channel(model, case.signals, epoch, row)
        _exclude(monitor, tests, selection, model.n_observable, epoch, channel)
        fault_type = where(selection > 0.0, OF_CHANNEL, fault_type)
    return fault_type


@jit
def _assess_ranges(monitor, work, case, running, epoch, n_row):
    """Isolate a fault by the ranges and range rates of an epoch, and recover from it; return the kind of fault.

    Range rates come first: a fault of velocity or clock drift is then also tested in position or clock bias.
    """
    tests = case.options.fault_tests
    P = work.P
    model = case.model
    signals = case.signals
    factor = tests.recovery * tests.recovery
    repeat_exclusion = _readmit(monitor, tests, running, model, signals, epoch, n_row)
    any_fault = _is_detected(monitor, tests, model, signals, epoch, -1, n_row)
    has_fault = running * any_fault
    zero = number_like(has_fault, 0.0)
    fault_type = zero
    motion_fault = zero
    clock_fault = zero
    speed = zero
    for step in range(2):
        observable = 1 - step
        first, state = (H_POS, POS) if observable == 0 else (H_VEL, VEL)
        clock_state = model.clock + observable
        has_exclusion, is_consistent = _isolate_satellites(
            monitor, work.H, case, has_fault, first, observable, epoch, n_row
        )
        is_channel = (has_exclusion > 0.0) & (fault_type == 0.0)
        fault_type = where(is_channel, OF_CHANNEL, fault_type)
        consistent_fault = is_consistent * has_fault
        observable_fault = _is_detected(monitor, tests, model, signals, epoch, observable, n_row)
        detected_fault = consistent_fault * observable_fault
        shift, drift, size, offset = compare_shifts(monitor, tests, P, state, clock_state)
        # a fault seen in the range rates need not be detected again in the ranges
        motion_candidate = consistent_fault * where(motion_fault > 0.0, 1.0, detected_fault)
        clock_candidate = consistent_fault * where(clock_fault > 0.0, 1.0, detected_fault)
        has_motion_shift = (shift > 1.0) & (motion_candidate > 0.0)
        has_clock_shift = (drift > 1.0) & (clock_candidate > 0.0)
        motion_shift_mask = where(has_motion_shift, 1.0, 0.0)
        clock_shift_mask = where(has_clock_shift, 1.0, 0.0)
        clock_fault = where(clock_shift_mask > 0.0, 1.0, clock_fault)
        is_motion = (clock_shift_mask == 0.0) | (shift > drift)
        motion_fault = where((motion_shift_mask > 0.0) & is_motion, 1.0, motion_fault)
        inflate(P, state, 3, motion_shift_mask, factor * size)
        inflate(P, clock_state, 1, clock_shift_mask, factor * offset)
        if observable == 1:
            speed = where(motion_shift_mask > 0.0, size, zero)
    channel_or_inertial = where(motion_fault > 0.0, OF_INERTIAL, fault_type)
    fault_type = where(clock_fault > motion_fault, OF_CLOCK, channel_or_inertial)
    excluded_count, active_count = _count_excluded(monitor, model, signals, epoch, n_row)
    open_fault = where(fault_type == 0.0, has_fault, 0.0)
    common_fault_type, common_speed = isolate_common_fault(monitor, work, case, open_fault, excluded_count, n_row)
    fault_type = where(common_fault_type > 0.0, common_fault_type, fault_type)
    speed = where(common_fault_type > 0.0, common_speed, speed)
    is_inertial = where(fault_type == OF_INERTIAL, 1.0, 0.0)
    count_inertial_faults(monitor, tests, P, model, is_inertial, speed)
    _readmit_after_inertial_fault(monitor, tests, fault_type, active_count)
    fault_type = _exclude_beyond_limits(monitor, case, has_fault, fault_type, epoch, n_row)
    is_recovery = where(fault_type > OF_CHANNEL, 1.0, 0.0)
    clear_innovations(monitor, is_recovery)
    is_repeat_only = (fault_type == 0.0) & (repeat_exclusion > 0.0)
    return where(is_repeat_only, OF_CHANNEL, fault_type)


@jit
def _assess_solution(monitor, tests, P, has_fault, n_channel):
    """Exclude a solution that disagrees with the prediction; return the kind of fault.

    If the disagreement lasts for the hold time, the inertial solution has failed: the variances of position and
    velocity are inflated by the largest normalised innovation, and the solution is used again.
    """
    fault_epochs = where(has_fault > 0.0, monitor.fault_counters[0] + 1.0, 0.0)
    has_expired = where(fault_epochs >= tests.hold, 1.0, 0.0)
    largest = number_like(has_fault, 0.0)
    for row in range(6):
        square = monitor.square[row]
        largest = where(square > largest, square, largest)
    growth = where(has_expired > 0.0, tests.recovery * tests.recovery * largest, 0.0)
    factor = 1.0 + growth
    for i in range(3):
        position = POS + i
        velocity = VEL + i
        P[position, position] = P[position, position] * factor
        P[velocity, velocity] = P[velocity, velocity] * factor
    is_rejected = (has_fault > 0.0) & (has_expired == 0.0)
    for c in range(n_channel):
        monitor.remaining_hold[c] = where(is_rejected, 1.0, monitor.remaining_hold[c])
    clear_innovations(monitor, has_expired)
    monitor.fault_counters[0] = where(has_expired > 0.0, 0.0, fault_epochs)
    channel_or_none = where(has_fault > 0.0, OF_CHANNEL, 0.0)
    return where(has_expired > 0.0, OF_INERTIAL, channel_or_none)


@jit
def assess(monitor, work, case, running, epoch):
    """Test the receiver's measurements of an epoch, exclude failed satellites or recover, and log the decision.

    Parameters
    ----------
    monitor : Monitor, with `z` and `variance` of the rows
    work : arrays of the run, with Jacobian rows and predicted covariance; recovery inflates the covariance
    case : FilterCase
    running : 1 in the runs whose filter runs
    epoch : index
    """
    model = case.model
    signals = case.signals
    tests = case.options.fault_tests
    monitor.fault_type[epoch] = number_like(monitor.fit[0], 0.0)
    for c in range(monitor.remaining_hold.shape[0]):
        monitor.is_excluded[epoch, c] = number_like(monitor.fit[0], 0.0)
    _count_down(monitor, RETURNING if model.tight else 0.0)
    n_row = receiver_row_count(model, signals, epoch)
    if n_row > 0:
        _test_rows(monitor, work.P, work.H, case, epoch, n_row)
        if model.tight:
            fault_type = _assess_ranges(monitor, work, case, running, epoch, n_row)
        else:
            any_fault = _is_detected(monitor, tests, model, signals, epoch, -1, n_row)
            has_fault = running * any_fault
            fault_type = _assess_solution(monitor, tests, work.P, has_fault, model.n_receiver)
        monitor.fault_type[epoch] = fault_type
