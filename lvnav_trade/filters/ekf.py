"""The filter's steps: propagate a window, absorb an epoch's rows, correct the navigation state."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filters.belief import POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.attitude import from_rotation, multiply, normalise
from lvnav_trade.kernels.covariance import absorb, predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, where
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.observables import doppler, position, pseudorange, velocity
from lvnav_trade.observables.base import antenna, line_of_sight


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
        work.P, work.X, work.D, belief.block_rows, belief.block_columns, belief.decay[length], belief.noise[length],
        belief.clock, seconds,
    )  # fmt: skip
    if belief.clock >= 0:
        work.clock_hat[0] = work.clock_hat[0] + seconds * work.clock_hat[1]
    if belief.fading:
        for b in range(belief.par_offset.shape[0]):
            for i in range(3):
                work.par[b, i] = belief.decay[length, belief.par_offset[b] + i] * work.par[b, i]
        processes.gather(work.tables, work.par, belief.par_sensor, belief.par_driver)


@jit
def place_antenna(work, belief, dt):
    """Set the estimated antenna state from the navigation state and the last tick's rate."""
    for i in range(3):
        work.rate[i] = work.previous[i] / dt
    antenna(work.antenna, work.nav, work.rate, belief.lever)


@jit
def fill_tight(work, belief, signals, epoch):
    """Set the rows of every satellite in use: pseudorange and range rate in turn; z holds measured minus predicted."""
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        ux, uy, uz, distance = line_of_sight(signals.satellite[epoch, s], work.antenna)
        h, g = work.H[2 * slot], work.H[2 * slot + 1]
        predicted = pseudorange.row(h, work.antenna, ux, uy, uz, distance, work.clock_hat[0])
        work.z[2 * slot] = work.ranges[slot, 0] - predicted
        predicted = doppler.row(
            g, work.antenna, signals.satellite_velocity[epoch, s], ux, uy, uz, distance, work.clock_hat[1]
        )
        work.z[2 * slot + 1] = work.ranges[slot, 1] - predicted


@jit
def fill_loose(work):
    """Set three position and three velocity rows; z holds measured minus predicted."""
    for axis in range(3):
        work.z[axis] = work.solution[axis] - position.row(work.H[axis], work.antenna, axis)
        work.z[3 + axis] = work.solution[3 + axis] - velocity.row(work.H[3 + axis], work.antenna, axis)


@inlined
def absorb_row(work, belief, row, kind):
    """Absorb one filled row of a row type; return its normalised innovation and weight."""
    n = belief.n_entry[kind]
    return absorb(
        work.P, work.x, work.K, work.H[row], belief.entry[kind, :n], belief.column[kind, :n], work.z[row],
        belief.variance[kind], belief.gate_squared, belief.n_estimated, belief.joseph,
    )  # fmt: skip


@inlined
def _absorb_and_count(work, belief, epoch, row, kind, channel):
    normalised, weight = absorb_row(work, belief, row, kind)
    work.innovation[epoch, channel] = normalised
    believed = weight > 0.0
    work.nis[epoch] = work.nis[epoch] + where(believed, normalised * normalised, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(believed, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(believed, 0.0, 1.0)


@jit
def clear_epoch(work, epoch, n_channel):
    """Start an epoch's counts at zero and its innovations at not-a-number (no row)."""
    zero = like(work.x[0], 0.0)
    work.nis[epoch], work.n_row[epoch], work.n_reject[epoch] = zero, zero, zero
    for channel in range(n_channel):
        work.innovation[epoch, channel] = like(zero, np.nan)


@jit
def update_tight(work, belief, signals, epoch, dt):
    """Absorb pseudorange and range rate of every satellite in use; all rows linearised at one point."""
    place_antenna(work, belief, dt)
    fill_tight(work, belief, signals, epoch)
    for slot in range(signals.n_used[epoch]):
        s = signals.used[epoch, slot]
        _absorb_and_count(work, belief, epoch, 2 * slot, PSEUDORANGE, 2 * s)
        _absorb_and_count(work, belief, epoch, 2 * slot + 1, RANGE_RATE, 2 * s + 1)


@jit
def update_loose(work, belief, epoch, dt):
    """Absorb the receiver's position and velocity, axis by axis; all rows linearised at one point."""
    place_antenna(work, belief, dt)
    fill_loose(work)
    for axis in range(3):
        _absorb_and_count(work, belief, epoch, axis, POSITION, axis)
    for axis in range(3):
        _absorb_and_count(work, belief, epoch, 3 + axis, VELOCITY, 3 + axis)


@jit
def correct(work, belief):
    """Feed the error state back (error is truth minus estimate: feedback adds) and set it to zero."""
    nav, x = work.nav, work.x
    e0, e1, e2, e3 = from_rotation(x[ATT], x[ATT + 1], x[ATT + 2])
    q0, q1, q2, q3 = multiply(e0, e1, e2, e3, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3] = normalise(q0, q1, q2, q3)
    for i in range(3):
        nav[V + i] = nav[V + i] + x[VEL + i]
        nav[R + i] = nav[R + i] + x[POS + i]
    for b in range(belief.par_offset.shape[0]):
        for i in range(3):
            work.par[b, i] = work.par[b, i] + x[belief.par_offset[b] + i]
    if belief.clock >= 0:
        for i in range(2):
            work.clock_hat[i] = work.clock_hat[i] + x[belief.clock + i]
    processes.gather(work.tables, work.par, belief.par_sensor, belief.par_driver)
    for i in range(belief.n_state):
        x[i] = like(x[i], 0.0)
