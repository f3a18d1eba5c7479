"""IMU arrays in a run (one run or eight lanes): output of each IMU, and the combined triad.

The errors of an IMU are given along its sensing axes: its tables (`processes.gather`) have a row per sensing axis, with
entries that multiply increments in body axes.
"""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, zeros_of
from lvnav_trade.kernels.processes import BIAS, N_TABLE, OTHER, OWN, SQUARES, quantise
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.imu_redundancy import (
    begin_redundant,
    check,
    combine,
    entry_weight,
    new_redundant,
    store_increment,
)


class ImuArrayWork(NamedTuple):
    """Arrays of an IMU array in a run, updated in place.

    tables : (2 n_triad, N_TABLE). Error tables of gyro and accelerometer of each triad.
    increments : (n_triad, n_tick, 6) rad, m/s. Increments of the window as each IMU outputs them, along its axes.
    remainder : (n_triad, 6) rad, m/s. Remainder of quantisation.
    previous_increment : (4,). Combined angle increment of the previous tick (rad), and 1 if there is one.
    difference : (n_pair, 3) rad, m/s. Difference of two IMUs, summed since its last measurement.
    redundant : RedundancyWork, if the IMUs are tested or selected; otherwise None.
    """

    tables: Floats
    increments: Floats
    remainder: Floats
    previous_increment: Floats
    difference: Floats
    redundant: Any = None


def new_units(imu_array: Any, n_tick: int, lanes: int = 0) -> ImuArrayWork:
    """Return the arrays of an IMU array.

    Parameters
    ----------
    imu_array
        ImuArray.
    n_tick
        Largest number of ticks of a window.
    lanes
        Number of runs on the last axis; 0 for one run without this axis.
    """
    n_triad = imu_array.n_axis.size
    n_pair = imu_array.pair_sensor.size
    redundancy = imu_array.redundant
    shapes = {
        "tables": (2 * n_triad, N_TABLE),
        "increments": (n_triad, n_tick, 6),
        "remainder": (n_triad, 6),
        "previous_increment": (4,),
        "difference": (max(1, n_pair), 3),
    }
    redundant = None if redundancy is None else new_redundant(int(redundancy.owner.max()) + 1, n_triad, lanes)
    return ImuArrayWork(**zeros_of(shapes, lanes), redundant=redundant)


@jit
def begin_units(imu_array_work, imu_array):
    """Reset the arrays of an IMU array (ImuArray, or None) at the start of a run."""
    if imu_array is not None:
        for i in range(4):
            imu_array_work.previous_increment[i] = number_like(imu_array_work.previous_increment[i], 0.0)
        for k in range(imu_array_work.remainder.shape[0]):
            for i in range(6):
                imu_array_work.remainder[k, i] = number_like(imu_array_work.remainder[k, i], 0.0)
        for p in range(imu_array_work.difference.shape[0]):
            for i in range(3):
                imu_array_work.difference[p, i] = number_like(imu_array_work.previous_increment[i], 0.0)
        begin_redundant(imu_array_work.redundant, imu_array)


@jit
def take_difference(work, imu_array_work, imu_array, k):
    """Set the measurement of sensor k, if it is a difference of two IMUs, to the sum since its last measurement."""
    if imu_array is not None:
        p = imu_array.pair_of[k]
        if p >= 0:
            for i in range(3):
                work.sensor_measurements[k, i] = imu_array_work.difference[p, i]
                imu_array_work.difference[p, i] = number_like(imu_array_work.difference[p, i], 0.0)


@jit
def add_relative_biases(work, imu_array_work, imu_array):
    """Add the true relative biases to the errors of the states that model them (ImuArray, or None)."""
    if imu_array is not None:
        for p in range(imu_array.pair_sensor.shape[0]):
            state = imu_array.pair_state[p]
            if state >= 0:
                for k in range(imu_array.n_axis.shape[0]):
                    table = imu_array_work.tables[2 * k + imu_array.pair_sensor[p]]
                    for c in range(imu_array.n_axis[k]):
                        bias = table[BIAS + c]
                        for i in range(3):
                            share = imu_array.pair_weights[p, k, i, c]
                            work.x[state + i] = work.x[state + i] + share * bias


@jit
def _gather_block(table, frames, driver, values):
    """Add a block of three parameters to the table of its triad.

    Parameters
    ----------
    table : (N_TABLE,) table of a sensor of the triad, updated in place
    frames : (3, 3, 3) direction and misalignment directions of each sensing axis, body axes
    driver : driver of the block, see `transition.driver`
    values : (3,) parameters by sensing axis, SI
    """
    for axis in range(3):
        value = values[axis]
        if driver == CONSTANT:
            table[BIAS + axis] = table[BIAS + axis] + value
        elif OWN_0 <= driver and driver <= OWN_2:
            direction = frames[axis, driver - OWN_0]
            for j in range(3):
                entry = OWN + 3 * axis + j
                table[entry] = table[entry] + direction[j] * value
        elif OTHER_0 <= driver and driver <= OTHER_2:
            direction = frames[axis, (driver - OTHER_0 - axis) % 3]
            for j in range(3):
                entry = OTHER + 3 * axis + j
                table[entry] = table[entry] + direction[j] * value
        else:
            table[SQUARES + axis] = table[SQUARES + axis] + value


@jit
def gather_units(imu_array_work, imu_array, values, sensors, drivers):
    """Sum the true parameters into the tables of the triads; arguments as in `processes.gather`."""
    for k in range(imu_array_work.tables.shape[0]):
        for i in range(N_TABLE):
            imu_array_work.tables[k, i] = number_like(imu_array_work.tables[k, i], 0.0)
    for b in range(sensors.shape[0]):
        triad = imu_array.triads[b]
        table = imu_array_work.tables[2 * triad + sensors[b]]
        _gather_block(table, imu_array.frames[triad], drivers[b], values[b])


@jit
def combine_tables(combined_tables, imu_array_work, imu_array, tick):
    """Set the tables of the combined triad at a tick, which give the true values of filter parameters.

    Nonlinearity is not included: it depends on squares along the axes of each IMU.

    Parameters
    ----------
    combined_tables : (2, N_TABLE) set here
    imu_array_work, imu_array : ImuArrayWork, ImuArray
    tick : index
    """
    for sensor in range(2):
        combined_table = combined_tables[sensor]
        for i in range(N_TABLE):
            combined_table[i] = number_like(combined_table[i], 0.0)
        for k in range(imu_array.n_axis.shape[0]):
            table = imu_array_work.tables[2 * k + sensor]
            for c in range(imu_array.n_axis[k]):
                bias = table[BIAS + c]
                for i in range(3):
                    share = entry_weight(imu_array_work.redundant, imu_array, tick, k, sensor, i, c)
                    combined_table[BIAS + i] = combined_table[BIAS + i] + share * bias
                    for first in (OWN, OTHER):
                        for j in range(3):
                            entry = first + 3 * i + j
                            axis_entry = first + 3 * c + j
                            combined_table[entry] = combined_table[entry] + share * table[axis_entry]


@inline_jit
def _axis_error(table, c, axis_increment, a, other_increments, dt):
    """Return the error of an increment along sensing axis c, rad or m/s.

    Parameters
    ----------
    table : (N_TABLE,) table of the sensor, with a row per sensing axis
    c : sensing axis
    axis_increment : increment along the axis
    a, other_increments : (3,) increments of the sensor and of the other sensor, body axes
    dt : s, of a tick
    """
    first_own = OWN + 3 * c
    first_other = OTHER + 3 * c
    bias_increment = dt * table[BIAS + c]
    nonlinearity = table[SQUARES + c] * (axis_increment * axis_increment / dt)
    return (
        bias_increment
        + table[first_own] * a[0]
        + table[first_own + 1] * a[1]
        + table[first_own + 2] * a[2]
        + table[first_other] * other_increments[0]
        + table[first_other + 1] * other_increments[1]
        + table[first_other + 2] * other_increments[2]
        + nonlinearity
    )


@inline_jit
def _component(direction, x, y, z):
    """Return the component of a vector x, y, z along a direction (3,)."""
    return direction[0] * x + direction[1] * y + direction[2] * z


@jit
def _sense_triad(imu_array_work, imu_array, k, first_row, ticks, dt, key, run):
    """Set the increments of a triad over some ticks: true increments, errors, white noise, quantisation.

    Parameters
    ----------
    imu_array_work : ImuArrayWork, of which `increments` and `remainder` are updated in place
    imu_array : ImuArray
    k : triad
    first_row : index of the first increment in the window
    ticks : (2,) first tick, number of ticks
    dt : s, of a tick
    key : (2,) key words of the seed
    run : number of the run, one or eight lanes
    """
    first_tick, n_tick = ticks
    k0, k1 = key
    increments = imu_array_work.increments[k]
    frames = imu_array.frames[k]
    white = imu_array.white[k]
    source = imu_array.noise_sources[k]
    gyro = imu_array_work.tables[2 * k]
    accel = imu_array_work.tables[2 * k + 1]
    for tick in range(first_tick, first_tick + n_tick):
        row = first_row + tick - first_tick
        draw_index = np.uint64(tick)
        a = imu_array.dtheta[k, tick]
        f = imu_array.dvel[k, tick]
        n0, n1, n2, n3 = normals(k0, k1, source, run, draw_index, np.uint64(0))
        n4, n5, _, _ = normals(k0, k1, source, run, draw_index, np.uint64(1))
        gyro_noise = (n0, n1, n2)
        accel_noise = (n3, n4, n5)
        for c in range(3):
            h = frames[c, 0]
            angle = _component(h, a[0], a[1], a[2])
            angle_error = _axis_error(gyro, c, angle, a, f, dt)
            angle_noise = white[c] * gyro_noise[c]
            increments[row, c] = angle + angle_error + angle_noise
            velocity = _component(h, f[0], f[1], f[2])
            velocity_error = _axis_error(accel, c, velocity, f, a, dt)
            velocity_noise = white[3 + c] * accel_noise[c]
            increments[row, 3 + c] = velocity + velocity_error + velocity_noise
    _quantise_triad(increments, imu_array_work.remainder[k], white, first_row, n_tick)


@jit
def lever_arm_increment(imu_array_work, imu_array, k, x, y, z, dt):
    """Return the velocity increment (3) m/s of a triad by its lever arm r over a tick, body axes.

    It is dw x r + w x (w x r) dt, with w dt the combined angle increment of the tick, and dw the change of w since the
    previous tick.

    Parameters
    ----------
    imu_array_work : ImuArrayWork, with the combined angle increment of the previous tick
    imu_array : ImuArray, with the lever arms (m, body axes)
    k : triad
    x, y, z : rad, combined angle increment of the tick, body axes
    dt : s, of a tick
    """
    lever = imu_array.lever[k]
    previous_increment = imu_array_work.previous_increment
    has_previous = previous_increment[3]  # 0 at the first tick, which has no previous one
    dx = has_previous * (x - previous_increment[0])
    dy = has_previous * (y - previous_increment[1])
    dz = has_previous * (z - previous_increment[2])
    lever_x = lever[0]
    lever_y = lever[1]
    lever_z = lever[2]
    tx, ty, tz = cross(dx, dy, dz, lever_x, lever_y, lever_z)  # tangential
    wx, wy, wz = cross(x, y, z, lever_x, lever_y, lever_z)
    cx, cy, cz = cross(x, y, z, wx, wy, wz)  # centripetal
    vx = (tx + cx) / dt
    vy = (ty + cy) / dt
    vz = (tz + cz) / dt
    return vx, vy, vz


@jit
def _add_difference(imu_array_work, imu_array, sensor, k, c, value):
    """Add an increment along axis c of triad k to the measured differences of two IMUs."""
    for p in range(imu_array.pair_sensor.shape[0]):
        if imu_array.pair_sensor[p] == sensor:
            for i in range(3):
                share = imu_array.pair_weights[p, k, i, c] * value
                imu_array_work.difference[p, i] = imu_array_work.difference[p, i] + share


@jit
def _quantise_triad(increments, remainder, white, first_row, n_tick):
    """Round the increments of a triad from row `first_row` on.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, updated in place
    remainder : (6,) rad, m/s, remainder of quantisation, updated in place
    white : (8,) as in ImuArray; the last two entries are the quantisation steps
    first_row : index of the first increment in the window
    n_tick : number of ticks
    """
    for sensor in range(2):
        step = white[6 + sensor]
        if step > 0.0:
            first = 3 * sensor
            for row in range(first_row, first_row + n_tick):
                for i in range(first, first + 3):
                    increments[row, i], remainder[i] = quantise(increments[row, i], remainder[i], step)


@jit
def _combine_imus(increments, imu_array_work, imu_array, first_row, n_tick, dt):
    """Set the increments of the combined triad from those of the IMUs, with lever arms compensated."""
    n = imu_array.n_axis.shape[0]
    axis_weights = imu_array.axis_weights[0]
    for row in range(first_row, first_row + n_tick):
        for i in range(6):
            increments[row, i] = number_like(increments[row, i], 0.0)
        for k in range(n):
            for c in range(imu_array.n_axis[k]):
                angle = imu_array_work.increments[k, row, c]
                for i in range(3):
                    angle_share = axis_weights[k, 0, i, c] * angle
                    increments[row, i] = increments[row, i] + angle_share
                _add_difference(imu_array_work, imu_array, 0, k, c, angle)
        x = increments[row, 0]
        y = increments[row, 1]
        z = increments[row, 2]
        for k in range(n):
            sx, sy, sz = lever_arm_increment(imu_array_work, imu_array, k, x, y, z, dt)
            for c in range(imu_array.n_axis[k]):
                h = imu_array.frames[k, c, 0]
                lever_arm_velocity = _component(h, sx, sy, sz)
                velocity = imu_array_work.increments[k, row, 3 + c] - lever_arm_velocity
                for i in range(3):
                    velocity_share = axis_weights[k, 1, i, c] * velocity
                    increments[row, 3 + i] = increments[row, 3 + i] + velocity_share
                _add_difference(imu_array_work, imu_array, 1, k, c, velocity)
        _store_angle(imu_array_work.previous_increment, x, y, z)


@jit
def _store_angle(previous_increment, x, y, z):
    """Store the combined angle increment of a tick for the lever arms at the next."""
    previous_increment[0] = x
    previous_increment[1] = y
    previous_increment[2] = z
    previous_increment[3] = number_like(x, 1.0)


@jit
def _combine_redundant(increments, imu_array_work, imu_array, redundancy, first_row, first_tick, n_tick, dt):
    """Set the increments of the combined triad as `_combine_imus` does, for IMUs with a parity test or a selection.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, body axes, updated in place
    imu_array_work, imu_array : ImuArrayWork, ImuArray
    redundancy : ImuRedundancy
    first_row : index of the first increment in the window
    first_tick, n_tick : first tick, number of ticks
    dt : s, of a tick
    """
    n = imu_array.n_axis.shape[0]
    redundant = imu_array_work.redundant
    for row in range(first_row, first_row + n_tick):
        for k in range(n):
            for c in range(imu_array.n_axis[k]):
                angle = imu_array_work.increments[k, row, c]
                store_increment(redundant, 0, k, c, angle)
        combine(increments, redundant, imu_array, redundancy, row, 0)
        x = increments[row, 0]
        y = increments[row, 1]
        z = increments[row, 2]
        for k in range(n):
            sx, sy, sz = lever_arm_increment(imu_array_work, imu_array, k, x, y, z, dt)
            for c in range(imu_array.n_axis[k]):
                h = imu_array.frames[k, c, 0]
                lever_arm_velocity = _component(h, sx, sy, sz)
                velocity = imu_array_work.increments[k, row, 3 + c] - lever_arm_velocity
                store_increment(redundant, 1, k, c, velocity)
        combine(increments, redundant, imu_array, redundancy, row, 1)
        _store_angle(imu_array_work.previous_increment, x, y, z)
        tick = first_tick + row - first_row
        check(redundant, imu_array, redundancy, tick)


@jit
def _combine_ticks(increments, imu_array_work, imu_array, redundancy, first_row, first_tick, n_tick, dt):
    """Set the increments of the combined triad; redundancy : ImuRedundancy, or None."""
    if redundancy is None:
        _combine_imus(increments, imu_array_work, imu_array, first_row, n_tick, dt)
    else:
        _combine_redundant(increments, imu_array_work, imu_array, redundancy, first_row, first_tick, n_tick, dt)


@jit
def sense_units(work, imu_array_work, imu_array, first_row, first_tick, n_tick, dt, key):
    """Set the increments of the combined triad for some ticks.

    The increments of each IMU are in `imu_array_work.increments` afterwards.

    Parameters
    ----------
    work : Work, of which `increments` is updated in place
    imu_array_work, imu_array : ImuArrayWork, ImuArray
    first_row : index of the first increment in the window
    first_tick, n_tick : first tick, number of ticks
    dt : s, of a tick
    key : (2,) key words of the seed
    """
    for k in range(imu_array.n_axis.shape[0]):
        _sense_triad(imu_array_work, imu_array, k, first_row, (first_tick, n_tick), dt, key, work.run[0])
    _combine_ticks(work.increments, imu_array_work, imu_array, imu_array.redundant, first_row, first_tick, n_tick, dt)
