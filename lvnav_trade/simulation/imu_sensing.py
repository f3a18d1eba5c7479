"""Increments that the IMU outputs in a run: error tables of the true parameters, profiles, gravity disturbance."""

import numpy as np

from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.simulation.imu_array import fuse_tables, gather_units, sense_units


@jit
def gather_tables(work, imus, unit, units):
    """Set the error tables from true parameters; in an IMU array of each IMU and of the combined triad.

    Parameters
    ----------
    work : Work, of which `true_tables` is set
    imus : ImuArrayWork of an IMU array, updated in place; None for one IMU
    unit : ImuTruth
    units : ImuArray; None for one IMU
    """
    if units is None:
        processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
    else:
        gather_units(imus, units, work.true_par, unit.sensors, unit.drivers)
        fuse_tables(work.true_tables, imus, units, 0)


@jit
def _add_scale_factor(table, units, code, axis, value):
    """Add a scale-factor error of an axis to the table of a sensor; in an IMU array by the direction of the axis.

    Parameters
    ----------
    table : (N_TABLE,) error table, updated in place
    units : ImuArray; None for one IMU
    code : number of the sensor: GYRO or ACCEL, in an array 2 triad + sensor
    axis : 0 to 2
    value : scale-factor error
    """
    if units is None:
        entry = processes.OWN + 4 * axis
        table[entry] = table[entry] + value
    else:
        direction = units.frames[code // 2, axis, 0]
        for j in range(3):
            entry = processes.OWN + 3 * axis + j
            table[entry] = table[entry] + direction[j] * value


@jit
def _add_profiles(tables, unit, units, tick):
    """Add the deterministic profiles to the tables, for the process step that starts at a tick.

    Parameters
    ----------
    tables : error tables by sensor, updated in place
    unit : ImuTruth, with the profiles
    units : ImuArray; None for one IMU
    tick : first tick of the process step; the profiles are taken at the middle of the step
    """
    middle = unit.start + unit.dt * (tick + 0.5 * unit.process_ticks)
    for profile in range(unit.profile_sensor.shape[0]):
        code = unit.profile_sensor[profile]
        table = tables[code]
        for axis in range(3):
            value = processes.profile_value(unit, profile, axis, middle)
            if unit.profile_driver[profile] == CONSTANT:
                table[axis] = table[axis] + value
            else:
                _add_scale_factor(table, units, code, axis, value)


@jit
def _set_true_tables(work, imus, unit, units, tick):
    """Set the error tables from true parameters and profiles, for the process step that starts at a tick.

    Parameters
    ----------
    work : Work, of which `true_tables` is set
    imus : ImuArrayWork of an IMU array, updated in place; None for one IMU
    unit : ImuTruth
    units : ImuArray; None for one IMU
    tick : first tick of the process step
    """
    if units is None:
        processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
        _add_profiles(work.true_tables, unit, units, tick)
    else:
        gather_units(imus, units, work.true_par, unit.sensors, unit.drivers)
        _add_profiles(imus.tables, unit, units, tick)
        fuse_tables(work.true_tables, imus, units, tick)


@jit
def _miss_gravity(work, value, seconds):
    """Add the error by a gravity disturbance over part of a window to the estimate.

    The disturbance adds value t to the velocity error and value t^2 / 2 to the position error.

    Parameters
    ----------
    work : Work, of which `nav` is updated in place
    value : (3,) m/s^2, gravity disturbance, frame i
    seconds : s, length of this part
    """
    for i in range(3):
        missed = seconds * value[i]
        work.nav[V + i] = work.nav[V + i] - missed
        # the strapdown integrates the missing velocity over the whole time, twice the position error; half is restored
        work.nav[R + i] = work.nav[R + i] + 0.5 * seconds * missed


@inlined
def _sense_ticks(work, imus, unit, units, at, tick, count, key):
    """Set the increments that the IMU outputs over some ticks of one process step.

    Parameters
    ----------
    work : Work, of which `increments` is updated in place
    imus : ImuArrayWork of an IMU array; None for one IMU
    unit : ImuTruth
    units : ImuArray; None for one IMU
    at : index of the first increment in the window
    tick, count : first tick, number of ticks
    key : (2,) key words of the seed
    """
    if units is None:
        k0, k1 = key
        processes.corrupt(
            work.increments,
            at,
            tick,
            count,
            unit.dtheta,
            unit.dvel,
            work.true_tables[0],
            work.true_tables[1],
            unit.white,
            work.remainder,
            unit,
            k0,
            k1,
            work.run[0],
        )
    else:
        sense_units(work, imus, units, at, tick, count, unit.dt, key)


@inlined
def sense(work, imus, unit, units, first, n_tick, key):
    """Set the increments that the IMU outputs in a window, and step the varying parameters.

    Parameters
    ----------
    work : Work, updated in place
    imus : ImuArrayWork of an IMU array; None for one IMU
    unit : ImuTruth
    units : ImuArray, whose combined triad is the output; None for one IMU
    first, n_tick : first tick, number of ticks
    key : (2,) key words of the seed
    """
    k0, k1 = key
    run = work.run[0]
    done = 0
    while done < n_tick:
        tick = first + done
        phase = tick % unit.process_ticks
        if tick == 0 or (unit.drifting and phase == 0):
            if tick > 0:
                number = np.uint64(tick // unit.process_ticks)
                processes.step(work.true_par, unit.decay, unit.walk, unit.sources, k0, k1, run, number)
            _set_true_tables(work, imus, unit, units, tick)
        count = min(n_tick - done, unit.process_ticks - phase)
        _sense_ticks(work, imus, unit, units, done, tick, count, key)
        if unit.gravity >= 0:
            _miss_gravity(work, work.true_par[unit.gravity], unit.dt * count)
        done += count
