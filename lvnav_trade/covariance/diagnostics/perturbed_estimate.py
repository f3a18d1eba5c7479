"""An estimate with a known error: navigation state, compensated increments, and the arrays of the filter.

The error is truth minus estimate, states in storage order, frame i.
"""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.workspace import Nominal, new_nominal_previous_epoch
from lvnav_trade.filter.ekf import place_antenna
from lvnav_trade.filter.policies.epoch_differences import PreviousEpoch, store_estimate
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.transition import ACCEL, ATT, GYRO, POS, VEL
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_driver = getattr(transition.driver, "py_func", transition.driver)  # the formula itself, for arrays of ticks


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


class Inputs(NamedTuple):
    """True increments of some ticks, and drivers of IMU parameters.

    true : (n_tick, 6) rad, m/s. True increments, body axes.
    sensors : For gyro and accelerometer: columns of the increments, states (n, 3) of its parameters by kind and axis,
        drivers (n, n_tick, 3).
    dt : s. Tick.
    """

    true: Floats
    sensors: tuple[tuple[slice, Any, Floats], ...]
    dt: float


def inputs(prepared_case: PreparedCase, first: int, n_tick: int) -> Inputs:
    """Return the inputs of some ticks; they do not depend on the error of the estimate.

    Parameters
    ----------
    prepared_case
        Prepared case.
    first, n_tick
        First tick, number of ticks.
    """
    ticks = slice(first, first + n_tick)
    dt = prepared_case.unit.dt
    reference = prepared_case.reference
    true = np.hstack([reference.dtheta[ticks], reference.dvel[ticks]])
    angles = slice(0, 3)
    velocities = slice(3, 6)
    sensors = []
    for sensor, columns, other_columns in ((GYRO, angles, velocities), (ACCEL, velocities, angles)):
        blocks = [block for block in prepared_case.layout.parameters if block.sensor == sensor]
        if not blocks:
            continue
        own_input = true[:, columns] / dt
        other_input = true[:, other_columns] / dt
        own_x, own_y, own_z = own_input.T
        other_x, other_y, other_z = other_input.T
        drivers = []
        for block in blocks:
            axes = _driver(block.driver, own_x, own_y, own_z, other_x, other_y, other_z)
            drivers.append(np.stack(axes, axis=1))
        offsets = np.array([block.offset for block in blocks])
        states = offsets[:, None] + np.arange(3)
        sensors.append((columns, states, np.stack(drivers)))
    return Inputs(true, tuple(sensors), dt)


def compensate_increments(inputs: Inputs, d: Floats) -> Floats:
    """Return increments (n_tick, 6) compensated with parameters in error by d: true increments plus residual errors."""
    true = inputs.true
    result = true.copy()
    for columns, states, drivers in inputs.sensors:
        parameters = d[states][:, None]
        errors = drivers * parameters * inputs.dt
        terms = np.concatenate([true[None, :, columns], errors])
        result[:, columns] = np.add.reduce(terms)  # in this order
    return result


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
    true_inputs = inputs(prepared_case, first, n_tick)
    return compensate_increments(true_inputs, d)


def tick_at(prepared_case: PreparedCase, time: float) -> int:
    """Return the tick nearest to a time (s)."""
    distance = np.abs(prepared_case.reference.t - time)
    return int(np.argmin(distance))


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
