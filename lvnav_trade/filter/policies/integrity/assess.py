"""Fault detection, isolation and recovery at one epoch, before its update; for one run or eight lanes.

Detection: each normalised innovation is tested alone, and the sum of squares of each channel over a window.

Isolation with ranges (Trigo and Theil, section 6.3 and figure 13): position and clock are fitted to the innovations. If
the residuals of the fit are significant, single satellites are excluded, the largest innovation first. If they are not,
the shifts of position and clock, each normalised by its covariance, show whether the inertial solution or the clock has
failed. If neither shift is significant, `common.py` tests whether all satellites disagree with the prediction, or one.

Isolation with a receiver solution, which has no redundancy: the solution is not used while it disagrees with the
prediction. If it still does after the hold time, the inertial solution has failed.
"""

from lvnav_trade.filter.ekf import channel_of, n_measured
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.filter.policies.integrity.common import compare, find_common, inflate, learn, persists
from lvnav_trade.filter.policies.integrity.state import N_FIT, clear_innovations, fit, limit
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.transition import POS, VEL
from lvnav_trade.quantities.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL
from lvnav_trade.sensors.jacobian_row import H_POS, H_VEL

RETURNING = 0.5
"""Value of `Monitor.out` at the end of the hold time: the channel is used again if it passes its test."""


@jit
def _innovation_variance(P, h, entries, columns):
    """Return h P h', the variance of an innovation due to the state."""
    total = like(P[0, 0], 0.0)
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
    zero = like(P[0, 0], 0.0)
    place = epoch // model.every % case.options.integrity.window
    for row in range(n_row):
        channel = channel_of(model, case.signals, epoch, row)
        monitor.weight[row] = zero
        monitor.square[row] = zero
        if not model.measured[channel] or not is_present(case.options.delayed, model, epoch, channel):
            continue
        n = model.n_entry[channel]
        entries = model.entry[channel, :n]
        columns = model.column[channel, :n]
        noise_variance = monitor.variance[row]
        state_variance = _innovation_variance(P, H[row], entries, columns)
        innovation_variance = state_variance + noise_variance
        is_measured = z[row] == z[row]
        in_use = (monitor.out[channel] <= RETURNING) & is_measured
        square = where(in_use, z[row] * z[row] / innovation_variance, 0.0)
        monitor.recent_squares[channel, place] = square
        monitor.square[row] = square
        monitor.weight[row] = where(in_use, 1.0 / noise_variance, 0.0)


@jit
def _count_down(monitor, ends):
    """Reduce every hold time by one epoch; a hold time that ends is set to `ends`."""
    for c in range(monitor.out.shape[0]):
        out = monitor.out[c]
        ended = where(out == 1.0, ends, 0.0)
        monitor.out[c] = where(out > 1.0, out - 1.0, ended)


@jit
def _exclude(monitor, tests, selected, n_kind, epoch, channel):
    """Exclude the satellite of a channel in the runs where `selected` is 1, and clear its stored innovations."""
    first = channel - channel % n_kind
    is_excluded = selected > 0.0
    for c in range(first, first + n_kind):
        monitor.out[c] = where(is_excluded, tests.hold, monitor.out[c])
        monitor.excluded[epoch, c] = where(is_excluded, 1.0, monitor.excluded[epoch, c])
        for k in range(monitor.recent_squares.shape[1]):
            monitor.recent_squares[c, k] = where(is_excluded, 0.0, monitor.recent_squares[c, k])


@jit
def _largest_square(monitor, kind, n_kind, n_row):
    """Return the largest squared normalised innovation of an observable over the rows in use."""
    largest = like(monitor.fit[0], 0.0)
    for row in range(kind, n_row, n_kind):
        square = where(monitor.weight[row] > 0.0, monitor.square[row], 0.0)
        largest = where(square > largest, square, largest)
    return largest


@jit
def _isolate_satellites(monitor, H, case, fails, first, kind, epoch, n_row):
    """Exclude satellites while the residuals of a fit to one observable are significant.

    The satellite with the largest innovation is excluded, not that with the largest residual: with two failures, the
    largest residual often belongs to a healthy satellite.

    Returns
    -------
    excluded_any : 1 where satellites were excluded
    agrees : 1 where the residuals of the remaining satellites are not significant
    """
    tests = case.options.integrity
    model = case.model
    excluded_any = like(fails, 0.0)
    agrees = like(fails, 0.0)
    for attempt in range(tests.exclusions + 1):
        residuals, dof = fit(monitor, H, monitor.z, first, kind, model.n_kind, n_row)
        threshold = limit(tests.consistent, dof)
        significant = where(residuals > threshold, 1.0, 0.0)
        agrees = where((dof >= 0.0) & (significant == 0.0), 1.0, 0.0)
        if attempt < tests.exclusions:
            largest = _largest_square(monitor, kind, model.n_kind, n_row)
            # an exclusion takes one of the redundant satellites
            is_faulty = (fails > 0.0) & (significant > 0.0) & (dof >= 1.0)
            faulty = where(is_faulty, 1.0, 0.0)
            excluded_any = where(faulty > 0.0, 1.0, excluded_any)
            for row in range(kind, n_row, model.n_kind):
                is_largest = (monitor.square[row] == largest) & (monitor.weight[row] > 0.0)
                selected = where((faulty > 0.0) & is_largest, 1.0, 0.0)
                _exclude_row(monitor, tests, selected, model, case.signals, epoch, row)
    return excluded_any, agrees


@jit
def _exclude_row(monitor, tests, selected, model, signals, epoch, row):
    """Exclude the satellite of a row, with all its observables, in the runs where `selected` is 1."""
    first = row - row % model.n_kind
    for k in range(model.n_kind):
        monitor.weight[first + k] = where(selected > 0.0, 0.0, monitor.weight[first + k])
    channel = channel_of(model, signals, epoch, row)
    _exclude(monitor, tests, selected, model.n_kind, epoch, channel)


@jit
def _count_out(monitor, model, signals, epoch, n_row):
    """Return the number of excluded satellites, and the number of satellites in use."""
    excluded = like(monitor.fit[0], 0.0)
    in_use = like(monitor.fit[0], 0.0)
    for row in range(0, n_row, model.n_kind):
        out = monitor.out[channel_of(model, signals, epoch, row)]
        excluded = where(out > 0.0, excluded + 1.0, excluded)
        in_use = where(out > 0.0, in_use, in_use + 1.0)
    return excluded, in_use


@jit
def _readmit(monitor, tests, running, model, signals, epoch, n_row):
    """Readmit satellites whose hold time is over, or exclude them again if they still disagree with the prediction.

    A failed satellite thus does not return into the fit of the healthy satellites. With fewer than five healthy
    satellites, or while an IMU error persists, the prediction itself may be wrong, so all satellites are readmitted.
    Returns 1 where satellites were excluded again.
    """
    renewed = like(monitor.fit[0], 0.0)
    _, healthy = _count_out(monitor, model, signals, epoch, n_row)
    imu_is_sound = persists(monitor) == 0.0
    trusted = where((healthy > N_FIT) & imu_is_sound, running, 0.0)
    for row in range(n_row):
        channel = channel_of(model, signals, epoch, row)
        returning = monitor.out[channel] == RETURNING
        disagrees = monitor.square[row] > tests.single
        selected = where(returning & (trusted > 0.0) & disagrees, 1.0, 0.0)
        _exclude_row(monitor, tests, selected, model, signals, epoch, row)
        renewed = where(selected > 0.0, 1.0, renewed)
    for c in range(monitor.out.shape[0]):
        monitor.out[c] = where(monitor.out[c] == RETURNING, 0.0, monitor.out[c])
    return renewed


@jit
def _is_detected(monitor, tests, model, signals, epoch, kind, n_row):
    """Return 1 where a row in use exceeds a limit, alone or in its window.

    kind : 0 ranges, 1 range rates, -1 all rows. Carrier phases and differences count with ranges and with range rates.
    """
    fails = like(monitor.fit[0], 0.0)
    for row in range(n_row):
        row_kind = row % model.n_kind if model.tight else -1
        if kind >= 0 and row_kind != kind and row_kind < 2:
            continue
        channel = channel_of(model, signals, epoch, row)
        window_sum = like(monitor.fit[0], 0.0)
        for k in range(monitor.recent_squares.shape[1]):
            window_sum = window_sum + monitor.recent_squares[channel, k]
        beyond = (monitor.square[row] > tests.single) | (window_sum > tests.windowed)
        fails = where((monitor.weight[row] > 0.0) & beyond, 1.0, fails)
    return fails


@jit
def _readmit_mistaken(monitor, tests, isolated, in_use):
    """Readmit satellites that were excluded before an inertial fault was isolated with four or fewer satellites in use:
    these exclusions were due to the wrong prediction.
    """
    for c in range(monitor.out.shape[0]):
        mistaken = (isolated == OF_INERTIAL) & (in_use <= N_FIT) & (monitor.out[c] < tests.hold)
        monitor.out[c] = where(mistaken, 0.0, monitor.out[c])


@jit
def _exclude_beyond(monitor, case, fails, isolated, epoch, n_row):
    """Exclude the satellites beyond their limits if the fault is neither a single satellite nor common to all; return
    the kind of fault.
    """
    tests = case.options.integrity
    model = case.model
    not_isolated = where(isolated == 0.0, fails, 0.0)
    for row in range(n_row):
        beyond = (monitor.square[row] > tests.single) & (monitor.weight[row] > 0.0)
        selected = where((not_isolated > 0.0) & beyond, 1.0, 0.0)
        channel = channel_of(model, case.signals, epoch, row)
        _exclude(monitor, tests, selected, model.n_kind, epoch, channel)
        isolated = where(selected > 0.0, OF_CHANNEL, isolated)
    return isolated


@jit
def _assess_ranges(monitor, work, case, running, epoch, n_row):
    """Isolate a fault by the ranges and range rates of an epoch, and recover from it; return the kind of fault.

    Range rates come first: a fault of velocity or clock drift is then also tested in position or clock bias.
    """
    tests = case.options.integrity
    P = work.P
    model = case.model
    signals = case.signals
    factor = tests.recovery * tests.recovery
    renewed = _readmit(monitor, tests, running, model, signals, epoch, n_row)
    any_detected = _is_detected(monitor, tests, model, signals, epoch, -1, n_row)
    fails = running * any_detected
    zero = like(fails, 0.0)
    isolated = zero
    motion_fault = zero
    clock_fault = zero
    speed = zero
    for step in range(2):
        kind = 1 - step
        first, state = (H_POS, POS) if kind == 0 else (H_VEL, VEL)
        clock_state = model.clock + kind
        excluded_any, agrees = _isolate_satellites(monitor, work.H, case, fails, first, kind, epoch, n_row)
        is_channel = (excluded_any > 0.0) & (isolated == 0.0)
        isolated = where(is_channel, OF_CHANNEL, isolated)
        suspected = agrees * fails
        kind_detected = _is_detected(monitor, tests, model, signals, epoch, kind, n_row)
        detected = suspected * kind_detected
        shift, drift, size, offset = compare(monitor, tests, P, state, clock_state)
        # a fault seen in the range rates need not be detected again in the ranges
        motion_suspected = suspected * where(motion_fault > 0.0, 1.0, detected)
        clock_suspected = suspected * where(clock_fault > 0.0, 1.0, detected)
        has_motion_shift = (shift > 1.0) & (motion_suspected > 0.0)
        has_clock_shift = (drift > 1.0) & (clock_suspected > 0.0)
        motion_shifted = where(has_motion_shift, 1.0, 0.0)
        clock_shifted = where(has_clock_shift, 1.0, 0.0)
        clock_fault = where(clock_shifted > 0.0, 1.0, clock_fault)
        is_motion = (clock_shifted == 0.0) | (shift > drift)
        motion_fault = where((motion_shifted > 0.0) & is_motion, 1.0, motion_fault)
        inflate(P, state, 3, motion_shifted, factor * size)
        inflate(P, clock_state, 1, clock_shifted, factor * offset)
        if kind == 1:
            speed = where(motion_shifted > 0.0, size, zero)
    isolated_or_inertial = where(motion_fault > 0.0, OF_INERTIAL, isolated)
    isolated = where(clock_fault > motion_fault, OF_CLOCK, isolated_or_inertial)
    excluded, in_use = _count_out(monitor, model, signals, epoch, n_row)
    not_isolated = where(isolated == 0.0, fails, 0.0)
    common, common_speed = find_common(monitor, work, case, not_isolated, excluded, n_row)
    isolated = where(common > 0.0, common, isolated)
    speed = where(common > 0.0, common_speed, speed)
    inertial = where(isolated == OF_INERTIAL, 1.0, 0.0)
    learn(monitor, tests, P, model, inertial, speed)
    _readmit_mistaken(monitor, tests, isolated, in_use)
    isolated = _exclude_beyond(monitor, case, fails, isolated, epoch, n_row)
    recovered = where(isolated > OF_CHANNEL, 1.0, 0.0)
    clear_innovations(monitor, recovered)
    only_renewed = (isolated == 0.0) & (renewed > 0.0)
    return where(only_renewed, OF_CHANNEL, isolated)


@jit
def _assess_solution(monitor, tests, P, fails, n_channel):
    """Exclude a solution that disagrees with the prediction; return the kind of fault.

    If the disagreement lasts for the hold time, the inertial solution has failed: the variances of position and
    velocity are inflated by the largest normalised innovation, and the solution is used again.
    """
    waited = where(fails > 0.0, monitor.waited[0] + 1.0, 0.0)
    over = where(waited >= tests.hold, 1.0, 0.0)
    largest = like(fails, 0.0)
    for row in range(6):
        square = monitor.square[row]
        largest = where(square > largest, square, largest)
    growth = where(over > 0.0, tests.recovery * tests.recovery * largest, 0.0)
    factor = 1.0 + growth
    for i in range(3):
        position = POS + i
        velocity = VEL + i
        P[position, position] = P[position, position] * factor
        P[velocity, velocity] = P[velocity, velocity] * factor
    rejected = (fails > 0.0) & (over == 0.0)
    for c in range(n_channel):
        monitor.out[c] = where(rejected, 1.0, monitor.out[c])
    clear_innovations(monitor, over)
    monitor.waited[0] = where(over > 0.0, 0.0, waited)
    channel_or_none = where(fails > 0.0, OF_CHANNEL, 0.0)
    return where(over > 0.0, OF_INERTIAL, channel_or_none)


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
    tests = case.options.integrity
    monitor.isolated[epoch] = like(monitor.fit[0], 0.0)
    for c in range(monitor.out.shape[0]):
        monitor.excluded[epoch, c] = like(monitor.fit[0], 0.0)
    _count_down(monitor, RETURNING if model.tight else 0.0)
    n_row = n_measured(model, signals, epoch)
    if n_row > 0:
        _test_rows(monitor, work.P, work.H, case, epoch, n_row)
        if model.tight:
            isolated = _assess_ranges(monitor, work, case, running, epoch, n_row)
        else:
            any_detected = _is_detected(monitor, tests, model, signals, epoch, -1, n_row)
            fails = running * any_detected
            isolated = _assess_solution(monitor, tests, work.P, fails, model.n_receiver)
        monitor.isolated[epoch] = isolated
