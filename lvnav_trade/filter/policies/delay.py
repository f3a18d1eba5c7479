"""Delayed measurements: compared with the stored state of their time of validity, or extrapolated to the present.

Canepa and Servidia, algorithm 5.1 and eq. 7.19, 7.20.

Buffered: the innovation is formed with the estimate at the time of validity. Gain and Jacobian are the present ones,
since the transition matrix over the delay is approximated by the identity. Corrections in between are also applied to
the stored states.

Extrapolated: position and velocity of the receiver are extrapolated to the present by one Euler step with the filter's
velocity and acceleration. The covariance of that step is added to the reported covariance of the solution.
"""

from typing import NamedTuple

from lvnav_trade.kernels.attitude import from_rotation, matrix, multiply
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, where
from lvnav_trade.kernels.strapdown import Q, R, V, gravity
from lvnav_trade.kernels.transition import VEL, correct_motion
from lvnav_trade.quantities.records import Bools, Floats, Ints

# Places of a stored state: navigation state (10), last increments (6), earlier velocity (3), error state (9).
NAV, LAST, EARLY, ERROR, N_PAST = 0, 10, 16, 19, 28
# The last row of the store has the acceleration of the last extrapolation (3) and whether there was one (1), then the
# same four numbers of the epoch before.
BEFORE, KNOWN, N_EXTRAPOLATED = 0, 3, 4


class DelayProcessing(NamedTuple):
    """How a filter processes delayed measurements. The receiver is one line, each delayed sensor another.

    A line stores the states that its measurements on the way will be compared with, in a ring of n_ring places.

    is_extrapolated : Whether the receiver's solution is extrapolated to the present; otherwise buffered, as sensors
        always are.
    receiver_line : Line of the receiver, -1 not delayed.
    line : (n_channel,). Line of each channel, -1 not delayed.
    sensor_line : (n_sensor,). Line of each sensor, -1 not delayed.
    n_ring : (n_line,). Number of states stored at once.
    first : (n_line,). First place of the line; epoch k is stored at `first` + k modulo `n_ring`.
    is_buffered : (n_place,). Whether the place belongs to a buffered line.
    state_epochs : (n_line, n_window, 2). First epoch whose state is stored at the end of the window, and the epoch
        after the last.
    velocity_epochs : (n_line, n_window, 2). The same for the earlier velocity that gives the acceleration.
    delay : (n_epoch,) s. Delay of the receiver that the filter compensates.
    offset : (n_line, n_epoch) s. Time of validity minus the time of the tick at which the state is stored.
    base : (n_epoch,) s. Time of validity minus the time of the earlier velocity.
    interval : s. Time between epochs.
    delay_variance : s^2. Modelled variance of the delay.
    acceleration_variance : m^2/s^4. Modelled variance of the acceleration.
    """

    is_extrapolated: bool
    receiver_line: int
    line: Ints
    sensor_line: Ints
    n_ring: Ints
    first: Ints
    is_buffered: Bools
    state_epochs: Ints
    velocity_epochs: Ints
    delay: Floats
    offset: Floats
    base: Floats
    interval: float
    delay_variance: float
    acceleration_variance: float


@jit
def ring_index(delays, line, epoch):
    """Return the place in the store of the state that a line's measurement of an epoch is compared with."""
    return delays.first[line] + epoch % delays.n_ring[line]


@jit
def channel_ring_index(delays, channel, epoch):
    """Return the place in the store for a channel's measurement of an epoch (DelayProcessing, or None); 0 if it is not
    late.
    """
    if delays is None:
        return 0
    line = delays.line[channel]
    return ring_index(delays, line, epoch) if line >= 0 else 0


@jit
def _move(stored_state, seconds, dt, gravity_model):
    """Propagate position and velocity of a stored state by less than a step, with the specific force of the last step.

    seconds : s, of either sign; dt : s, of a strapdown step
    """
    attitude = NAV + Q
    position = NAV + R
    velocity = NAV + V
    rotation = matrix(
        stored_state[attitude], stored_state[attitude + 1], stored_state[attitude + 2], stored_state[attitude + 3]
    )
    gravitation = gravity(gravity_model, stored_state[position], stored_state[position + 1], stored_state[position + 2])
    # specific force, body axes
    x = stored_state[LAST + 3] / dt
    y = stored_state[LAST + 4] / dt
    z = stored_state[LAST + 5] / dt
    for i in range(3):
        speed = stored_state[velocity + i]
        acceleration = gravitation[i] + rotation[3 * i] * x + rotation[3 * i + 1] * y + rotation[3 * i + 2] * z
        mean_speed = speed + 0.5 * seconds * acceleration
        stored_state[position + i] = stored_state[position + i] + seconds * mean_speed
        stored_state[velocity + i] = speed + seconds * acceleration


@jit
def _turn(stored_state, seconds, dt):
    """Propagate the attitude of a stored state by less than a step, with the angular rate of the last step."""
    fraction = seconds / dt
    d0, d1, d2, d3 = from_rotation(
        fraction * stored_state[LAST],
        fraction * stored_state[LAST + 1],
        fraction * stored_state[LAST + 2],
    )
    attitude = NAV + Q
    q0, q1, q2, q3 = multiply(
        stored_state[attitude],
        stored_state[attitude + 1],
        stored_state[attitude + 2],
        stored_state[attitude + 3],
        d0,
        d1,
        d2,
        d3,
    )
    stored_state[attitude] = q0
    stored_state[attitude + 1] = q1
    stored_state[attitude + 2] = q2
    stored_state[attitude + 3] = q3


@jit
def _store(stored_state, nav, previous, x):
    """Store navigation state (10,), last increments (6,) and error state of navigation (9,) in one place."""
    for i in range(10):
        stored_state[NAV + i] = nav[i]
    for i in range(6):
        stored_state[LAST + i] = previous[i]
    for i in range(9):
        stored_state[ERROR + i] = x[i]


@inline_jit
def store_state(state_history, nav, previous, x, delays, window, dt, gravity_model):
    """Store the state at the end of a window, if a delayed measurement will be compared with it.

    Parameters
    ----------
    state_history : (n_place + 1, N_PAST) store, updated in place
    nav : (10,) navigation state, frame i
    previous : (6,) rad, m/s. Last increments
    x : (n,) error state; zero in a closed loop
    delays : DelayProcessing, or None without delay compensation
    window : index
    dt : s, of a strapdown step
    gravity_model : as in `kernels.strapdown`
    """
    if delays is not None:
        for line in range(delays.n_ring.shape[0]):
            # an earlier velocity may belong to another epoch than the state that is stored in the same window
            for epoch in range(delays.velocity_epochs[line, window, 0], delays.velocity_epochs[line, window, 1]):
                stored_state = state_history[ring_index(delays, line, epoch)]
                for i in range(3):
                    stored_state[EARLY + i] = nav[V + i] + x[VEL + i]
            for epoch in range(delays.state_epochs[line, window, 0], delays.state_epochs[line, window, 1]):
                stored_state = state_history[ring_index(delays, line, epoch)]
                _store(stored_state, nav, previous, x)
                offset = delays.offset[line, epoch]
                if offset != 0.0:
                    _move(stored_state, offset, dt, gravity_model)
                    if line != delays.receiver_line:  # attitude enters there by lever arms only: 0.01 mm within a tick
                        _turn(stored_state, offset, dt)


@jit
def correct_stored_states(state_history, delays, x):
    """Correct the stored states by the error state x (n,) that is fed back.

    Measurements still to come are thus compared with the best estimate of their time of validity.
    """
    if delays is not None:
        for place in range(delays.is_buffered.shape[0]):
            if delays.is_buffered[place]:
                correct_motion(state_history[place], x)


@jit
def correct_stored_errors(state_history, delays, x, prior_x):
    """Correct the stored error states of an open loop by the correction of an epoch: x (n,) minus `prior_x` (n,)."""
    if delays is not None:
        for place in range(delays.is_buffered.shape[0]):
            if delays.is_buffered[place]:
                stored_state = state_history[place]
                for i in range(9):
                    stored_state[ERROR + i] = stored_state[ERROR + i] + x[i] - prior_x[i]


@jit
def prediction_change(state_history, place, h, entries, columns, x):
    """Return the measurement predicted by the stored error state minus that predicted by the present one (open loop).

    Parameters
    ----------
    state_history, place : store, and place of the state of the time of validity
    h : Jacobian row
    entries, columns : entries of the row that are not zero, and the states that they multiply
    x : (n,) present error state
    """
    stored_state = state_history[place]
    total = number_like(x[0], 0.0)
    for c in range(columns.shape[0]):
        state = columns[c]
        if state < 9:
            error_difference = stored_state[ERROR + state] - x[state]
            total = total + h[entries[c]] * error_difference
    return total


@jit
def repeat_extrapolation(state_history, delays):
    """Restore the acceleration of the epoch before, so that another pass of an iterated update can extrapolate."""
    if delays is not None and delays.is_extrapolated:
        acceleration_row = state_history[delays.is_buffered.shape[0]]
        for i in range(N_EXTRAPOLATED):
            acceleration_row[i] = acceleration_row[N_EXTRAPOLATED + i]


@jit
def _shift_acceleration(acceleration_row):
    """Make the acceleration of the last extrapolation that of the epoch before."""
    for i in range(N_EXTRAPOLATED):
        acceleration_row[N_EXTRAPOLATED + i] = acceleration_row[i]


@jit
def extrapolate_solution(z, covariance, state_history, P, delays, epoch):
    """Extrapolate a delayed solution to the present by one Euler step (eq. 7.19, 7.20).

    With the delay d, position moves by d v and velocity by d a, v and a being those of the filter. The covariance grows
    by the uncertainty of v and a, of d, and by the truncation error of the Euler step.

    Parameters
    ----------
    z : (6,) innovations, updated in place
    covariance : (6, 6) reported covariance of the solution, updated in place
    state_history : store, with the state at the time of validity. The acceleration of this epoch is stored for the
        next.
    P : (n, n) covariance of the filter
    delays : DelayProcessing
    epoch : index
    """
    stored_state = state_history[ring_index(delays, delays.receiver_line, epoch)]
    acceleration_row = state_history[delays.is_buffered.shape[0]]
    delay = delays.delay[epoch]
    half_square = 0.5 * delay * delay
    # estimated velocity at the time of validity: in an open loop that of the inertial system plus the error state
    velocity = NAV + V
    error = ERROR + VEL
    vx = stored_state[velocity] + stored_state[error]
    vy = stored_state[velocity + 1] + stored_state[error + 1]
    vz = stored_state[velocity + 2] + stored_state[error + 2]
    inverse_base = 1.0 / delays.base[epoch]
    ax = (vx - stored_state[EARLY]) * inverse_base
    ay = (vy - stored_state[EARLY + 1]) * inverse_base
    az = (vz - stored_state[EARLY + 2]) * inverse_base
    # truncation error: d^2 / 2 times the acceleration in position, times its rate of change in velocity; the first
    # epoch has no earlier acceleration, hence no rate
    rate_factor = where(acceleration_row[KNOWN] > 0.0, half_square / delays.interval, 0.0)
    jx = rate_factor * (ax - acceleration_row[BEFORE])
    jy = rate_factor * (ay - acceleration_row[BEFORE + 1])
    jz = rate_factor * (az - acceleration_row[BEFORE + 2])
    sx = half_square * ax
    sy = half_square * ay
    sz = half_square * az
    _shift_acceleration(acceleration_row)
    derivative = (vx, vy, vz, ax, ay, az)
    truncation = (sx, sy, sz, jx, jy, jz)
    for i in range(6):
        z[i] = z[i] + delay * derivative[i]
        for j in range(6):
            delay_covariance = delays.delay_variance * derivative[i] * derivative[j]
            truncation_product = truncation[i] * truncation[j]
            covariance[i, j] = covariance[i, j] + delay_covariance + truncation_product
    # uncertainty of the velocity in position, and of the acceleration in velocity
    delay_square = delay * delay
    velocity_variance = delay_square * delays.acceleration_variance
    for i in range(3):
        velocity_row = 3 + i
        covariance[velocity_row, velocity_row] = covariance[velocity_row, velocity_row] + velocity_variance
        acceleration_row[BEFORE + i] = derivative[velocity_row]
        for j in range(3):
            velocity_covariance = delay_square * P[VEL + i, VEL + j]
            covariance[i, j] = covariance[i, j] + velocity_covariance
    acceleration_row[KNOWN] = number_like(vx, 1.0)
