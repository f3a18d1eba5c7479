"""An estimate with a known error: navigation state, compensated increments, and the arrays of the filter.

The error is truth minus estimate, states in storage order, frame i.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.workspace import Nominal, new_nominal_previous_epoch
from lvnav_trade.filter.ekf import place_antenna
from lvnav_trade.filter.policies.epoch_differences import PreviousEpoch, store_estimate
from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL, driver
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.simulation.preparation.prepare import PreparedCase


def navigation(q: Floats, v: Floats, r: Floats, d: Floats) -> Floats:
    """Return the estimated navigation state (10,) with a given error, frame i.

    Parameters
    ----------
    q, v, r
        (4,), (3,) m/s, (3,) m. True attitude (body to i), velocity and position, frame i.
    d
        (n_state,) SI. Error, truth minus estimate.
    """
    inverse_tilt = from_rotation(-d[ATT], -d[ATT + 1], -d[ATT + 2])
    attitude = multiply(*inverse_tilt, *q)
    velocity = v - d[VEL : VEL + 3]
    position = r - d[POS : POS + 3]
    return np.concatenate([attitude, velocity, position])


def navigation_at(prepared_case: PreparedCase, tick: int, d: Floats) -> Floats:
    """Return the estimated navigation state (10,) with a given error at a tick, frame i.

    Parameters
    ----------
    prepared_case
        Prepared case.
    tick
        Index of the tick.
    d
        (n_state,) SI. Error, truth minus estimate.
    """
    reference = prepared_case.reference
    q = reference.q_b_i[tick]
    v = reference.v_i[tick]
    r = reference.r_i[tick]
    return navigation(q, v, r, d)


class ImuInputs(NamedTuple):
    """True increments of the flight, and the IMU parameters that the filter models.

    dtheta : (n_tick, 3) rad. True angle increments, body axes.
    dvel : (n_tick, 3) m/s. True velocity increments, body axes.
    sensor : (n_block,). Sensor of each block of three parameters: GYRO or ACCEL.
    driver : (n_block,). Quantity that the parameters of the block multiply.
    offset : (n_block,). First state of the block.
    dt : s. Tick.
    """

    dtheta: Floats
    dvel: Floats
    sensor: Ints
    driver: Ints
    offset: Ints
    dt: float


def imu_inputs(prepared_case: PreparedCase) -> ImuInputs:
    """Return the true increments of a case and the IMU parameters of its filter."""
    reference = prepared_case.reference
    model = prepared_case.model
    dt = prepared_case.unit.dt
    return ImuInputs(reference.dtheta, reference.dvel, model.par_sensor, model.par_driver, model.par_offset, dt)


@jit
def compensate(increments, inputs, d, first, n_tick):
    """Set increments compensated with parameters in error by d: true increments plus residual errors.

    Parameters
    ----------
    increments : (n, 6) rad, m/s, body axes; the first `n_tick` are set
    inputs : ImuInputs
    d : (n_state,) SI, error, truth minus estimate
    first, n_tick : first tick, number of ticks
    """
    dt = inputs.dt
    for k in range(n_tick):
        angles = inputs.dtheta[first + k]
        velocities = inputs.dvel[first + k]
        wx = angles[0] / dt
        wy = angles[1] / dt
        wz = angles[2] / dt
        fx = velocities[0] / dt
        fy = velocities[1] / dt
        fz = velocities[2] / dt
        for i in range(3):
            increments[k, i] = angles[i]
            increments[k, 3 + i] = velocities[i]
        for b in range(inputs.offset.shape[0]):
            state = inputs.offset[b]
            if inputs.sensor[b] == GYRO:
                axis = 0
                ux, uy, uz = driver(inputs.driver[b], wx, wy, wz, fx, fy, fz)
            else:
                axis = 3
                ux, uy, uz = driver(inputs.driver[b], fx, fy, fz, wx, wy, wz)
            increments[k, axis] += ux * d[state] * dt
            increments[k, axis + 1] += uy * d[state + 1] * dt
            increments[k, axis + 2] += uz * d[state + 2] * dt


def increments(prepared_case: PreparedCase, first: int, n_tick: int, d: Floats) -> Floats:
    """Return increments (n_tick, 6) rad and m/s, body axes, compensated with parameters in error.

    Parameters
    ----------
    prepared_case
        Prepared case.
    first, n_tick
        First tick, number of ticks.
    d
        (n_state,) SI. Error, truth minus estimate.
    """
    result = np.empty((n_tick, 6))
    compensate(result, imu_inputs(prepared_case), d, first, n_tick)
    return result


def tick_at(prepared_case: PreparedCase, time: float) -> int:
    """Return the tick nearest to a time (s)."""
    t = prepared_case.reference.t
    next_tick = int(np.searchsorted(t, time))
    if next_tick == 0:
        return 0
    last_tick = next_tick - 1
    if next_tick == t.size or time - t[last_tick] <= t[next_tick] - time:
        return last_tick
    return next_tick


def place(prepared_case: PreparedCase, work: Nominal, epoch: int, d: Floats, time: float | None = None) -> None:
    """Set the estimate in `work` to the truth minus an error.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work
        Arrays of the nominal run; navigation state, increments, clock, extra states and antennas are set.
    epoch
        Epoch, whose antennas are placed.
    d
        (n_state,) SI. Error, truth minus estimate.
    time
        s since lift-off. Time of the truth; None: that of the epoch.
    """
    model = prepared_case.model
    dt = prepared_case.unit.dt
    time_of_truth = prepared_case.t_epoch[epoch] if time is None else time
    tick = tick_at(prepared_case, time_of_truth)
    previous_tick = max(0, tick - 1)
    previous_increments = increments(prepared_case, previous_tick, 1, d)[0]
    work.nav[:] = navigation_at(prepared_case, tick, d)
    work.previous[:] = previous_increments
    work.clock_hat[:] = 0.0
    if model.clock >= 0:
        clock_states = slice(model.clock, model.clock + 2)
        work.clock_hat[:] = -d[clock_states]
    for extra, offset in enumerate(model.extra_offset):
        work.extra[extra] = -d[offset]
    place_antenna(work, None, None, model, dt, epoch)


def place_previous_epoch(prepared_case: PreparedCase, work: Nominal, epoch: int, d: Floats) -> PreviousEpoch | None:
    """Return the stored estimate of the previous epoch, with the error of the clones.

    The navigation state of `work` is changed.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work
        Arrays of the nominal run.
    epoch
        Index of the epoch.
    d
        (n_state,) SI. Error, of which the clones are used.

    Returns
    -------
    PreviousEpoch or None
        None without differences of two epochs.
    """
    model = prepared_case.model
    differences = prepared_case.options.differences
    previous_epoch = new_nominal_previous_epoch(prepared_case)
    if differences is None or previous_epoch is None:
        return None
    clones = differences.clone + np.arange(differences.cloned_states.size)
    error = np.zeros_like(d)
    error[differences.cloned_states] = d[clones]
    place(prepared_case, work, max(0, epoch - 1), error)
    store_estimate(work, previous_epoch, None, None, differences, model, epoch)
    return previous_epoch
