"""IMU arrays in a run (one run or eight lanes): output of each IMU, and the combined triad.

Errors of a unit are in axes of its own: its tables (`processes.gather`) have a row per sensing axis, whose entries
multiply increments in body axes.
"""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.engines.simulate.redundancy import begin_redundant, check, combine, entering, new_redundant, note
from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, zeros_of
from lvnav_trade.kernels.processes import BIAS, N_TABLE, OTHER, OWN, SQUARES, quantise
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OTHER_2, OWN_0, OWN_2
from lvnav_trade.records import Floats


class UnitWork(NamedTuple):
    """Arrays of the units of a run: tables (2 n_triad, N_TABLE) of gyro and accelerometer of each triad; sensed
    (n_triad, n_tick, 6) increments of the window as they leave the units, along their axes; remainder (n_triad, 6) that
    quantisation holds back; before (4,) fused angle of the tick before, and whether there is one; difference
    (n_pair, 3) of two units, summed since it was measured; redundant (RedundantWork): of units that are tested or
    selected, None of others.
    """

    tables: Floats
    sensed: Floats
    remainder: Floats
    before: Floats
    difference: Floats
    redundant: Any = None


def new_units(units: Any, n_tick: int, lanes: int = 0) -> UnitWork:
    """Return the arrays of a run's units (Units): one run, or `lanes` runs on the last axis."""
    n_triad, n_pair, vote = units.n_axis.size, units.pair_sensor.size, units.redundant
    shapes = {
        "tables": (2 * n_triad, N_TABLE),
        "sensed": (n_triad, n_tick, 6),
        "remainder": (n_triad, 6),
        "before": (4,),
        "difference": (max(1, n_pair), 3),
    }
    redundant = None if vote is None else new_redundant(int(vote.owner.max()) + 1, n_triad, lanes)
    return UnitWork(**zeros_of(shapes, lanes), redundant=redundant)


@jit
def begin_units(own, units):
    """Set the arrays of the units to what they are before the first tick."""
    if units is not None:
        for i in range(4):
            own.before[i] = like(own.before[i], 0.0)
        for k in range(own.remainder.shape[0]):
            for i in range(6):
                own.remainder[k, i] = like(own.remainder[k, i], 0.0)
        for p in range(own.difference.shape[0]):
            for i in range(3):
                own.difference[p, i] = like(own.before[i], 0.0)
        begin_redundant(own.redundant, units)


@jit
def take_difference(work, own, units, k):
    """Set what sensor k measures, if that is a difference of two units, to its sum since the measurement before."""
    if units is not None:
        p = units.pair_of[k]
        if p >= 0:
            for i in range(3):
                work.observed[k, i] = own.difference[p, i]
                own.difference[p, i] = like(own.difference[p, i], 0.0)


@jit
def add_relative_biases(work, own, units):
    """Add to the errors of the states of relative biases the true ones."""
    if units is not None:
        for p in range(units.pair_sensor.shape[0]):
            at = units.pair_state[p]
            if at >= 0:
                for k in range(units.n_axis.shape[0]):
                    table = own.tables[2 * k + units.pair_sensor[p]]
                    for c in range(units.n_axis[k]):
                        for i in range(3):
                            work.x[at + i] = work.x[at + i] + units.pair_solved[p, k, i, c] * table[BIAS + c]


@jit
def _gather_block(table, frames, kind, values):
    """Add a block of three parameters to the table of its triad."""
    for axis in range(3):
        value = values[axis]
        if kind == CONSTANT:
            table[BIAS + axis] = table[BIAS + axis] + value
        elif OWN_0 <= kind and kind <= OWN_2:
            for j in range(3):
                at = OWN + 3 * axis + j
                table[at] = table[at] + frames[axis, kind - OWN_0, j] * value
        elif OTHER_0 <= kind and kind <= OTHER_2:
            for j in range(3):
                at = OTHER + 3 * axis + j
                table[at] = table[at] + frames[axis, (kind - OTHER_0 - axis) % 3, j] * value
        else:
            table[SQUARES + axis] = table[SQUARES + axis] + value


@jit
def gather_units(own, units, values, sensors, drivers):
    """Sum the true parameters into the tables of the units."""
    for k in range(own.tables.shape[0]):
        for i in range(N_TABLE):
            own.tables[k, i] = like(own.tables[k, i], 0.0)
    for b in range(sensors.shape[0]):
        triad = units.triads[b]
        _gather_block(own.tables[2 * triad + sensors[b]], units.frames[triad], drivers[b], values[b])


@jit
def fuse_tables(fused, own, units, tick):
    """Set the tables (2, N_TABLE) of the fused triad at a tick: what the parameters of a filter stand for;
    nonlinearity, which enters by squares along the axes of the units, is none of them.
    """
    for sensor in range(2):
        for i in range(N_TABLE):
            fused[sensor, i] = like(fused[sensor, i], 0.0)
        for k in range(units.n_axis.shape[0]):
            table = own.tables[2 * k + sensor]
            for c in range(units.n_axis[k]):
                for i in range(3):
                    share = entering(own.redundant, units, tick, k, sensor, i, c)
                    fused[sensor, BIAS + i] = fused[sensor, BIAS + i] + share * table[BIAS + c]
                    for first in (OWN, OTHER):
                        for j in range(3):
                            at = first + 3 * i + j
                            fused[sensor, at] = fused[sensor, at] + share * table[first + 3 * c + j]


@inlined
def _axis_error(table, c, along, a, other, dt):
    """Return the error of an increment along an axis, all inputs in body axes."""
    return (
        dt * table[BIAS + c]
        + table[OWN + 3 * c] * a[0]
        + table[OWN + 3 * c + 1] * a[1]
        + table[OWN + 3 * c + 2] * a[2]
        + table[OTHER + 3 * c] * other[0]
        + table[OTHER + 3 * c + 1] * other[1]
        + table[OTHER + 3 * c + 2] * other[2]
        + table[SQUARES + c] * (along * along / dt)
    )


@jit
def _sense_triad(own, units, k, at, ticks, dt, key, run):
    """Fill the increments of a triad over some ticks: ideal ones, their errors, white noise, quantisation.

    ticks : (2,) the first one and how many; key : (2,) words of the seed
    """
    (first_tick, n_tick), (k0, k1) = ticks, key
    out, frames, white = own.sensed[k], units.frames[k], units.white[k]
    gyro, accel = own.tables[2 * k], own.tables[2 * k + 1]
    for tick in range(first_tick, first_tick + n_tick):
        row, epoch = at + tick - first_tick, np.uint64(tick)
        a, f = units.dtheta[k, tick], units.dvel[k, tick]
        n0, n1, n2, n3 = normals(k0, k1, units.noise_sources[k], run, epoch, np.uint64(0))
        n4, n5, _, _ = normals(k0, k1, units.noise_sources[k], run, epoch, np.uint64(1))
        turned, pushed = (n0, n1, n2), (n3, n4, n5)
        for c in range(3):
            h = frames[c, 0]
            angle = h[0] * a[0] + h[1] * a[1] + h[2] * a[2]
            speed = h[0] * f[0] + h[1] * f[1] + h[2] * f[2]
            out[row, c] = angle + _axis_error(gyro, c, angle, a, f, dt) + white[c] * turned[c]
            out[row, 3 + c] = speed + _axis_error(accel, c, speed, f, a, dt) + white[3 + c] * pushed[c]
    for sensor in range(2):
        if white[6 + sensor] > 0.0:
            for row in range(at, at + n_tick):
                for i in range(3 * sensor, 3 * sensor + 3):
                    out[row, i], own.remainder[k, i] = quantise(out[row, i], own.remainder[k, i], white[6 + sensor])


@jit
def swung(own, units, k, x, y, z, dt):
    """Return what the lever arm of a triad puts into its increment of velocity over a tick, body axes: by the fused
    angle (x, y, z) rad of the tick and its change since the tick before.
    """
    lever, before = units.lever[k], own.before
    first = before[3]  # 0 before there is a tick
    tx, ty, tz = cross(
        first * (x - before[0]), first * (y - before[1]), first * (z - before[2]), lever[0], lever[1], lever[2]
    )
    wx, wy, wz = cross(x, y, z, lever[0], lever[1], lever[2])
    cx, cy, cz = cross(x, y, z, wx, wy, wz)
    return (tx + cx) / dt, (ty + cy) / dt, (tz + cz) / dt


@jit
def _add_difference(own, units, sensor, k, c, value):
    """Add an increment along axis c of triad k to the differences that it is part of."""
    for p in range(units.pair_sensor.shape[0]):
        if units.pair_sensor[p] == sensor:
            for i in range(3):
                own.difference[p, i] = own.difference[p, i] + units.pair_solved[p, k, i, c] * value


@jit
def _fuse(increments, own, units, at, n_tick, dt):
    """Set the increments of the fused triad from those of the units, lever arms compensated."""
    n = units.n_axis.shape[0]
    for row in range(at, at + n_tick):
        for i in range(6):
            increments[row, i] = like(increments[row, i], 0.0)
        for k in range(n):
            for c in range(units.n_axis[k]):
                for i in range(3):
                    increments[row, i] = increments[row, i] + units.solved[0, k, 0, i, c] * own.sensed[k, row, c]
                _add_difference(own, units, 0, k, c, own.sensed[k, row, c])
        x, y, z = increments[row, 0], increments[row, 1], increments[row, 2]
        for k in range(n):
            sx, sy, sz = swung(own, units, k, x, y, z, dt)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                value = own.sensed[k, row, 3 + c] - (h[0] * sx + h[1] * sy + h[2] * sz)
                for i in range(3):
                    increments[row, 3 + i] = increments[row, 3 + i] + units.solved[0, k, 1, i, c] * value
                _add_difference(own, units, 1, k, c, value)
        own.before[0], own.before[1], own.before[2], own.before[3] = x, y, z, like(x, 1.0)


@jit
def _fuse_redundant(increments, own, units, vote, at, first_tick, n_tick, dt):
    """Do the same for units that are tested against each other, or of which the middle one is selected."""
    n, mine = units.n_axis.shape[0], own.redundant
    for row in range(at, at + n_tick):
        for k in range(n):
            for c in range(units.n_axis[k]):
                note(mine, 0, k, c, own.sensed[k, row, c])
        combine(increments, mine, units, vote, row, 0)
        x, y, z = increments[row, 0], increments[row, 1], increments[row, 2]
        for k in range(n):
            sx, sy, sz = swung(own, units, k, x, y, z, dt)
            for c in range(units.n_axis[k]):
                h = units.frames[k, c, 0]
                note(mine, 1, k, c, own.sensed[k, row, 3 + c] - (h[0] * sx + h[1] * sy + h[2] * sz))
        combine(increments, mine, units, vote, row, 1)
        own.before[0], own.before[1], own.before[2], own.before[3] = x, y, z, like(x, 1.0)
        check(mine, units, vote, first_tick + row - at)


@jit
def _fuse_ticks(increments, own, units, vote, at, first_tick, n_tick, dt):
    if vote is None:
        _fuse(increments, own, units, at, n_tick, dt)
    else:
        _fuse_redundant(increments, own, units, vote, at, first_tick, n_tick, dt)


@jit
def sense_units(work, own, units, at, first_tick, n_tick, dt, key):
    """Fill rows of the window's increments with those of the fused triad; what each unit puts out stays in
    `own.sensed`.
    """
    for k in range(units.n_axis.shape[0]):
        _sense_triad(own, units, k, at, (first_tick, n_tick), dt, key, work.run[0])
    _fuse_ticks(work.increments, own, units, units.redundant, at, first_tick, n_tick, dt)
