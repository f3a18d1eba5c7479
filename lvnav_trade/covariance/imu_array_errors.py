"""Errors of an IMU array in the joint covariance: effect of each IMU through the least squares of the array.

A filter state such as a gyro bias models a sum of errors of all IMUs, so no component belongs to one state. In the
joint vector the error of such a state is minus its estimate; the sum of the components is added to the results.
"""

from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.attitude import cross
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import SUM_C, SUM_V
from lvnav_trade.kernels.transition import ATT, CONSTANT, GYRO, OTHER_0, OTHER_2, OWN_0, OWN_2, POS, SQUARE, VEL
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.simulation.epoch.joint_ticks import lasting_share, tick_input, unit_input
from lvnav_trade.simulation.exclusion_covariance import grow
from lvnav_trade.simulation.preparation.imu_arrays import axis_increments, inputs_of
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray
from lvnav_trade.simulation.preparation.prepare import PreparedCase

# Drivers that no increment multiplies: the quantisation remainder, and white noise, new in every window.
REMAINDER, WHITE = -1, -3


@jit
def _means(mean, units, triad, sensor, first, n_tick, seconds):
    """Set the mean inputs of a triad over a window, (2, 3) body axes: of the sensor itself, of the other sensor."""
    for i in range(3):
        angle = 0.0
        velocity = 0.0
        for tick in range(first, first + n_tick):
            angle += units.dtheta[triad, tick, i]
            velocity += units.dvel[triad, tick, i]
        mean[sensor, i] = angle / seconds
        mean[1 - sensor, i] = velocity / seconds


@jit
def unit_input_matrix(scratch, j, components, units, sums, seconds, first, n_tick):
    """Set `scratch.input` (9, 3), the sensitivity of attitude, velocity and position to block j of an IMU array.

    The parameters are those of `component_inputs.input_matrix`; first, n_tick : ticks of the window.
    """
    b = scratch.input
    mean = scratch.mean_input
    for i in range(9):
        for axis in range(3):
            b[i, axis] = 0.0
    if seconds <= 0.0:
        return
    sensor = components.sensor[j]
    driver = components.driver[j]
    triad = components.triad[j]
    _means(mean, units, triad, sensor, first, n_tick, seconds)
    stage = units.stage[first]
    kx, ky, kz = 1.0, 1.0, 1.0  # factors by which the selection of IMUs changes random errors; 1 for profiles
    if components.profile[j] < 0:
        noise_factors = units.error_factors[stage, sensor, 1 if driver == WHITE else 0]
        kx = noise_factors[0]
        ky = noise_factors[1]
        kz = noise_factors[2]
    size = 1.0
    if driver == WHITE:  # PSD: acts like a bias of variance PSD / seconds over the window
        size = 1.0 / np.sqrt(seconds)
    elif driver == REMAINDER:
        size = -1.0 / seconds
    first_state = ATT if sensor == GYRO else VEL
    solution_weights = units.axis_weights[stage, triad, sensor]
    gained_x = sums[SUM_V]
    gained_y = sums[SUM_V + 1]
    gained_z = sums[SUM_V + 2]
    for c in range(3):
        # error of the combined triad per unit of the component, body axes
        u = size * unit_input(units.frames[triad], c, driver, mean[0], mean[1])
        x = kx * u * solution_weights[0, c]
        y = ky * u * solution_weights[1, c]
        z = kz * u * solution_weights[2, c]
        for i in range(3):
            row = SUM_C + 3 * i
            b[first_state + i, c] = -(sums[row] * x + sums[row + 1] * y + sums[row + 2] * z)
        if driver == REMAINDER:
            continue
        if sensor == GYRO:
            # the attitude error grows linearly over the window, as in `transition.parameter_block`
            tilt_x = -b[ATT, c]
            tilt_y = -b[ATT + 1, c]
            tilt_z = -b[ATT + 2, c]
            vx, vy, vz = cross(gained_x, gained_y, gained_z, tilt_x, tilt_y, tilt_z)
            b[VEL, c] = 0.5 * vx
            b[VEL + 1, c] = 0.5 * vy
            b[VEL + 2, c] = 0.5 * vz
        for i in range(3):
            b[POS + i, c] = 0.5 * seconds * b[VEL + i, c]


@jit
def inflate_nominal(formal, units, model, first, n_tick, seconds):
    """Inflate the formal covariance over a window for IMUs that are excluded on the nominal flight, as in a run.

    Parameters
    ----------
    formal : (n, n) covariance of the filter, updated in place
    units : ImuArray, or None
    model : FilterModel
    first, n_tick : first tick, number of ticks
    seconds : s, length of the window
    """
    if units is not None:
        _inflate_exclusions(formal, units, units.redundant, model, first, n_tick, seconds)


@jit
def _inflate_exclusions(formal, units, redundant, model, first, n_tick, seconds):
    if redundant is not None:
        n_lost_before, n_lost_after = 0, 0  # exclusions up to the start and up to the end of the window
        for tick in redundant.exclusion_ticks:
            if tick <= first:
                n_lost_before += 1
            if tick <= first + n_tick:
                n_lost_after += 1
        if n_lost_after > 0:
            mean_after = redundant.mean[n_lost_after]
            mean_before = redundant.mean[n_lost_before]
            grow(formal, mean_after, mean_before, 1.0, units.n_axis, redundant, model, seconds)


@jit
def write_array_samples(results, hist, state, components, units, samples, tick, dt):
    """Write the error variance of the combined samples without their noise by source: raw, and corrected by the bias.

    Parameters
    ----------
    results : PassResults, updated in place
    hist : history time
    state, components : JointCovariance, Components
    units : ImuArray
    samples : ReportedSamples
    tick, dt : last tick; s, of a tick
    """
    for j in range(components.sensor.shape[0]):
        driver = components.driver[j]
        if components.profile[j] >= 0 or driver < 0:
            continue
        sensor = components.sensor[j]
        triad = components.triad[j]
        for c in range(3):
            component = components.first[j] + c
            source = components.source[component]
            k = components.slot[component]
            g = components.group[source]
            lane = components.lane[source]
            u = tick_input(units, triad, sensor, c, driver, tick, dt)
            variance = state.variance[g, k, 0, lane]
            for i in range(3):
                r = 3 * sensor + i
                bias = samples.bias[r]
                partial = lasting_share(units, tick, triad, sensor, i, c) * u
                variance_increase = partial * partial * variance
                results.samples[hist, source, r] += variance_increase
                results.samples[hist, source, 6 + r] += variance_increase
                if bias >= 0:
                    covariance = state.cross[g, k, bias, lane]
                    results.samples[hist, source, 6 + r] += 2.0 * partial * covariance


@jit
def _add_component(results, hist, state, components, weights, component):
    """Add a component to the covariances of the states that model it.

    P <- P + w y' + y w' + variance w w', with the covariance y of states and component.

    Parameters
    ----------
    results : PassResults, updated in place
    hist : history time
    state, components : JointCovariance, Components
    weights : (n_state,) weights w of the component in the states
    component : index of the component
    """
    source = components.source[component]
    k = components.slot[component]
    g = components.group[source]
    lane = components.lane[source]
    variance = state.variance[g, k, 0, lane]
    n = weights.shape[0]
    for i in range(n):
        weight = weights[i]
        if weight != 0.0:
            covariance = state.cross[g, k, i, lane]
            results.budget[hist, source, i] += weight * (2.0 * covariance + weight * variance)
            for j in range(n):
                covariance_term = weight * state.cross[g, k, j, lane]
                product = weight * weights[j] * variance
                results.true[hist, i, j] += covariance_term
                results.true[hist, j, i] += covariance_term
                results.true[hist, i, j] += product


@jit
def add_sums(results, hist, state, components, units, tick):
    """Add the sums of components that filter states model to the results at a history time.

    Parameters
    ----------
    results : PassResults, updated in place
    hist : history time
    state, components : JointCovariance, Components
    units : ImuArray, or None
    tick : last tick, which determines the combination of the IMUs
    """
    if units is not None:
        stage = units.stage[tick]
        for j in range(components.sensor.shape[0]):
            profile = components.profile[j]
            for c in range(3):
                weights = components.state_weight[stage, j, c]
                if profile >= 0:
                    for i in range(weights.shape[0]):
                        results.mean[hist, i] += weights[i] * state.profile[profile, c]
                else:
                    component = components.first[j] + c
                    _add_component(results, hist, state, components, weights, component)


def state_weights(layout: StateLayout, units: ImuArray, sensor: Ints, driver: Ints, triad: Ints) -> Floats:
    """Return the weight of each component in each filter state that models it, (n_stage, n_block, 3, n_state).

    The error of a sensing axis enters the combined triad by its column of the least-squares solution, and multiplies
    the input projected on its frame.

    Parameters
    ----------
    layout
        States of the filter.
    units
        IMU array.
    sensor, driver, triad
        (n_block,). Sensor, driver and triad of each block of components.
    """
    weights = np.zeros((len(units.axis_weights), sensor.size, 3, layout.n_state))
    for stage, j in np.ndindex(weights.shape[:2]):
        if driver[j] < CONSTANT or driver[j] == SQUARE:
            continue
        block_weights = weights[stage, j]
        frames = units.frames[triad[j]]
        solution_weights = units.axis_weights[stage, triad[j], sensor[j]]
        for block in layout.parameters:
            if block.sensor != sensor[j]:
                continue
            states = slice(block.offset, block.offset + 3)
            for c in range(3):
                share = _modelled_share(frames[c], c, int(driver[j]), block.driver)
                block_weights[c, states] += solution_weights[:, c] * share
        if driver[j] != CONSTANT:
            continue
        for pair, state in enumerate(units.pair_state.tolist()):
            if state >= 0 and units.pair_sensor[pair] == sensor[j]:
                pair_weights = units.pair_weights[pair, triad[j]].T
                block_weights[:, state : state + 3] += pair_weights
    return weights


def _modelled_share(frame: Floats, c: int, driver: int, block_driver: int) -> Floats:
    """Return the share (3,) of a parameter of a sensing axis that each axis of a block of states models.

    Parameters
    ----------
    frame
        (3, 3). Direction and misalignment directions of the sensing axis, body axes.
    c
        Sensing axis.
    driver, block_driver
        Driver of the parameter, and of the block.
    """
    own_inputs = range(OWN_0, OWN_2 + 1)
    other_inputs = range(OTHER_0, OTHER_2 + 1)
    if driver == CONSTANT or block_driver == CONSTANT:
        return np.full(3, float(driver == block_driver))
    if driver in own_inputs and block_driver in own_inputs:
        direction = frame[driver - OWN_0]
        shift = block_driver - OWN_0
        return np.array([direction[(i + shift) % 3] for i in range(3)])
    if driver in other_inputs and block_driver in other_inputs:
        direction = frame[(driver - OTHER_0 - c) % 3]
        return np.full(3, direction[block_driver - OTHER_0])
    return np.zeros(3)


class Differences(NamedTuple):
    """Differences of two IMUs as measurements.

    row_index : (n_channel,). Row of the channel in `jacobian`, -1 none.
    jacobian : (n_row, n_epoch, n_component). Derivative of the measurement with respect to each IMU error component.
    pair_index : (n_device,). Pair of IMUs that a sensor measures, -1 none.
    nominal : (n_pair, n_epoch, 3). Difference on the nominal flight, the same in every run.
    """

    row_index: Ints
    jacobian: Floats
    pair_index: Ints
    nominal: Floats


def no_differences(n_channel: int, n_device: int) -> Differences:
    """Return the empty record of a case without measured differences."""
    return Differences(
        row_index=np.full(n_channel, -1, dtype=np.int64),
        jacobian=np.zeros((0, 0, 0)),
        pair_index=np.full(max(1, n_device), -1, dtype=np.int64),
        nominal=np.zeros((0, 0, 3)),
    )


def differences(
    prepared_case: PreparedCase, sensor: Ints, driver: Ints, triad: Ints, profile: Ints, first: Ints, n_component: int
) -> Differences:
    """Return the measured differences of two IMUs of a case.

    A difference is the sum of increments since the previous measurement. Its derivative is thus the sum of the driver
    of each component, which is approximated as constant over that time.

    Parameters
    ----------
    prepared_case
        Prepared case.
    sensor, driver, triad, profile, first
        (n_block,). As in `Components`.
    n_component
        Number of IMU error components.
    """
    units = prepared_case.options.imu_array
    channels = prepared_case.channels
    dt = prepared_case.unit.dt
    empty = no_differences(channels.n_channel, len(prepared_case.devices))
    if units is None or not units.pair_sensor.size:
        return empty
    n_epoch = prepared_case.t_epoch.size
    n_pair = units.pair_sensor.size
    increments = axis_increments(units, dt)
    jacobian = np.zeros((3 * n_pair, n_epoch, n_component))
    nominal = np.zeros((n_pair, n_epoch, 3))
    for channel, device, pair in zip(
        channels.first_channels, prepared_case.devices, units.pair_of.tolist(), strict=True
    ):
        if pair < 0:
            continue
        rows = slice(3 * pair, 3 * pair + 3)
        empty.row_index[channel : channel + 3] = range(rows.start, rows.stop)
        pair_sensor = int(units.pair_sensor[pair])
        solution_weights = units.pair_weights[pair]
        # ticks between which the increments of an epoch are summed
        spans = np.stack([prepared_case.t_epoch - device.time_since_measurement, prepared_case.t_epoch])
        ticks = np.rint((spans - prepared_case.unit.start) / dt)
        difference = np.einsum("tic,tnc->ni", solution_weights, increments[pair_sensor])
        nominal[pair] = _epoch_sums(difference, ticks)
        is_measured = (sensor == pair_sensor) & (driver >= CONSTANT)
        for j in np.flatnonzero(is_measured).tolist():
            triad_weights = solution_weights[triad[j]]
            inputs = inputs_of(units, dt, int(driver[j]), int(triad[j]), pair_sensor)
            if profile[j] >= 0:
                errors = _profile_errors(prepared_case, int(profile[j])) * (inputs / dt)
                nominal[pair] += _epoch_sums(errors, ticks) @ triad_weights.T
            else:
                first_component = int(first[j])
                axes = slice(first_component, first_component + 3)
                sums = _epoch_sums(inputs, ticks)
                jacobian[rows, :, axes] = np.einsum("ic,ec->iec", triad_weights, sums)
    return Differences(row_index=empty.row_index, jacobian=jacobian, pair_index=units.pair_of, nominal=nominal)


def _epoch_sums(increments: Floats, ticks: Floats) -> Floats:
    """Return sums (n_epoch, k) of increments (n_tick, k) between two ticks (2, n_epoch) for each epoch."""
    start = np.zeros((1, increments.shape[1]))
    total = np.vstack([start, np.cumsum(increments, axis=0)])
    first, last = ticks.astype(np.int64)
    return np.asarray(total[last] - total[first])


def _profile_errors(prepared_case: PreparedCase, profile: int) -> Floats:
    """Return the error of a deterministic profile times the tick, (n_tick, 3)."""
    unit = prepared_case.unit
    n_tick = unit.dtheta.shape[0]
    middle = unit.start + unit.dt * (np.arange(n_tick) + 0.5)
    first = unit.profile_start[profile]
    last = unit.profile_end[profile]
    share = np.clip((middle - first) / (last - first), 0.0, 1.0)
    return np.asarray(unit.dt * share[:, None] * unit.profile[profile])
