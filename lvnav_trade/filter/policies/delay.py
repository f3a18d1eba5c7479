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
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where
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

    extrapolated : Whether the receiver's solution is extrapolated to the present; otherwise buffered, as sensors always
        are.
    receiver : Line of the receiver, -1 not delayed.
    line : (n_channel,). Line of each channel, -1 not delayed.
    of_sensor : (n_sensor,). Line of each sensor, -1 not delayed.
    n_ring : (n_line,). Number of states stored at once.
    first : (n_line,). First place of the line; epoch k is stored at `first` + k modulo `n_ring`.
    buffered : (n_place,). Whether the place belongs to a buffered line.
    valid : (n_line, n_window, 2). First epoch whose state is stored at the end of the window, and the epoch after the
        last.
    early : (n_line, n_window, 2). The same for the earlier velocity that gives the acceleration.
    delay : (n_epoch,) s. Delay of the receiver that the filter compensates.
    offset : (n_line, n_epoch) s. Time of validity minus the time of the tick at which the state is stored.
    base : (n_epoch,) s. Time of validity minus the time of the earlier velocity.
    interval : s. Time between epochs.
    jitter : s^2. Modelled variance of the delay.
    acceleration : m^2/s^4. Modelled variance of the acceleration.
    """

    extrapolated: bool
    receiver: int
    line: Ints
    of_sensor: Ints
    n_ring: Ints
    first: Ints
    buffered: Bools
    valid: Ints
    early: Ints
    delay: Floats
    offset: Floats
    base: Floats
    interval: float
    jitter: float
    acceleration: float


@jit
def place_of(late, line, epoch):
    """Return the place in the store of the state that a line's measurement of an epoch is compared with."""
    return late.first[line] + epoch % late.n_ring[line]


@jit
def place_of_channel(late, channel, epoch):
    """Return the place in the store for a channel's measurement of an epoch (DelayProcessing, or None); 0 if it is not
    late.
    """
    if late is None:
        return 0
    line = late.line[channel]
    return place_of(late, line, epoch) if line >= 0 else 0


@jit
def _move(stored, seconds, dt, gravity_model):
    """Propagate position and velocity of a stored state by less than a step, with the specific force of the last step.

    seconds : s, of either sign; dt : s, of a strapdown step
    """
    attitude = NAV + Q
    position = NAV + R
    velocity = NAV + V
    rotation = matrix(stored[attitude], stored[attitude + 1], stored[attitude + 2], stored[attitude + 3])
    gravitation = gravity(gravity_model, stored[position], stored[position + 1], stored[position + 2])
    # specific force, body axes
    x = stored[LAST + 3] / dt
    y = stored[LAST + 4] / dt
    z = stored[LAST + 5] / dt
    for i in range(3):
        speed = stored[velocity + i]
        acceleration = gravitation[i] + rotation[3 * i] * x + rotation[3 * i + 1] * y + rotation[3 * i + 2] * z
        mean_speed = speed + 0.5 * seconds * acceleration
        stored[position + i] = stored[position + i] + seconds * mean_speed
        stored[velocity + i] = speed + seconds * acceleration


@jit
def _turn(stored, seconds, dt):
    """Propagate the attitude of a stored state by less than a step, with the angular rate of the last step."""
    fraction = seconds / dt
    d0, d1, d2, d3 = from_rotation(
        fraction * stored[LAST],
        fraction * stored[LAST + 1],
        fraction * stored[LAST + 2],
    )
    attitude = NAV + Q
    stored[attitude], stored[attitude + 1], stored[attitude + 2], stored[attitude + 3] = multiply(
        stored[attitude],
        stored[attitude + 1],
        stored[attitude + 2],
        stored[attitude + 3],
        d0,
        d1,
        d2,
        d3,
    )


@jit
def _store(stored, nav, previous, x):
    """Store navigation state (10,), last increments (6,) and error state of navigation (9,) in one place."""
    for i in range(10):
        stored[NAV + i] = nav[i]
    for i in range(6):
        stored[LAST + i] = previous[i]
    for i in range(9):
        stored[ERROR + i] = x[i]


@inlined
def keep(state_history, nav, previous, x, late, window, dt, gravity_model):
    """Store the state at the end of a window, if a delayed measurement will be compared with it.

    Parameters
    ----------
    state_history : (n_place + 1, N_PAST) store, updated in place
    nav : (10,) navigation state, frame i
    previous : (6,) rad, m/s. Last increments
    x : (n,) error state; zero in a closed loop
    late : DelayProcessing, or None without delay compensation
    window : index
    dt : s, of a strapdown step
    gravity_model : as in `kernels.strapdown`
    """
    if late is not None:
        for line in range(late.n_ring.shape[0]):
            # an earlier velocity may belong to another epoch than the state that is stored in the same window
            for epoch in range(late.early[line, window, 0], late.early[line, window, 1]):
                stored = state_history[place_of(late, line, epoch)]
                for i in range(3):
                    stored[EARLY + i] = nav[V + i] + x[VEL + i]
            for epoch in range(late.valid[line, window, 0], late.valid[line, window, 1]):
                stored = state_history[place_of(late, line, epoch)]
                _store(stored, nav, previous, x)
                offset = late.offset[line, epoch]
                if offset != 0.0:
                    _move(stored, offset, dt, gravity_model)
                    if line != late.receiver:  # attitude enters there by lever arms only: 0.01 mm within a tick
                        _turn(stored, offset, dt)


@jit
def correct_stored(state_history, late, x):
    """Correct the stored states by the error state x (n,) that is fed back.

    Measurements still to come are thus compared with the best estimate of their time of validity.
    """
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
                correct_motion(state_history[place], x)


@jit
def correct_stored_errors(state_history, late, x, before):
    """Correct the stored error states of an open loop by the correction of an epoch: x (n,) minus `before` (n,)."""
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
                stored = state_history[place]
                for i in range(9):
                    stored[ERROR + i] = stored[ERROR + i] + x[i] - before[i]


@jit
def predicted_of_stored(state_history, place, h, entries, columns, x):
    """Return the measurement predicted by the stored error state minus that predicted by the present one (open loop).

    Parameters
    ----------
    state_history, place : store, and place of the state of the time of validity
    h : Jacobian row
    entries, columns : entries of the row that are not zero, and the states that they multiply
    x : (n,) present error state
    """
    stored = state_history[place]
    total = like(x[0], 0.0)
    for c in range(columns.shape[0]):
        state = columns[c]
        if state < 9:
            error_difference = stored[ERROR + state] - x[state]
            total = total + h[entries[c]] * error_difference
    return total


@jit
def repeat_extrapolation(state_history, late):
    """Restore the acceleration of the epoch before, so that another pass of an iterated update can extrapolate."""
    if late is not None and late.extrapolated:
        last = state_history[late.buffered.shape[0]]
        for i in range(N_EXTRAPOLATED):
            last[i] = last[N_EXTRAPOLATED + i]


@jit
def _shift_acceleration(last):
    """Make the acceleration of the last extrapolation that of the epoch before."""
    for i in range(N_EXTRAPOLATED):
        last[N_EXTRAPOLATED + i] = last[i]


@jit
def carry_on(z, reported, state_history, P, late, epoch):
    """Extrapolate a delayed solution to the present by one Euler step (eq. 7.19, 7.20).

    With the delay d, position moves by d v and velocity by d a, v and a being those of the filter. The covariance grows
    by the uncertainty of v and a, of d, and by the truncation error of the Euler step.

    Parameters
    ----------
    z : (6,) innovations, updated in place
    reported : (6, 6) reported covariance of the solution, updated in place
    state_history : store, with the state at the time of validity. The acceleration of this epoch is stored for the
        next.
    P : (n, n) covariance of the filter
    late : DelayProcessing
    epoch : index
    """
    stored = state_history[place_of(late, late.receiver, epoch)]
    last = state_history[late.buffered.shape[0]]
    delay = late.delay[epoch]
    half_square = 0.5 * delay * delay
    # estimated velocity at the time of validity: in an open loop that of the inertial system plus the error state
    velocity = NAV + V
    error = ERROR + VEL
    vx = stored[velocity] + stored[error]
    vy = stored[velocity + 1] + stored[error + 1]
    vz = stored[velocity + 2] + stored[error + 2]
    inverse_base = 1.0 / late.base[epoch]
    ax = (vx - stored[EARLY]) * inverse_base
    ay = (vy - stored[EARLY + 1]) * inverse_base
    az = (vz - stored[EARLY + 2]) * inverse_base
    # truncation error: d^2 / 2 times the acceleration in position, times its rate of change in velocity; the first
    # epoch has no earlier acceleration, hence no rate
    rate_factor = where(last[KNOWN] > 0.0, half_square / late.interval, 0.0)
    jx = rate_factor * (ax - last[BEFORE])
    jy = rate_factor * (ay - last[BEFORE + 1])
    jz = rate_factor * (az - last[BEFORE + 2])
    sx = half_square * ax
    sy = half_square * ay
    sz = half_square * az
    _shift_acceleration(last)
    derivative = (vx, vy, vz, ax, ay, az)
    truncation = (sx, sy, sz, jx, jy, jz)
    for i in range(6):
        z[i] = z[i] + delay * derivative[i]
        for j in range(6):
            jitter_covariance = late.jitter * derivative[i] * derivative[j]
            truncation_product = truncation[i] * truncation[j]
            reported[i, j] = reported[i, j] + jitter_covariance + truncation_product
    # uncertainty of the velocity in position, and of the acceleration in velocity
    delay_square = delay * delay
    acceleration_variance = delay_square * late.acceleration
    for i in range(3):
        velocity_scalar = 3 + i
        reported[velocity_scalar, velocity_scalar] = reported[velocity_scalar, velocity_scalar] + acceleration_variance
        last[BEFORE + i] = derivative[velocity_scalar]
        for j in range(3):
            velocity_covariance = delay_square * P[VEL + i, VEL + j]
            reported[i, j] = reported[i, j] + velocity_covariance
    last[KNOWN] = like(vx, 1.0)
