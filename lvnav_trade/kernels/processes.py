"""Error parameters of an IMU in one run: turn-on draws, random processes, errors of increments.

Parameters form blocks of three, one per axis of a sensor; a block multiplies its driver (see `transition`). Before a
window they are summed into one table per sensor, so that the cost of a tick does not depend on the number of sources.
"""

import numpy as np

from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2

# Table of a sensor: bias (3), matrix on its own increments (9), on those of the other sensor (9), on squares (3).
BIAS, OWN, OTHER, SQUARES, N_TABLE = 0, 3, 12, 21, 24

_START, _ZERO = np.uint64(0), np.uint64(0)
# 2**52 * 1.5: adding and subtracting it rounds a float64 below 2**51 to the nearest whole number
_ROUND = 6755399441055744.0


@jit
def start(values, sigma, sources, k0, k1, run):
    """Draw the turn-on values of all blocks.

    Parameters
    ----------
    values : (n_block, 3) set here
    sigma : (n_block, 3) one-sigma
    sources : (n_block,) words that key the draws of each block, see `random.source_word`
    k0, k1, run : key words of the seed; run, one or eight lanes
    """
    for b in range(sigma.shape[0]):
        normal = normals(k0, k1, sources[b], run, _START, _ZERO)
        for axis in range(3):
            values[b, axis] = sigma[b, axis] * normal[axis]


@jit
def step(values, decay, walk, sources, k0, k1, run, number):
    """Step the random processes of all blocks by one epoch: value <- decay * value + walk * normal.

    Parameters
    ----------
    values : (n_block, 3) updated in place
    decay : (n_block,) decay factor over the step; 1 for a random walk
    walk : (n_block, 3) standard deviation of the increment; a block of zeros does not vary
    sources, k0, k1, run : keys of the draws, see `start`
    number : epoch of the process, a word, from 1
    """
    for b in range(decay.shape[0]):
        total_walk = walk[b, 0] + walk[b, 1] + walk[b, 2]
        if total_walk > 0.0:
            normal = normals(k0, k1, sources[b], run, number, _ZERO)
            for axis in range(3):
                values[b, axis] = decay[b] * values[b, axis] + walk[b, axis] * normal[axis]


@jit
def gather(tables, values, sensors, drivers):
    """Sum all blocks into the tables (2, 24) of gyro and accelerometer.

    Parameters
    ----------
    tables : (2, N_TABLE) set here
    values : (n_block, 3) parameters
    sensors, drivers : (n_block,) GYRO or ACCEL, and the driver of each block
    """
    for sensor in range(2):
        for i in range(N_TABLE):
            tables[sensor, i] = 0.0 * values[0, 0]
    for b in range(sensors.shape[0]):
        table = tables[sensors[b]]
        driver = drivers[b]
        for axis in range(3):
            entry = SQUARES + axis
            if driver == CONSTANT:
                entry = BIAS + axis
            elif OWN_0 <= driver and driver <= OWN_2:
                column = (axis + driver - OWN_0) % 3  # inputs are rolled, see `transition.driver`
                entry = OWN + 3 * axis + column
            elif OTHER_0 <= driver and driver <= OTHER_2:
                entry = OTHER + 3 * axis + driver - OTHER_0
            table[entry] += values[b, axis]


@jit
def error(table, axis, own_0, own_1, own_2, other_0, other_1, other_2, square, dt):
    """Return the error of the increment of one axis over a tick, rad or m/s.

    It is dt b + M u + G v + k u_axis^2 / dt, with the increments u of the sensor and v of the other sensor, and the row
    of the axis in the matrices: bias b, scale factors and misalignments M, g-sensitivity G, quadratic term k.

    Parameters
    ----------
    table : (24,) table of the sensor, as from `gather`, SI
    axis : 0 to 2, body axis
    own_0, own_1, own_2 : rad or m/s, increments of the sensor, body axes
    other_0, other_1, other_2 : m/s or rad, increments of the other sensor, body axes
    square : square of the axis' increment, divided by dt
    dt : s, of a tick
    """
    own_row = OWN + 3 * axis
    other_row = OTHER + 3 * axis
    return (
        dt * table[BIAS + axis]
        + table[own_row] * own_0
        + table[own_row + 1] * own_1
        + table[own_row + 2] * own_2
        + table[other_row] * other_0
        + table[other_row + 1] * other_1
        + table[other_row + 2] * other_2
        + table[SQUARES + axis] * square
    )


@inline_jit
def _errors(gyro, accel, biases_only, a0, a1, a2, f0, f1, f2, dt):
    """Return the errors (6) of a tick's increments: gyro (rad), then accelerometer (m/s), body axes.

    Parameters
    ----------
    gyro, accel : (24,) tables of `gather`
    biases_only : whether the tables have biases only; the other terms are then skipped
    a0, a1, a2 : rad, angle increments
    f0, f1, f2 : m/s, velocity increments
    dt : s, of a tick
    """
    if biases_only:
        return (
            dt * gyro[BIAS],
            dt * gyro[BIAS + 1],
            dt * gyro[BIAS + 2],
            dt * accel[BIAS],
            dt * accel[BIAS + 1],
            dt * accel[BIAS + 2],
        )
    gyro_square_0 = a0 * a0 / dt
    gyro_square_1 = a1 * a1 / dt
    gyro_square_2 = a2 * a2 / dt
    accel_square_0 = f0 * f0 / dt
    accel_square_1 = f1 * f1 / dt
    accel_square_2 = f2 * f2 / dt
    return (
        error(gyro, 0, a0, a1, a2, f0, f1, f2, gyro_square_0, dt),
        error(gyro, 1, a0, a1, a2, f0, f1, f2, gyro_square_1, dt),
        error(gyro, 2, a0, a1, a2, f0, f1, f2, gyro_square_2, dt),
        error(accel, 0, f0, f1, f2, a0, a1, a2, accel_square_0, dt),
        error(accel, 1, f0, f1, f2, a0, a1, a2, accel_square_1, dt),
        error(accel, 2, f0, f1, f2, a0, a1, a2, accel_square_2, dt),
    )


@jit
def quantise(increment, remainder, step_size):
    """Return a quantised increment and the new remainder, both in the unit of the increment.

    The output is increment + remainder, rounded to a whole number of steps. The remainder is added to the increment of
    the next tick, so that no angle or velocity is lost.

    Parameters
    ----------
    increment : increment of a tick, rad or m/s
    remainder : remainder of the previous tick
    step_size : quantisation step, above zero
    """
    total = increment + remainder
    n_step = (total / step_size + _ROUND) - _ROUND
    output = step_size * n_step
    return output, total - output


@jit
def corrupt(increments, first_row, first_tick, n_tick, dtheta, dvel, gyro, accel, noise, remainder, unit, k0, k1, run):
    """Set the increments that the IMU outputs in a window: true increments, deterministic errors, noise, quantisation.

    Parameters
    ----------
    increments : (n, 6) rad, m/s; those of n_tick ticks from `first_row` on are set
    first_row, first_tick, n_tick : index of the first increment, first tick and number of ticks
    dtheta, dvel : (n_tick, 3) rad, m/s, increments of an ideal IMU, body axes
    gyro, accel : (24,) tables of `gather`
    noise : (8,) standard deviation of white noise per tick and axis (gyro, accel), then quantisation steps (0: none)
    remainder : (6,) rad, m/s, remainder of the quantisation, updated in place
    unit : NamedTuple with dt (s), noise_source (word) and biases_only (no scale factor or other driver)
    k0, k1, run : key words of the seed; run, one or eight lanes
    """
    dt = unit.dt
    for k in range(n_tick):
        tick = first_tick + k
        row = first_row + k
        a0 = dtheta[tick, 0]
        a1 = dtheta[tick, 1]
        a2 = dtheta[tick, 2]
        f0 = dvel[tick, 0]
        f1 = dvel[tick, 1]
        f2 = dvel[tick, 2]
        draw_index = np.uint64(tick)
        # a draw is keyed by tick, so it does not depend on how the flight is divided into windows
        n0, n1, n2, n3 = normals(k0, k1, unit.noise_source, run, draw_index, np.uint64(0))
        n4, n5, _, _ = normals(k0, k1, unit.noise_source, run, draw_index, np.uint64(1))
        e0, e1, e2, e3, e4, e5 = _errors(gyro, accel, unit.biases_only, a0, a1, a2, f0, f1, f2, dt)
        increments[row, 0] = a0 + e0 + noise[0] * n0
        increments[row, 1] = a1 + e1 + noise[1] * n1
        increments[row, 2] = a2 + e2 + noise[2] * n2
        increments[row, 3] = f0 + e3 + noise[3] * n3
        increments[row, 4] = f1 + e4 + noise[4] * n4
        increments[row, 5] = f2 + e5 + noise[5] * n5
    for sensor in range(2):
        step_size = noise[6 + sensor]
        if step_size > 0.0:
            for row in range(first_row, first_row + n_tick):
                for axis in range(3 * sensor, 3 * sensor + 3):
                    output, new_remainder = quantise(increments[row, axis], remainder[axis], step_size)
                    increments[row, axis] = output
                    remainder[axis] = new_remainder


@jit
def compensate(increments, n_tick, gyro, accel, biases_only, dt):
    """Subtract the estimated IMU errors from the increments of a window.

    The parameters multiply the true input, which is unknown: the first pass uses the measured input, the second the
    corrected input.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, updated in place
    n_tick : number of ticks
    gyro, accel : (24,) tables of `gather` with the estimated parameters
    biases_only : whether the parameters are biases only
    dt : s, of a tick
    """
    for k in range(n_tick):
        a0 = increments[k, 0]
        a1 = increments[k, 1]
        a2 = increments[k, 2]
        f0 = increments[k, 3]
        f1 = increments[k, 4]
        f2 = increments[k, 5]
        w0, w1, w2 = a0, a1, a2
        g0, g1, g2 = f0, f1, f2
        for _ in range(2):
            e0, e1, e2, e3, e4, e5 = _errors(gyro, accel, biases_only, w0, w1, w2, g0, g1, g2, dt)
            w0 = a0 - e0
            w1 = a1 - e1
            w2 = a2 - e2
            g0 = f0 - e3
            g1 = f1 - e4
            g2 = f2 - e5
        increments[k, 0] = w0
        increments[k, 1] = w1
        increments[k, 2] = w2
        increments[k, 3] = g0
        increments[k, 4] = g1
        increments[k, 5] = g2


@jit
def zero_all(values):
    """Set every entry of a matrix of values to zero."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = number_like(values[i, j], 0.0)


@jit
def profile_value(unit, profile, axis, t):
    """Return the value (SI) of a deterministic profile, a ramp from 0 to its full value.

    Parameters
    ----------
    unit : NamedTuple with profile_start and profile_end (n_profile,) s since lift-off, and the full values `profile`
        (n_profile, 3)
    profile : index of the profile
    axis : 0 to 2
    t : s since lift-off

    Returns
    -------
    float
        Bias (rad/s or m/s^2) or scale factor.
    """
    first = unit.profile_start[profile]
    last = unit.profile_end[profile]
    progress = (t - first) / (last - first)
    share = min(1.0, max(0.0, progress))
    return share * unit.profile[profile, axis]
