"""IMU arrays in a run (one run or eight lanes): output of each IMU, and the combined triad.

The errors of an IMU are given along its sensing axes: its tables (`processes.gather`) have a row per sensing axis, with
entries that multiply increments in body axes.
"""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, zeros_of
from lvnav_trade.kernels.processes import BIAS, N_TABLE, OTHER, OWN, SQUARES, quantise
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.imu_redundancy import begin_redundant, check, combine, entering, new_redundant, note


class ImuArrayWork(NamedTuple):
    """Arrays of an IMU array in a run, updated in place.

    tables : (2 n_triad, N_TABLE). Error tables of gyro and accelerometer of each triad.
    sensed : (n_triad, n_tick, 6) rad, m/s. Increments of the window as each IMU outputs them, along its axes.
    remainder : (n_triad, 6) rad, m/s. Remainder of quantisation.
    before : (4,). Combined angle increment of the previous tick (rad), and 1 if there is one.
    difference : (n_pair, 3) rad, m/s. Difference of two IMUs, summed since its last measurement.
    redundant : RedundancyWork, if the IMUs are tested or selected; otherwise None.
    """

    tables: Floats
    sensed: Floats
    remainder: Floats
    before: Floats
    difference: Floats
    redundant: Any = None


def new_units(units: Any, n_tick: int, lanes: int = 0) -> ImuArrayWork:
    """Return the arrays of an IMU array.

    Parameters
    ----------
    units
        ImuArray.
    n_tick
        Largest number of ticks of a window.
    lanes
        Number of runs on the last axis; 0 for one run without this axis.
    """
    n_triad = units.n_axis.size
    n_pair = units.pair_sensor.size
    redundancy = units.redundant
    shapes = {
        "tables": (2 * n_triad, N_TABLE),
        "sensed": (n_triad, n_tick, 6),
        "remainder": (n_triad, 6),
        "before": (4,),
        "difference": (max(1, n_pair), 3),
    }
    redundant = None if redundancy is None else new_redundant(int(redundancy.owner.max()) + 1, n_triad, lanes)
    return ImuArrayWork(**zeros_of(shapes, lanes), redundant=redundant)


@jit
def begin_units(imus, units):
    """Reset the arrays of an IMU array (ImuArray, or None) at the start of a run."""
    if units is not None:
        for i in range(4):
            imus.before[i] = like(imus.before[i], 0.0)
        for k in range(imus.remainder.shape[0]):
            for i in range(6):
                imus.remainder[k, i] = like(imus.remainder[k, i], 0.0)
        for p in range(imus.difference.shape[0]):
            for i in range(3):
                imus.difference[p, i] = like(imus.before[i], 0.0)
        begin_redundant(imus.redundant, units)


@jit
def take_difference(work, imus, units, k):
    """Set the measurement of sensor k, if it is a difference of two IMUs, to the sum since its last measurement."""
    if units is not None:
        p = units.pair_of[k]
        if p >= 0:
            for i in range(3):
                work.observed[k, i] = imus.difference[p, i]
                imus.difference[p, i] = like(imus.difference[p, i], 0.0)


@jit
def add_relative_biases(work, imus, units):
    """Add the true relative biases to the errors of the states that model them (ImuArray, or None)."""
    if units is not None:
        for p in range(units.pair_sensor.shape[0]):
            state = units.pair_state[p]
            if state >= 0:
                for k in range(units.n_axis.shape[0]):
                    table = imus.tables[2 * k + units.pair_sensor[p]]
                    for c in range(units.n_axis[k]):
                        bias = table[BIAS + c]
                        for i in range(3):
                            share = units.pair_solved[p, k, i, c]
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
def gather_units(imus, units, values, sensors, drivers):
    """Sum the true parameters into the tables of the triads; arguments as in `processes.gather`."""
    for k in range(imus.tables.shape[0]):
        for i in range(N_TABLE):
            imus.tables[k, i] = like(imus.tables[k, i], 0.0)
    for b in range(sensors.shape[0]):
        triad = units.triads[b]
        table = imus.tables[2 * triad + sensors[b]]
        _gather_block(table, units.frames[triad], drivers[b], values[b])


@jit
def fuse_tables(fused, imus, units, tick):
    """Set the tables of the combined triad at a tick, which give the true values of filter parameters.

    Nonlinearity is not included: it depends on squares along the axes of each IMU.

    Parameters
    ----------
    fused : (2, N_TABLE) set here
    imus, units : ImuArrayWork, ImuArray
    tick : index
    """
    for sensor in range(2):
        combined = fused[sensor]
        for i in range(N_TABLE):
            combined[i] = like(combined[i], 0.0)
        for k in range(units.n_axis.shape[0]):
            table = imus.tables[2 * k + sensor]
            for c in range(units.n_axis[k]):
                bias = table[BIAS + c]
                for i in range(3):
                    share = entering(imus.redundant, units, tick, k, sensor, i, c)
                    combined[BIAS + i] = combined[BIAS + i] + share * bias
                    for first in (OWN, OTHER):
                        for j in range(3):
                            entry = first + 3 * i + j
                            axis_entry = first + 3 * c + j
                            combined[entry] = combined[entry] + share * table[axis_entry]


@inlined
def _axis_error(table, c, along, a, other, dt):
    """Return the error of an increment along sensing axis c, rad or m/s.

    Parameters
    ----------
    table : (N_TABLE,) table of the sensor, with a row per sensing axis
    c : sensing axis
    along : increment along the axis
    a, other : (3,) increments of the sensor and of the other sensor, body axes
    dt : s, of a tick
    """
    first_own = OWN + 3 * c
    first_other = OTHER + 3 * c
    bias_increment = dt * table[BIAS + c]
    nonlinearity = table[SQUARES + c] * (along * along / dt)
    return (
        bias_increment
        + table[first_own] * a[0]
        + table[first_own + 1] * a[1]
        + table[first_own + 2] * a[2]
        + table[first_other] * other[0]
        + table[first_other + 1] * other[1]
        + table[first_other + 2] * other[2]
        + nonlinearity
    )


@inlined
def _component(direction, x, y, z):
    """Return the component of a vector x, y, z along a direction (3,)."""
    return direction[0] * x + direction[1] * y + direction[2] * z


@jit
def _sense_triad(imus, units, k, at, ticks, dt, key, run):
    """Set the increments of a triad over some ticks: true increments, errors, white noise, quantisation.

    Parameters
    ----------
    imus : ImuArrayWork, of which `sensed` and `remainder` are updated in place
    units : ImuArray
    k : triad
    at : index of the first increment in the window
    ticks : (2,) first tick, number of ticks
    dt : s, of a tick
    key : (2,) key words of the seed
    run : number of the run, one or eight lanes
    """
    first_tick, n_tick = ticks
    k0, k1 = key
    out = imus.sensed[k]
    frames = units.frames[k]
    white = units.white[k]
    source = units.noise_sources[k]
    gyro = imus.tables[2 * k]
    accel = imus.tables[2 * k + 1]
    for tick in range(first_tick, first_tick + n_tick):
        row = at + tick - first_tick
        epoch = np.uint64(tick)
        a = units.dtheta[k, tick]
        f = units.dvel[k, tick]
        n0, n1, n2, n3 = normals(k0, k1, source, run, epoch, np.uint64(0))
        n4, n5, _, _ = normals(k0, k1, source, run, epoch, np.uint64(1))
        gyro_noise = (n0, n1, n2)
        accel_noise = (n3, n4, n5)
        for c in range(3):
            h = frames[c, 0]
            angle = _component(h, a[0], a[1], a[2])
            angle_error = _axis_error(gyro, c, angle, a, f, dt)
            angle_noise = white[c] * gyro_noise[c]
            out[row, c] = angle + angle_error + angle_noise
            velocity = _component(h, f[0], f[1], f[2])
            velocity_error = _axis_error(accel, c, velocity, f, a, dt)
            velocity_noise = white[3 + c] * accel_noise[c]
            out[row, 3 + c] = velocity + velocity_error + velocity_noise
    _quantise_triad(out, imus.remainder[k], white, at, n_tick)


@jit
def lever_arm_increment(imus, units, k, x, y, z, dt):
    """Return the velocity increment (3) m/s of a triad by its lever arm r over a tick, body axes.

    It is dw x r + w x (w x r) dt, with w dt the combined angle increment of the tick, and dw the change of w since the
    previous tick.

    Parameters
    ----------
    imus : ImuArrayWork, with the combined angle increment of the previous tick
    units : ImuArray, with the lever arms (m, body axes)
    k : triad
    x, y, z : rad, combined angle increment of the tick, body axes
    dt : s, of a tick
    """
    lever = units.lever[k]
    before = imus.before
    has_before = before[3]  # 0 at the first tick, which has no previous one
    dx = has_before * (x - before[0])
    dy = has_before * (y - before[1])
    dz = has_before * (z - before[2])
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
def _add_difference(imus, units, sensor, k, c, value):
    """Add an increment along axis c of triad k to the measured differences of two IMUs."""
    for p in range(units.pair_sensor.shape[0]):
        if units.pair_sensor[p] == sensor:
            for i in range(3):
                share = units.pair_solved[p, k, i, c] * value
                imus.difference[p, i] = imus.difference[p, i] + share


@jit
def _quantise_triad(out, remainder, white, at, n_tick):
    """Round the increments (n, 6) of a triad from row `at` on; white : (8,) as in ImuArray, the last two are steps."""
    for sensor in range(2):
        step = white[6 + sensor]
        if step > 0.0:
            first = 3 * sensor
            for row in range(at, at + n_tick):
                for i in range(first, first + 3):
                    out[row, i], remainder[i] = quantise(out[row, i], remainder[i], step)


@jit
def _fuse(increments, imus, units, at, n_tick, dt):
    """Set the increments of the combined triad from those of the IMUs, with lever arms compensated."""
    n = units.n_axis.shape[0]
    solved = units.solved[0]
    for row in range(at, at + n_tick):
        for i in range(6):
            increments[row, i] = like(increments[row, i], 0.0)
        for k in range(n):
            for c in range(units.n_axis[k]):
                angle = imus.sensed[k, row, c]
                for i in range(3):
                    angle_share = solved[k, 0, i, c] * angle
                    increments[row, i] = increments[row, i] + angle_share
                _add_difference(imus, units, 0, k, c, angle)
        x = increments[row, 0]
        y = increments[row, 1]
        z = increments[row, 2]
        for k in range(n):
            sx, sy, sz = lever_arm_increment(imus, units, k, x, y, z, dt)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                lever_arm_velocity = _component(h, sx, sy, sz)
                velocity = imus.sensed[k, row, 3 + c] - lever_arm_velocity
                for i in range(3):
                    velocity_share = solved[k, 1, i, c] * velocity
                    increments[row, 3 + i] = increments[row, 3 + i] + velocity_share
                _add_difference(imus, units, 1, k, c, velocity)
        _store_angle(imus.before, x, y, z)


@jit
def _store_angle(before, x, y, z):
    """Store the combined angle increment of a tick for the lever arms at the next."""
    before[0] = x
    before[1] = y
    before[2] = z
    before[3] = like(x, 1.0)


@jit
def _fuse_redundant(increments, imus, units, redundancy, at, first_tick, n_tick, dt):
    """Set the increments of the combined triad as `_fuse` does, for IMUs with a parity test or a selection.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, body axes, updated in place
    imus, units : ImuArrayWork, ImuArray
    redundancy : ImuRedundancy
    at : index of the first increment in the window
    first_tick, n_tick : first tick, number of ticks
    dt : s, of a tick
    """
    n = units.n_axis.shape[0]
    redundant = imus.redundant
    for row in range(at, at + n_tick):
        for k in range(n):
            for c in range(units.n_axis[k]):
                angle = imus.sensed[k, row, c]
                note(redundant, 0, k, c, angle)
        combine(increments, redundant, units, redundancy, row, 0)
        x = increments[row, 0]
        y = increments[row, 1]
        z = increments[row, 2]
        for k in range(n):
            sx, sy, sz = lever_arm_increment(imus, units, k, x, y, z, dt)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                lever_arm_velocity = _component(h, sx, sy, sz)
                velocity = imus.sensed[k, row, 3 + c] - lever_arm_velocity
                note(redundant, 1, k, c, velocity)
        combine(increments, redundant, units, redundancy, row, 1)
        _store_angle(imus.before, x, y, z)
        tick = first_tick + row - at
        check(redundant, units, redundancy, tick)


@jit
def _fuse_ticks(increments, imus, units, redundancy, at, first_tick, n_tick, dt):
    """Set the increments of the combined triad; redundancy : ImuRedundancy, or None."""
    if redundancy is None:
        _fuse(increments, imus, units, at, n_tick, dt)
    else:
        _fuse_redundant(increments, imus, units, redundancy, at, first_tick, n_tick, dt)


@jit
def sense_units(work, imus, units, at, first_tick, n_tick, dt, key):
    """Set the increments of the combined triad for some ticks.

    The increments of each IMU are in `imus.sensed` afterwards.

    Parameters
    ----------
    work : Work, of which `increments` is updated in place
    imus, units : ImuArrayWork, ImuArray
    at : index of the first increment in the window
    first_tick, n_tick : first tick, number of ticks
    dt : s, of a tick
    key : (2,) key words of the seed
    """
    for k in range(units.n_axis.shape[0]):
        _sense_triad(imus, units, k, at, (first_tick, n_tick), dt, key, work.run[0])
    _fuse_ticks(work.increments, imus, units, units.redundant, at, first_tick, n_tick, dt)
