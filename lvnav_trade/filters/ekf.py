"""The filter's steps: propagate a window, absorb an epoch's rows, correct the navigation state."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filters.belief import TIGHT
from lvnav_trade.filters.late import LAST, carry_on
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.attitude import from_rotation, multiply, normalise
from lvnav_trade.kernels.covariance import absorb, absorb_with, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, size, where
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.observables import altitude, doppler, position, pseudorange, velocity
from lvnav_trade.observables.base import N_ENTRY, antenna, line_of_sight
from lvnav_trade.receivers.whiten import whiten


@inlined
def predict_window(work, belief, length):
    """Propagate covariance, fading parameters and clock estimate over a window of a known length index."""
    seconds = belief.seconds[length]
    transition.fill(
        work.D,
        belief.block_kinds,
        belief.block_drivers,
        work.sums,
        work.nav[R],
        work.nav[R + 1],
        work.nav[R + 2],
        seconds,
    )
    predict(
        work.P, work.D, belief.block_rows, belief.block_columns, belief.decay[length], belief.noise[length],
        belief.clock, seconds,
    )  # fmt: skip
    if belief.clock >= 0:
        work.clock_hat[0] = work.clock_hat[0] + seconds * work.clock_hat[1]
    if belief.fading:
        for b in range(belief.par_offset.shape[0]):
            for i in range(3):
                work.par[b, i] = belief.decay[length, belief.par_offset[b] + i] * work.par[b, i]
        for e in range(belief.extra_offset.shape[0]):
            work.extra[e] = belief.decay[length, belief.extra_offset[e]] * work.extra[e]
        processes.gather(work.tables, work.par, belief.par_sensor, belief.par_driver)


@jit
def place_antenna(work, late, belief, dt):
    """Set the estimated state of every antenna from the navigation state and the last tick's rate; a buffered late
    measurement (Late, or None) is met where they were when it was valid.
    """
    for i in range(3):
        work.rate[i] = work.previous[i] / dt
    for a in range(belief.levers.shape[0]):
        antenna(work.antenna[a], work.nav, work.rate, belief.levers[a])
    if late is not None and not late.extrapolated:
        for i in range(3):
            work.rate[i] = work.past[LAST + i] / dt
        for a in range(belief.levers.shape[0]):
            antenna(work.antenna[a], work.past, work.rate, belief.levers[a])


@jit
def _add_extra(work, belief, signals, epoch, row, channel):
    """Set the entries of a row for the filter's extra states; return what their estimates add to the prediction."""
    h = work.H[row]
    total = like(work.x[0], 0.0)
    for family in range(belief.extra_member.shape[0]):
        e = belief.extra_member[family, channel]
        if e >= 0:
            partial = like(work.x[0], signals.partial[family, epoch, channel])
            h[N_ENTRY + family] = partial
            total = total + partial * work.extra[e]
    return total


@jit
def fill_tight(work, belief, signals, epoch):
    """Set the rows of every satellite in use: pseudorange and range rate in turn; z holds measured minus predicted."""
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        at = work.antenna[signals.antenna[epoch, s]]
        ux, uy, uz, distance = line_of_sight(signals.satellite[epoch, s], at)
        h, g = work.H[2 * slot], work.H[2 * slot + 1]
        predicted = pseudorange.row(h, at, ux, uy, uz, distance, work.clock_hat[0])
        predicted = predicted + _add_extra(work, belief, signals, epoch, 2 * slot, 2 * s)
        work.z[2 * slot] = work.ranges[slot, 0] - predicted
        moving = signals.satellite_velocity[epoch, s]
        predicted = doppler.row(g, at, moving, ux, uy, uz, distance, work.clock_hat[1])
        predicted = predicted + _add_extra(work, belief, signals, epoch, 2 * slot + 1, 2 * s + 1)
        work.z[2 * slot + 1] = work.ranges[slot, 1] - predicted


@jit
def fill_loose(work, belief, signals, epoch):
    """Set three position and three velocity rows; z holds measured minus predicted."""
    at = work.antenna[0]
    for axis in range(3):
        predicted = position.row(work.H[axis], at, axis) + _add_extra(work, belief, signals, epoch, axis, axis)
        work.z[axis] = work.solution[axis] - predicted
        moving = velocity.row(work.H[3 + axis], at, axis)
        moving = moving + _add_extra(work, belief, signals, epoch, 3 + axis, 3 + axis)
        work.z[3 + axis] = work.solution[3 + axis] - moving


@jit
def rows_at(belief, signals, epoch):
    """Return how many rows a filter has at an epoch: a simulated solution takes four satellites, of a solver's own the
    rows that are none are not-a-number.
    """
    if (epoch + 1) % belief.every != 0:
        return 0
    if belief.kind == TIGHT:
        return 2 * signals.n_used[epoch]
    return 6 if belief.judged or signals.n_used[epoch] >= 4 else 0


@jit
def channel_of(belief, signals, epoch, row):
    """Return the channel of a row of an epoch."""
    return 2 * signals.used[epoch, row // 2] + row % 2 if belief.kind == TIGHT else row


@inlined
def absorb_row(work, gains, belief, epoch, row, channel, variance, gate_squared):
    """Absorb one filled row of a channel, with the gain of a schedule (Gains) or, without one (None), that of the
    covariance; return its normalised innovation and weight.
    """
    n = belief.n_entry[channel]
    entries, columns = belief.entry[channel, :n], belief.column[channel, :n]
    if gains is None:
        return absorb(
            work.P, work.x, work.K, work.H[row], entries, columns, work.z[row], variance, gate_squared,
            belief.n_estimated, belief.joseph,
        )  # fmt: skip
    return absorb_with(
        work.P, work.x, work.K, work.H[row], entries, columns, gains.gain[epoch, row], work.z[row], variance,
        gate_squared, belief.n_estimated,
    )  # fmt: skip


@jit
def weigh(work, rx, late, belief, signals, epoch):
    """Give the rows of a solution the covariance that it comes with, where it comes with one."""
    if rx is None and late is None:
        return
    if belief.judged:
        tell(work, rx, signals, epoch)
        mix(work, late, epoch, N_ENTRY)


@jit
def tell(work, rx, signals, epoch):
    """Set the covariance that comes with a solution: its solver's, or the variances of a simulated one."""
    for i in range(6):
        for j in range(6):
            if rx is not None:
                work.told[i, j] = rx.covariance[i, j]
            else:
                work.told[i, j] = like(work.x[0], signals.variance[epoch, i] if i == j else 0.0)


@jit
def mix(work, late, epoch, n_entry):
    """Turn the rows of a solution, whose covariance is in `told`, into independent ones of variance one; a late one is
    carried on to the present first, where it shall be.
    """
    if late is not None and late.extrapolated:
        carry_on(work.z, work.told, work.past, work.P, late, epoch)
    whiten(work.told, work.z, work.H, 6, n_entry)


@inlined
def absorb_and_count(work, gains, belief, signals, epoch, row, channel, gate_squared):
    """Absorb one filled row of an epoch, keep its innovation and count it: believed, or rejected by the gate."""
    variance = 1.0 if belief.judged else signals.variance[epoch, channel]
    normalised, weight = absorb_row(work, gains, belief, epoch, row, channel, variance, gate_squared)
    work.innovation[epoch, channel] = normalised
    believed = weight > 0.0
    rejected = (normalised == normalised) & (weight == 0.0)  # what is not a number is no row
    work.nis[epoch] = work.nis[epoch] + where(believed, normalised * normalised, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(believed, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(rejected, 1.0, 0.0)


@jit
def clear_epoch(work, epoch, n_channel):
    """Start an epoch's counts at zero and its innovations at not-a-number (no row)."""
    zero = like(work.x[0], 0.0)
    work.nis[epoch], work.n_row[epoch], work.n_reject[epoch] = zero, zero, zero
    for channel in range(n_channel):
        work.innovation[epoch, channel] = like(zero, np.nan)


@inlined
def absorb_height(work, altimeter, belief, signals, epoch, gate_squared):
    """Absorb what an altimeter (Altimeter, or None) measures at an epoch, as the last row and channel."""
    if altimeter is not None and altimeter.on[epoch]:
        row, channel = size(work.z, 0) - 1, size(work.innovation, 1) - 1
        work.z[row] = work.ground[0] - altitude.row(work.H[row], work.nav)
        absorb_and_count(work, None, belief, signals, epoch, row, channel, gate_squared)


@inlined
def update(work, belief, signals, late, gains, epoch, dt):
    """Absorb what the receiver put out at an epoch, all rows linearised at one point: pseudorange and range rate of
    every satellite in use, or position and velocity of a solution axis by axis.
    """
    place_antenna(work, late, belief, dt)
    tight = belief.kind == TIGHT
    if tight:
        fill_tight(work, belief, signals, epoch)
    else:
        fill_loose(work, belief, signals, epoch)
        weigh(work, work.rx, late, belief, signals, epoch)
    for row in range(rows_at(belief, signals, epoch)):
        channel = channel_of(belief, signals, epoch, row)
        absorb_and_count(work, gains, belief, signals, epoch, row, channel, belief.gate_squared)


@jit
def correct_motion(nav, x):
    """Add the error state to attitude, velocity and position (error is truth minus estimate: feedback adds)."""
    e0, e1, e2, e3 = from_rotation(x[ATT], x[ATT + 1], x[ATT + 2])
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = normalise(q0, q1, q2, q3)
    for i in range(3):
        nav[V + i] = nav[V + i] + x[VEL + i]
        nav[R + i] = nav[R + i] + x[POS + i]


@jit
def correct(work, belief):
    """Feed the error state back and set it to zero."""
    x = work.x
    correct_motion(work.nav, x)
    for b in range(belief.par_offset.shape[0]):
        for i in range(3):
            work.par[b, i] = work.par[b, i] + x[belief.par_offset[b] + i]
    if belief.clock >= 0:
        for i in range(2):
            work.clock_hat[i] = work.clock_hat[i] + x[belief.clock + i]
    for e in range(belief.extra_offset.shape[0]):
        work.extra[e] = work.extra[e] + x[belief.extra_offset[e]]
    processes.gather(work.tables, work.par, belief.par_sensor, belief.par_driver)
    for i in range(belief.n_state):
        x[i] = like(x[i], 0.0)
