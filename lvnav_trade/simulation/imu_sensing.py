"""Increments that the IMU outputs in a run: error tables of the true parameters, profiles, gravity disturbance."""

import numpy as np

from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.simulation.imu_array import combine_tables, gather_units, sense_units


@jit
def gather_tables(work, imu_array_work, imu_truth, imu_array):
    """Set the error tables from true parameters; in an IMU array of each IMU and of the combined triad.

    Parameters
    ----------
    work : Work, of which `true_tables` is set
    imu_array_work : ImuArrayWork of an IMU array, updated in place; None for one IMU
    imu_truth : ImuTruth
    imu_array : ImuArray; None for one IMU
    """
    if imu_array is None:
        processes.gather(work.true_tables, work.true_par, imu_truth.sensors, imu_truth.drivers)
    else:
        gather_units(imu_array_work, imu_array, work.true_par, imu_truth.sensors, imu_truth.drivers)
        combine_tables(work.true_tables, imu_array_work, imu_array, 0)


@jit
def _add_scale_factor(table, imu_array, code, axis, value):
    """Add a scale-factor error of an axis to the table of a sensor; in an IMU array by the direction of the axis.

    Parameters
    ----------
    table : (N_TABLE,) error table, updated in place
    imu_array : ImuArray; None for one IMU
    code : number of the sensor: GYRO or ACCEL, in an array 2 triad + sensor
    axis : 0 to 2
    value : scale-factor error
    """
    if imu_array is None:
        entry = processes.OWN + 4 * axis
        table[entry] = table[entry] + value
    else:
        direction = imu_array.frames[code // 2, axis, 0]
        for j in range(3):
            entry = processes.OWN + 3 * axis + j
            table[entry] = table[entry] + direction[j] * value


@jit
def _add_profiles(tables, imu_truth, imu_array, tick):
    """Add the deterministic profiles to the tables, for the process step that starts at a tick.

    Parameters
    ----------
    tables : error tables by sensor, updated in place
    imu_truth : ImuTruth, with the profiles
    imu_array : ImuArray; None for one IMU
    tick : first tick of the process step; the profiles are taken at the middle of the step
    """
    middle = imu_truth.start + imu_truth.dt * (tick + 0.5 * imu_truth.process_ticks)
    for profile in range(imu_truth.profile_sensor.shape[0]):
        code = imu_truth.profile_sensor[profile]
        table = tables[code]
        for axis in range(3):
            value = processes.profile_value(imu_truth, profile, axis, middle)
            if imu_truth.profile_driver[profile] == CONSTANT:
                table[axis] = table[axis] + value
            else:
                _add_scale_factor(table, imu_array, code, axis, value)


@jit
def _set_true_tables(work, imu_array_work, imu_truth, imu_array, tick):
    """Set the error tables from true parameters and profiles, for the process step that starts at a tick.

    Parameters
    ----------
    work : Work, of which `true_tables` is set
    imu_array_work : ImuArrayWork of an IMU array, updated in place; None for one IMU
    imu_truth : ImuTruth
    imu_array : ImuArray; None for one IMU
    tick : first tick of the process step
    """
    if imu_array is None:
        processes.gather(work.true_tables, work.true_par, imu_truth.sensors, imu_truth.drivers)
        _add_profiles(work.true_tables, imu_truth, imu_array, tick)
    else:
        gather_units(imu_array_work, imu_array, work.true_par, imu_truth.sensors, imu_truth.drivers)
        _add_profiles(imu_array_work.tables, imu_truth, imu_array, tick)
        combine_tables(work.true_tables, imu_array_work, imu_array, tick)


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
        velocity_change = seconds * value[i]
        work.nav[V + i] = work.nav[V + i] - velocity_change
        # the strapdown integrates the missing velocity over the whole time, twice the position error; half is restored
        work.nav[R + i] = work.nav[R + i] + 0.5 * seconds * velocity_change


@inline_jit
def _sense_ticks(work, imu_array_work, imu_truth, imu_array, first_row, tick, count, key):
    """Set the increments that the IMU outputs over some ticks of one process step.

    Parameters
    ----------
    work : Work, of which `increments` is updated in place
    imu_array_work : ImuArrayWork of an IMU array; None for one IMU
    imu_truth : ImuTruth
    imu_array : ImuArray; None for one IMU
    first_row : index of the first increment in the window
    tick, count : first tick, number of ticks
    key : (2,) key words of the seed
    """
    if imu_array is None:
        k0, k1 = key
        processes.corrupt(
            work.increments,
            first_row,
            tick,
            count,
            imu_truth.dtheta,
            imu_truth.dvel,
            work.true_tables[0],
            work.true_tables[1],
            imu_truth.white,
            work.remainder,
            imu_truth,
            k0,
            k1,
            work.run[0],
        )
    else:
        sense_units(work, imu_array_work, imu_array, first_row, tick, count, imu_truth.dt, key)


@inline_jit
def sense(work, imu_array_work, imu_truth, imu_array, first, n_tick, key):
    """Set the increments that the IMU outputs in a window, and step the varying parameters.

    Parameters
    ----------
    work : Work, updated in place
    imu_array_work : ImuArrayWork of an IMU array; None for one IMU
    imu_truth : ImuTruth
    imu_array : ImuArray, whose combined triad is the output; None for one IMU
    first, n_tick : first tick, number of ticks
    key : (2,) key words of the seed
    """
    k0, k1 = key
    run = work.run[0]
    sensed_count = 0
    while sensed_count < n_tick:
        tick = first + sensed_count
        phase = tick % imu_truth.process_ticks
        if tick == 0 or (imu_truth.is_drifting and phase == 0):
            if tick > 0:
                number = np.uint64(tick // imu_truth.process_ticks)
                processes.step(work.true_par, imu_truth.decay, imu_truth.walk, imu_truth.sources, k0, k1, run, number)
            _set_true_tables(work, imu_array_work, imu_truth, imu_array, tick)
        count = min(n_tick - sensed_count, imu_truth.process_ticks - phase)
        _sense_ticks(work, imu_array_work, imu_truth, imu_array, sensed_count, tick, count, key)
        if imu_truth.gravity >= 0:
            _miss_gravity(work, work.true_par[imu_truth.gravity], imu_truth.dt * count)
        sensed_count += count
