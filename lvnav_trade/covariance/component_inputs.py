"""Sensitivity of attitude, velocity and position to the error components over a window of the nominal flight."""

import numpy as np

from lvnav_trade.covariance.components import GRAVITY
from lvnav_trade.covariance.imu_array_errors import REMAINDER, WHITE, unit_input_matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.transition import (
    ATT,
    ATT_GYRO,
    CONSTANT,
    GYRO,
    POS,
    VEL,
    VEL_ACCEL,
    VEL_GYRO,
    parameter_block,
)

N_NAV = 9


@jit
def input_matrix(b, block, j, components, sums, seconds):
    """Set the sensitivity of attitude, velocity and position to the components of a block over a window.

    Parameters
    ----------
    b : (9, 3) set here, SI per unit of each component
    block : (9,) scratch
    j : block
    components : Components
    sums : (18,) integrals of the strapdown over the window
    seconds : s, length of the window
    """
    for i in range(N_NAV):
        for axis in range(3):
            b[i, axis] = 0.0
    sensor = components.sensor[j]
    driver_code = components.driver[j]
    first_state = ATT if sensor == GYRO else VEL
    if driver_code == GRAVITY:
        for axis in range(3):
            b[VEL + axis, axis] = seconds
            b[POS + axis, axis] = 0.5 * seconds * seconds
    elif driver_code == REMAINDER:
        if seconds > 0.0:
            for axis in range(3):
                for i in range(3):
                    b[first_state + i, axis] = sums[3 * i + axis] / seconds
    elif seconds > 0.0:
        first, last = (ATT_GYRO, VEL_GYRO) if sensor == GYRO else (VEL_ACCEL, VEL_ACCEL)
        size = 1.0
        if driver_code == WHITE:  # PSD: acts like a bias of variance PSD / seconds over the window
            size = 1.0 / np.sqrt(seconds)
            driver_code = CONSTANT
        for block_kind in range(first, last + 1):
            parameter_block(block, block_kind, driver_code, sums, seconds)
            for i in range(3):
                for axis in range(3):
                    b[first_state + i, axis] = size * block[3 * i + axis]
            first_state = VEL
        for axis in range(3):
            for i in range(3):
                b[POS + i, axis] = 0.5 * seconds * b[VEL + i, axis]


@jit
def block_input(scratch, j, components, units, sums, seconds, first, n_tick):
    """Set `scratch.input` to the sensitivity to block j over a window, for one IMU or an array (ImuArray)."""
    if units is None or components.driver[j] == GRAVITY:
        input_matrix(scratch.input, scratch.block, j, components, sums, seconds)
    else:
        unit_input_matrix(scratch, j, components, units, sums, seconds, first, n_tick)


@jit
def fill_inputs(scratch, components, units, sums, seconds, first, n_tick):
    """Set `scratch.b`, the sensitivity of attitude, velocity and position to each component over a window."""
    for j in range(components.sensor.shape[0]):
        if components.profile[j] < 0 and components.block_drives_motion[j]:
            block_input(scratch, j, components, units, sums, seconds, first, n_tick)
            component = components.first[j]
            source = components.source[component]
            k = components.slot[component]
            g = components.group[source]
            lane = components.lane[source]
            for axis in range(3):
                for i in range(N_NAV):
                    scratch.b[g, k + axis, i, lane] = scratch.input[i, axis]
