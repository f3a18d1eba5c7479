"""Delayed measurements: compared with the stored state of their time of validity, or extrapolated to the present.

Canepa and Servidia, algorithm 5.1 and eq. 7.19, 7.20. Buffered, the innovation is formed with the estimate of the time
of validity; gain and Jacobian are those of the present (Phi over the delay is taken for one), and what the filter
corrects in between it also corrects in the states that are stored. Extrapolated, a receiver's position and velocity are
extrapolated by one Euler step with the filter's own velocity and acceleration, and what that adds to their covariance
is added to the one that is reported with them.
"""

from typing import NamedTuple

from lvnav_trade.kernels.attitude import from_rotation, matrix, multiply
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.strapdown import Q, R, V, gravity
from lvnav_trade.kernels.transition import VEL, correct_motion
from lvnav_trade.records import Bools, Floats, Ints

# What is stored of a time of validity: navigation state, last increments, velocity a while before, error state.
NAV, LAST, EARLY, ERROR, N_PAST = 0, 10, 16, 19, 28
# In the last row of the store: acceleration that an epoch was extrapolated with, whether there was one, and then the
# same of the epoch before.
BEFORE, KNOWN, N_EXTRAPOLATED = 0, 3, 4


class Late(NamedTuple):
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
    """Return where the state of an epoch's measurement of a line is stored."""
    return late.first[line] + epoch % late.n_ring[line]


@jit
def place_of_channel(late, channel, epoch):
    """Return where the state of an epoch's measurement of a channel is stored (Late, or None); 0 if it is not late."""
    if late is None:
        return 0
    line = late.line[channel]
    return place_of(late, line, epoch) if line >= 0 else 0


@jit
def _move(stored, seconds, dt, kind):
    """Move the place and velocity of a stored state by less than a tick."""
    c = matrix(stored[NAV + Q], stored[NAV + Q + 1], stored[NAV + Q + 2], stored[NAV + Q + 3])
    pulled = gravity(kind, stored[NAV + R], stored[NAV + R + 1], stored[NAV + R + 2])
    x, y, z = stored[LAST + 3] / dt, stored[LAST + 4] / dt, stored[LAST + 5] / dt
    for i in range(3):
        v = stored[NAV + V + i]
        total = pulled[i] + c[3 * i] * x + c[3 * i + 1] * y + c[3 * i + 2] * z
        stored[NAV + R + i] = stored[NAV + R + i] + seconds * (v + 0.5 * seconds * total)
        stored[NAV + V + i] = v + seconds * total


@jit
def _turn(stored, seconds, dt):
    """Turn the attitude of a stored state by less than a tick, as its body turned in the last one."""
    share, at = seconds / dt, NAV + Q
    d0, d1, d2, d3 = from_rotation(share * stored[LAST], share * stored[LAST + 1], share * stored[LAST + 2])
    stored[at], stored[at + 1], stored[at + 2], stored[at + 3] = multiply(
        stored[at], stored[at + 1], stored[at + 2], stored[at + 3], d0, d1, d2, d3
    )


@inlined
def keep(past, nav, previous, x, late, window, dt, kind):
    """Store, at the end of a window, the state that a measurement on its way will be compared with.

    past (n_place + 1, N_PAST) updated; nav (10,), previous (6,) the strapdown's state and last increments; x (n,) error
    state (of a closed loop zero); late : Late, or None where nothing is compensated; dt s of a strapdown step; kind of
    gravity
    """
    if late is not None:
        for line in range(late.n_ring.shape[0]):
            for epoch in range(late.early[line, window, 0], late.early[line, window, 1]):
                for i in range(3):
                    past[place_of(late, line, epoch), EARLY + i] = nav[V + i] + x[VEL + i]
            for epoch in range(late.valid[line, window, 0], late.valid[line, window, 1]):
                stored = past[place_of(late, line, epoch)]
                for i in range(10):
                    stored[NAV + i] = nav[i]
                for i in range(6):
                    stored[LAST + i] = previous[i]
                for i in range(9):
                    stored[ERROR + i] = x[i]
                if late.offset[line, epoch] != 0.0:
                    _move(stored, late.offset[line, epoch], dt, kind)
                    if line != late.receiver:  # a lever arm turns by a hundredth of a millimetre
                        _turn(stored, late.offset[line, epoch], dt)


@jit
def correct_stored(past, late, x):
    """Correct the stored states by the error state x (n,) that is fed back: measurements on their way are compared with
    what the filter would have estimated.
    """
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
                correct_motion(past[place], x)


@jit
def correct_stored_errors(past, late, x, before):
    """Correct the error states that an open loop stores by what an epoch has added: x (n,) less `before` (n,)."""
    if late is not None:
        for place in range(late.buffered.shape[0]):
            if late.buffered[place]:
                for i in range(9):
                    past[place, ERROR + i] = past[place, ERROR + i] + x[i] - before[i]


@jit
def predicted_of_stored(past, place, h, entries, columns, x):
    """Return what the error state x of an open loop had predicted of a measurement when it was valid, beyond what it
    predicts now.
    """
    stored, total = past[place], like(x[0], 0.0)
    for c in range(columns.shape[0]):
        if columns[c] < 9:
            total = total + h[entries[c]] * (stored[ERROR + columns[c]] - x[columns[c]])
    return total


@jit
def repeat_extrapolation(past, late):
    """Let an epoch be extrapolated again, by another pass of an iterated update: from the epoch before."""
    if late is not None and late.extrapolated:
        last = past[late.buffered.shape[0]]
        for i in range(N_EXTRAPOLATED):
            last[i] = last[N_EXTRAPOLATED + i]


@jit
def carry_on(z, reported, past, P, late, epoch):
    """Extrapolate a late solution to the present, in the innovations z (6,), and add to its covariance `reported` (6,
    6) what that costs (eq. 7.20): the filter's own velocity and acceleration, the delay's error, and what an Euler step
    leaves.

    P (n, n) of the filter gives the velocity's part. The acceleration of this epoch is stored for the next one, beside
    that of the epoch before.
    """
    stored, last = past[place_of(late, late.receiver, epoch)], past[late.buffered.shape[0]]
    delay, half = late.delay[epoch], 0.5 * late.delay[epoch] * late.delay[epoch]
    # the velocity that the filter had: of an open loop the inertial system's plus the error state
    at, error, inverse = NAV + V, ERROR + VEL, 1.0 / late.base[epoch]
    vx, vy = stored[at] + stored[error], stored[at + 1] + stored[error + 1]
    vz = stored[at + 2] + stored[error + 2]
    ax, ay, az = (vx - stored[EARLY]) * inverse, (vy - stored[EARLY + 1]) * inverse, (vz - stored[EARLY + 2]) * inverse
    # half the acceleration is left of the position, half its change of the velocity; the first epoch knows none
    rate = where(last[KNOWN] > 0.0, half / late.interval, 0.0)
    bx, by, bz = rate * (ax - last[BEFORE]), rate * (ay - last[BEFORE + 1]), rate * (az - last[BEFORE + 2])
    for i in range(N_EXTRAPOLATED):
        last[N_EXTRAPOLATED + i] = last[i]
    moves, bends = (vx, vy, vz, ax, ay, az), (half * ax, half * ay, half * az, bx, by, bz)
    square = delay * delay
    for i in range(6):
        z[i] = z[i] + delay * moves[i]
        for j in range(6):
            reported[i, j] = reported[i, j] + late.jitter * moves[i] * moves[j] + bends[i] * bends[j]
    for i in range(3):
        reported[3 + i, 3 + i] = reported[3 + i, 3 + i] + square * late.acceleration
        last[BEFORE + i] = moves[3 + i]
        for j in range(3):
            reported[i, j] = reported[i, j] + square * P[VEL + i, VEL + j]
    last[KNOWN] = like(vx, 1.0)
