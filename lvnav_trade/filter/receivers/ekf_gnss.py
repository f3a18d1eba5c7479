"""The receiver's Kalman filter: position, velocity, acceleration and clock from ranges and range rates (EKF-GNSS).

Canepa and Servidia, section 4.2, in frame i and with the kernels of the navigation filter: acceleration takes the place
of attitude in `predict`, and the Jacobian rows are those of tight coupling without a lever arm. The driving jerk (or,
without acceleration states, the acceleration) is constant over the interval: its covariance is g q g' per axis with
g = (T, T^2/2, T^3/6), added after the propagation as in eq. 4.8 and 4.16. A diagonal noise, added half before and half
after the propagation, would give nearly twice the position variance.

The noise is adapted by the acceleration between the last two point solutions (eq. 4.23 to 4.28). The point solution of
an epoch is computed first, so that it already affects the propagation to that epoch. Without a new point solution the
acceleration does not change.
"""

import numpy as np

from lvnav_trade.filter.receivers.bancroft import fix, solution
from lvnav_trade.filter.receivers.receiver import (
    ACC,
    ACCELERATION,
    BIAS,
    DRIFT,
    FIX_BIAS,
    FIX_DRIFT,
    FIX_POS,
    FIX_VEL,
    FULL,
    IDLE,
    LAST_VELOCITY,
    MISSES,
    N_STATE,
    NO_FIX,
    PARTIAL,
    POS,
    PROPAGATED,
    SINCE,
    STARTED,
    VEL,
)
from lvnav_trade.kernels.covariance import predict, update_scalar
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import magnitude, number_like, sqrt, where
from lvnav_trade.quantities.line_of_sight import line_of_sight
from lvnav_trade.sensors.jacobian_row import H_CLOCK, H_POS, H_VEL, N_ENTRY
from lvnav_trade.sensors.ranges import range_row, rate_row

RANGE_ENTRIES = np.array([H_POS, H_POS + 1, H_POS + 2, H_CLOCK])
RANGE_COLUMNS = np.array([POS, POS + 1, POS + 2, BIAS])
RATE_ENTRIES = np.array([H_POS, H_POS + 1, H_POS + 2, H_VEL, H_VEL + 1, H_VEL + 2, H_CLOCK])
RATE_COLUMNS = np.array([POS, POS + 1, POS + 2, VEL, VEL + 1, VEL + 2, DRIFT])


@jit
def _larger(a, b):
    return where(a > b, a, b)


@jit
def adapted_variances(ax, ay, az, model):
    """Return the variances under an acceleration (m/s^2): driving noise by axis (3), range, range rate.

    Eq. 4.25 to 4.28 (4.27 with the acceleration along z). With zero gains they are the constant floors. Linear
    covariance uses the difference of nominal velocities, Monte Carlo runs that of noisy point solutions.
    """
    size = sqrt(ax * ax + ay * ay + az * az)
    drive_x = _larger(model.drive_gain * ax * ax, model.drive_floor)
    drive_y = _larger(model.drive_gain * ay * ay, model.drive_floor)
    drive_z = _larger(model.drive_gain * az * az, model.drive_floor)
    range_variance = _larger(model.range_gain * size, model.range_floor)
    rate_variance = _larger(model.rate_gain * size, model.rate_floor)
    return drive_x, drive_y, drive_z, range_variance, rate_variance


@jit
def add_driving_noise(P, model, x, y, z):
    """Add the process noise of an interval to the covariance: driving variances x, y, z by axis, and clock noise."""
    variance = (x, y, z)
    blocks = (ACC, VEL, POS)
    for i in range(3):
        for first in range(3):
            for second in range(3):
                row = blocks[first] + i
                column = blocks[second] + i
                gain_product = model.drive[first] * model.drive[second]
                P[row, column] = P[row, column] + gain_product * variance[i]
    interval = model.interval
    clock_gain = (0.5 * interval * interval, interval)
    for i in range(2):
        for j in range(2):
            clock_covariance = clock_gain[i] * clock_gain[j] * model.clock
            P[BIAS + i, BIAS + j] = P[BIAS + i, BIAS + j] + clock_covariance


@jit
def propagate(receiver, model, x, y, z):
    """Propagate state and covariance over an interval, with driving variances x, y, z."""
    nav = receiver.nav
    interval = model.interval
    for i in range(3):
        velocity = nav[VEL + i]
        acceleration = nav[ACC + i]
        nav[POS + i] = nav[POS + i] + interval * velocity + model.position_effect * acceleration
        nav[VEL + i] = velocity + model.velocity_effect * acceleration
        nav[ACC + i] = model.decay * acceleration
    nav[BIAS] = nav[BIAS] + interval * nav[DRIFT]
    predict(
        receiver.P,
        model.blocks,
        model.rows,
        model.columns,
        model.unit_decay,
        model.zero_noise,
        BIAS,
        model.interval,
    )
    add_driving_noise(receiver.P, model, x, y, z)


@jit
def _update_acceleration(receiver, model, has_fix):
    """Set the acceleration to the velocity difference of the last two point solutions over the time between them."""
    memory = receiver.memory
    has_earlier = memory[SINCE] >= 0.0
    seconds = where(has_earlier, memory[SINCE] + model.interval, model.interval)
    has_both = has_fix & has_earlier
    for i in range(3):
        velocity = receiver.fix[FIX_VEL + i]
        acceleration = (velocity - memory[LAST_VELOCITY + i]) / seconds
        memory[ACCELERATION + i] = where(has_both, acceleration, memory[ACCELERATION + i])
        memory[LAST_VELOCITY + i] = where(has_fix, velocity, memory[LAST_VELOCITY + i])
    earlier_fix_age = where(has_earlier, seconds, -1.0)
    memory[SINCE] = where(has_fix, 0.0, earlier_fix_age)


@jit
def _update_scalar(receiver, model, innovation, limit, variance, entries, columns):
    """Update by the scalar measurement with Jacobian row h, scaled to unit variance.

    Returns 1 if it was accepted (else 0), and the normalised innovation.
    """
    scale = 1.0 / sqrt(variance)
    for e in range(N_ENTRY):
        receiver.h[e] = receiver.h[e] * scale
    innovation = where(magnitude(innovation) <= limit, innovation * scale, np.nan)
    normalised_innovation, weight = update_scalar(
        receiver.P,
        receiver.x,
        receiver.K,
        receiver.h,
        entries,
        columns,
        innovation,
        1.0,
        model.gate_squared,
        N_STATE,
        False,
    )
    return where(weight > 0.0, 1.0, 0.0), normalised_innovation


@jit
def _begin_update(receiver):
    """Set the state at which the measurements of an epoch are linearised; clear error state and innovations."""
    nav = receiver.nav
    zero = number_like(nav[0], 0.0)
    for i in range(3):
        receiver.antenna_state[i] = nav[POS + i]
        receiver.antenna_state[3 + i] = nav[VEL + i]
        receiver.antenna_state[6 + i] = zero
        receiver.antenna_state[9 + i] = zero
    for i in range(N_STATE):
        receiver.x[i] = zero
    for channel in range(receiver.innovation.shape[0]):
        receiver.innovation[channel] = number_like(zero, np.nan)


@jit
def _update_ranges(receiver, model, satellite, satellite_velocity, slot_satellites, n_used, ranges, variances):
    """Process the measurements of the satellites in use, all linearised about the same state.

    Returns the numbers of measurements, of accepted measurements, and of satellites with an accepted measurement.

    variances : of a range (m^2) and of a range rate (m^2/s^2).
    """
    range_variance, rate_variance = variances
    nav = receiver.nav
    h = receiver.h
    _begin_update(receiver)
    count = number_like(nav[0], 0.0)
    accepted_count = number_like(nav[0], 0.0)
    satellites = number_like(nav[0], 0.0)
    for slot in range(n_used):
        s = slot_satellites[slot]
        ux, uy, uz, distance = line_of_sight(satellite[s], receiver.antenna_state)
        has_started = receiver.memory[STARTED] > 0.0
        rho = where(has_started, ranges[slot, 0], np.nan)
        rate = where(has_started, ranges[slot, 1], np.nan)
        has_range = where(rho == rho, 1.0, 0.0)
        has_rate = where(rate == rate, 1.0, 0.0)
        count = count + has_range + has_rate
        predicted_range = range_row(h, receiver.antenna_state, ux, uy, uz, distance, nav[BIAS])
        innovation = rho - predicted_range
        range_accepted, receiver.innovation[2 * s] = _update_scalar(
            receiver,
            model,
            innovation,
            model.range_limit,
            range_variance,
            RANGE_ENTRIES,
            RANGE_COLUMNS,
        )
        predicted_rate = rate_row(h, receiver.antenna_state, satellite_velocity[s], ux, uy, uz, distance, nav[DRIFT])
        innovation = rate - predicted_rate
        rate_accepted, receiver.innovation[2 * s + 1] = _update_scalar(
            receiver,
            model,
            innovation,
            model.rate_limit,
            rate_variance,
            RATE_ENTRIES,
            RATE_COLUMNS,
        )
        accepted_count = accepted_count + range_accepted + rate_accepted
        satellites = satellites + where(range_accepted + rate_accepted > 0.0, 1.0, 0.0)
    for i in range(N_STATE):
        nav[i] = nav[i] + receiver.x[i]
    return count, accepted_count, satellites


@jit
def _copy_block(P, inverse, variance, first, clock, is_start):
    """Set the covariance of three states and a clock state to a variance times the inverse normal matrix (4, 4)."""
    for i in range(4):
        row = first + i if i < 3 else clock
        for j in range(4):
            column = first + j if j < 3 else clock
            P[row, column] = where(is_start, variance * inverse[i, j], P[row, column])


@jit
def _start(receiver, model, point, is_start):
    """Start the filter from the point solution in the runs with `is_start`."""
    nav = receiver.nav
    P = receiver.P
    point_fix = receiver.fix
    for i in range(N_STATE):
        for j in range(N_STATE):
            P[i, j] = where(is_start, 0.0, P[i, j])
    for i in range(3):
        position = POS + i
        velocity = VEL + i
        acceleration = ACC + i
        nav[acceleration] = where(is_start, 0.0, nav[acceleration])
        nav[velocity] = where(is_start, point_fix[FIX_VEL + i], nav[velocity])
        nav[position] = where(is_start, point_fix[FIX_POS + i], nav[position])
        P[acceleration, acceleration] = where(is_start, model.start, P[acceleration, acceleration])
    nav[BIAS] = where(is_start, point_fix[FIX_BIAS], nav[BIAS])
    nav[DRIFT] = where(is_start, point_fix[FIX_DRIFT], nav[DRIFT])
    # position and bias, velocity and drift: covariance of the point solution by its inverse normal matrix
    _copy_block(P, receiver.inverse, point.range_variance, POS, BIAS, is_start)
    _copy_block(P, receiver.inverse, point.rate_variance, VEL, DRIFT, is_start)


@jit
def _output(receiver, model, satellites):
    """Set solution and reported covariance; the solution is NaN before the start and after too long a coast."""
    memory = receiver.memory
    is_valid = (memory[STARTED] > 0.0) & (memory[IDLE] <= model.coast)
    partial_quality = where(satellites > 0.0, PARTIAL, PROPAGATED)
    quality = where(satellites >= 4.0, FULL, partial_quality)
    receiver.filter_verdict[0] = where(is_valid, quality, NO_FIX)
    settings = model.reported_covariance
    zero = number_like(satellites, 0.0)
    for i in range(6):
        row = POS + i if i < 3 else VEL + i - 3
        receiver.solution[i] = where(is_valid, receiver.nav[row], np.nan)
        for j in range(6):
            column = POS + j if j < 3 else VEL + j - 3
            if not settings.is_computed:
                constant_variance = settings.position_variance if i < 3 else settings.velocity_variance
                receiver.covariance[i, j] = zero + (constant_variance if i == j else 0.0)
            elif settings.has_correlations or i == j:
                receiver.covariance[i, j] = settings.factor * receiver.P[row, column]
            else:
                receiver.covariance[i, j] = zero


@jit
def step(receiver, model, point, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Propagate the filter from the previous epoch to this one, process its measurements, output its solution.

    Parameters
    ----------
    receiver : Receiver
        Updated; `switch_on` has set its initial state.
    model : ReceiverFilter
    point : PointModel
        Settings of the point solution that starts the filter and adapts its noise.
    satellite, satellite_velocity, slot_satellites, n_used, ranges : as in `bancroft.fix`

    Returns
    -------
    quality
        NO_FIX, PROPAGATED (no measurement), PARTIAL (fewer than four satellites), or FULL.
    """
    quality = fix(receiver, point, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    has_fix = quality >= point.least_quality
    memory = receiver.memory
    _update_acceleration(receiver, model, has_fix)
    x, y, z, range_variance, rate_variance = adapted_variances(
        memory[ACCELERATION],
        memory[ACCELERATION + 1],
        memory[ACCELERATION + 2],
        model,
    )
    propagate(receiver, model, x, y, z)
    count, accepted_count, satellites = _update_ranges(
        receiver,
        model,
        satellite,
        satellite_velocity,
        slot_satellites,
        n_used,
        ranges,
        (range_variance, rate_variance),
    )
    # a filter that rejects most measurements of several fixes in succession has diverged
    rejects_most = has_fix & (accepted_count < 0.5 * count)
    memory[MISSES] = where(rejects_most, memory[MISSES] + 1.0, 0.0)
    has_diverged = memory[MISSES] >= model.restart
    is_start = has_fix & ((memory[STARTED] == 0.0) | has_diverged)
    _start(receiver, model, point, is_start)
    for channel in range(receiver.innovation.shape[0]):  # no innovations at the epoch of a restart
        receiver.innovation[channel] = where(is_start, np.nan, receiver.innovation[channel])
    memory[STARTED] = where(is_start, 1.0, memory[STARTED])
    memory[MISSES] = where(is_start, 0.0, memory[MISSES])
    satellites = where(is_start, receiver.verdict[1], satellites)
    memory[IDLE] = where(satellites > 0.0, 0.0, memory[IDLE] + model.interval)
    for i in range(3):
        receiver.position_guess[i] = where(memory[STARTED] > 0.0, receiver.nav[POS + i], receiver.position_guess[i])
    receiver.filter_verdict[1] = accepted_count
    _output(receiver, model, satellites)
    return receiver.filter_verdict[0]


@jit
def solve(receiver, point, filtering, satellite, satellite_velocity, slot_satellites, n_used, ranges):
    """Set solution and covariance of a receiver at an epoch; return their quality.

    Parameters
    ----------
    receiver : Receiver
        Updated.
    point : PointModel
    filtering : ReceiverFilter or None
        None: output the point solution.
    satellite, satellite_velocity, slot_satellites, n_used, ranges : as in `bancroft.fix`
    """
    if filtering is None:
        return solution(receiver, point, satellite, satellite_velocity, slot_satellites, n_used, ranges)
    return step(receiver, filtering, point, satellite, satellite_velocity, slot_satellites, n_used, ranges)
