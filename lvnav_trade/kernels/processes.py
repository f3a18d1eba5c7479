"""Error parameters of an inertial unit in one run: how they start, vary, and corrupt increments.

Parameters come in blocks of three (one per axis of a sensor); what a block multiplies is its driver (see
transition). Before the ticks they are gathered into one table per sensor, so that a tick costs the same however many
sources a card names.
"""

import numpy as np

from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2

# A sensor's table: constant (3), matrix on its own increments (9), on the other sensor's (9), on their squares (3).
BIAS, OWN, OTHER, SQUARES, N_TABLE = 0, 3, 12, 21, 24

_START, _ZERO = np.uint64(0), np.uint64(0)
# 2**52 * 1.5: adding and taking it off rounds a float64 below 2**51 to the nearest whole number
_ROUND = 6755399441055744.0


@jit
def start(values, sigma, sources, k0, k1, run):
    """Draw every block's value at the start: values, sigma (n_block, 3), the first set; sources (n_block,) words."""
    for b in range(sigma.shape[0]):
        normal = normals(k0, k1, sources[b], run, _START, _ZERO)
        for axis in range(3):
            values[b, axis] = sigma[b, axis] * normal[axis]


@jit
def step(values, decay, walk, sources, k0, k1, run, number):
    """Step every block that varies to epoch `number` (a word, from 1) of its process: values (n_block, 3) updated;
    decay (n_block,), walk (n_block, 3).
    """
    for b in range(decay.shape[0]):
        if walk[b, 0] + walk[b, 1] + walk[b, 2] > 0.0:
            normal = normals(k0, k1, sources[b], run, number, _ZERO)
            for axis in range(3):
                values[b, axis] = decay[b] * values[b, axis] + walk[b, axis] * normal[axis]


@jit
def gather(tables, values, sensors, drivers):
    """Sum blocks into the tables (2, 24) of gyro and accelerometer: what each parameter multiplies; tables set."""
    for sensor in range(2):
        for i in range(N_TABLE):
            tables[sensor, i] = 0.0 * values[0, 0]
    for b in range(sensors.shape[0]):
        table, kind = tables[sensors[b]], drivers[b]
        for axis in range(3):
            at = SQUARES + axis
            if kind == CONSTANT:
                at = BIAS + axis
            elif OWN_0 <= kind and kind <= OWN_2:
                at = OWN + 3 * axis + (axis + kind - OWN_0) % 3
            elif OTHER_0 <= kind and kind <= OTHER_2:
                at = OTHER + 3 * axis + kind - OTHER_0
            table[at] = table[at] + values[b, axis]


@jit
def error(table, axis, own_0, own_1, own_2, other_0, other_1, other_2, square, dt):
    """Return the error of one axis' increment over a tick; `square` is the own increment squared over dt."""
    return (
        dt * table[BIAS + axis]
        + table[OWN + 3 * axis] * own_0
        + table[OWN + 3 * axis + 1] * own_1
        + table[OWN + 3 * axis + 2] * own_2
        + table[OTHER + 3 * axis] * other_0
        + table[OTHER + 3 * axis + 1] * other_1
        + table[OTHER + 3 * axis + 2] * other_2
        + table[SQUARES + axis] * square
    )


@inlined
def _errors(gyro, accel, biases_only, a0, a1, a2, f0, f1, f2, dt):
    """Return the errors of a tick's increments, of the gyro (a0, a1, a2) and of the accelerometer (f0, f1, f2)."""
    if biases_only:
        return dt * gyro[0], dt * gyro[1], dt * gyro[2], dt * accel[0], dt * accel[1], dt * accel[2]
    return (
        error(gyro, 0, a0, a1, a2, f0, f1, f2, a0 * a0 / dt, dt),
        error(gyro, 1, a0, a1, a2, f0, f1, f2, a1 * a1 / dt, dt),
        error(gyro, 2, a0, a1, a2, f0, f1, f2, a2 * a2 / dt, dt),
        error(accel, 0, f0, f1, f2, a0, a1, a2, f0 * f0 / dt, dt),
        error(accel, 1, f0, f1, f2, a0, a1, a2, f1 * f1 / dt, dt),
        error(accel, 2, f0, f1, f2, a0, a1, a2, f2 * f2 / dt, dt),
    )


@jit
def quantise(increment, remainder, step_size):
    """Return the whole number of steps in increment + remainder, and what is left."""
    total = increment + remainder
    out = step_size * ((total / step_size + _ROUND) - _ROUND)
    return out, total - out


@jit
def corrupt(increments, at, first_tick, n_tick, dtheta, dvel, gyro, accel, noise, remainder, unit, k0, k1, run):
    """Fill a window with what the unit puts out: the increments, their error, white noise, and quantisation.

    Parameters
    ----------
    increments : (n, 6); n_tick rows from `at` set
    dtheta, dvel : (n_imu, 3) increments of the ideal unit (rad, m/s)
    gyro, accel : (24,) tables of `gather`
    noise : (8,) standard deviation of white noise per tick by axis (gyro, accel), quantisation steps (0: none)
    remainder : (6,) what quantisation has held back; updated
    unit : NamedTuple with dt, noise_source, biases_only (no scale factor or other driver)
    """
    dt = unit.dt
    for k in range(n_tick):
        tick, out = first_tick + k, at + k
        a0, a1, a2 = dtheta[tick, 0], dtheta[tick, 1], dtheta[tick, 2]
        f0, f1, f2 = dvel[tick, 0], dvel[tick, 1], dvel[tick, 2]
        number = np.uint64(tick)
        n0, n1, n2, n3 = normals(k0, k1, unit.noise_source, run, number, np.uint64(0))
        n4, n5, _, _ = normals(k0, k1, unit.noise_source, run, number, np.uint64(1))
        e0, e1, e2, e3, e4, e5 = _errors(gyro, accel, unit.biases_only, a0, a1, a2, f0, f1, f2, dt)
        increments[out, 0], increments[out, 1], increments[out, 2] = (
            a0 + e0 + noise[0] * n0,
            a1 + e1 + noise[1] * n1,
            a2 + e2 + noise[2] * n2,
        )
        increments[out, 3], increments[out, 4], increments[out, 5] = (
            f0 + e3 + noise[3] * n3,
            f1 + e4 + noise[4] * n4,
            f2 + e5 + noise[5] * n5,
        )
    for sensor in range(2):
        if noise[6 + sensor] > 0.0:
            for k in range(at, at + n_tick):
                for axis in range(3 * sensor, 3 * sensor + 3):
                    increments[k, axis], remainder[axis] = quantise(
                        increments[k, axis], remainder[axis], noise[6 + sensor]
                    )


@jit
def compensate(increments, n_tick, gyro, accel, biases_only, dt):
    """Take the filter's estimate of the unit's errors off the window's increments: increments updated.

    The parameters multiply the true input; the measured one stands for it in a first pass and the corrected in a
    second.
    """
    for k in range(n_tick):
        a0, a1, a2 = increments[k, 0], increments[k, 1], increments[k, 2]
        f0, f1, f2 = increments[k, 3], increments[k, 4], increments[k, 5]
        w0, w1, w2, g0, g1, g2 = a0, a1, a2, f0, f1, f2
        for _ in range(2):
            e0, e1, e2, e3, e4, e5 = _errors(gyro, accel, biases_only, w0, w1, w2, g0, g1, g2, dt)
            w0, w1, w2, g0, g1, g2 = a0 - e0, a1 - e1, a2 - e2, f0 - e3, f1 - e4, f2 - e5
        increments[k, 0], increments[k, 1], increments[k, 2] = w0, w1, w2
        increments[k, 3], increments[k, 4], increments[k, 5] = g0, g1, g2


@jit
def zero_all(values):
    """Set every entry of a matrix of values to zero."""
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            values[i, j] = like(values[i, j], 0.0)


@jit
def profile_value(unit, profile, axis, t):
    """Return the bias or scale factor (SI) that a profile has on an axis at time t (s since lift-off)."""
    first, last = unit.profile_start[profile], unit.profile_end[profile]
    share = min(1.0, max(0.0, (t - first) / (last - first)))
    return share * unit.profile[profile, axis]
