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
from lvnav_trade.simulation.preparation.imu_arrays import along_axes, inputs_of
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray
from lvnav_trade.simulation.preparation.prepare import Prepared

# Drivers that no increment multiplies: the quantisation remainder, and white noise, new in every window.
REMAINDER, WHITE = -1, -3


@jit
def _means(mean, units, triad, sensor, first, n_tick, seconds):
    """Set the mean inputs of a triad over a window, (2, 3) body axes: of the sensor itself, of the other sensor."""
    for i in range(3):
        angle, speed = 0.0, 0.0
        for tick in range(first, first + n_tick):
            angle += units.dtheta[triad, tick, i]
            speed += units.dvel[triad, tick, i]
        mean[sensor, i], mean[1 - sensor, i] = angle / seconds, speed / seconds


@jit
def unit_input_matrix(scratch, j, true, units, sums, seconds, first, n_tick):
    """Set `scratch.input` (9, 3), the sensitivity of attitude, velocity and position to block j of an IMU array.

    The parameters are those of `propagate.input_matrix`; first, n_tick : ticks of the window.
    """
    b, mean = scratch.input, scratch.mean_input
    for i in range(9):
        for axis in range(3):
            b[i, axis] = 0.0
    if seconds <= 0.0:
        return
    sensor, driver, triad = true.sensor[j], true.driver[j], true.triad[j]
    _means(mean, units, triad, sensor, first, n_tick, seconds)
    size, stage = 1.0, units.stage[first]
    kx, ky, kz = 1.0, 1.0, 1.0  # factors by which the selection of IMUs changes random errors; 1 for profiles
    if true.profile[j] < 0:
        noisy = units.noisy[stage, sensor, 1 if driver == WHITE else 0]
        kx, ky, kz = noisy[0], noisy[1], noisy[2]
    if driver == WHITE:  # PSD: acts like a bias of variance PSD / seconds over the window
        size = 1.0 / np.sqrt(seconds)
    elif driver == REMAINDER:
        size = -1.0 / seconds
    for c in range(3):
        u = size * unit_input(units.frames[triad], c, driver, mean[0], mean[1])
        solved = units.solved[stage, triad, sensor]
        x, y, z = kx * u * solved[0, c], ky * u * solved[1, c], kz * u * solved[2, c]
        for i in range(3):
            at = SUM_C + 3 * i
            b[(ATT if sensor == GYRO else VEL) + i, c] = -(sums[at] * x + sums[at + 1] * y + sums[at + 2] * z)
        if driver == REMAINDER:
            continue
        if sensor == GYRO:
            vx, vy, vz = cross(
                sums[SUM_V], sums[SUM_V + 1], sums[SUM_V + 2], -b[ATT, c], -b[ATT + 1, c], -b[ATT + 2, c]
            )
            b[VEL, c], b[VEL + 1, c], b[VEL + 2, c] = 0.5 * vx, 0.5 * vy, 0.5 * vz
        for i in range(3):
            b[POS + i, c] = 0.5 * seconds * b[VEL + i, c]


@jit
def inform_nominal(formal, units, model, first, n_tick, seconds):
    """Inflate the formal covariance for IMUs that are excluded on the nominal flight, as in a run, over a window.

    formal : (n, n) covariance of the filter, updated in place; units : ImuArray, or None; first, n_tick, seconds :
        window
    """
    if units is not None:
        _inform(formal, units, units.redundant, model, first, n_tick, seconds)


@jit
def _inform(formal, units, vote, model, first, n_tick, seconds):
    if vote is not None:
        before, after = 0, 0
        for tick in vote.lost:
            before += 1 if tick <= first else 0
            after += 1 if tick <= first + n_tick else 0
        if after > 0:
            grow(formal, vote.mean[after], vote.mean[before], 1.0, units.n_axis, vote, model, seconds)


@jit
def samples_of_units(out, hist, state, true, units, samples, tick, dt):
    """Write the error variance of the combined samples without their noise by source: raw, and corrected by the
    estimated bias.
    """
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 or true.driver[j] < 0:
            continue
        sensor, triad = true.sensor[j], true.triad[j]
        for c in range(3):
            component = true.first[j] + c
            source, k = true.source[component], true.slot[component]
            g, lane = true.group[source], true.lane[source]
            u, variance = tick_input(units, triad, sensor, c, true.driver[j], tick, dt), state.variance[g, k, 0, lane]
            for i in range(3):
                entering, r = lasting_share(units, tick, triad, sensor, i, c) * u, 3 * sensor + i
                out.samples[hist, source, r] += entering * entering * variance
                out.samples[hist, source, 6 + r] += entering * entering * variance
                if samples.bias[r] >= 0:
                    out.samples[hist, source, 6 + r] += 2.0 * entering * state.cross[g, k, samples.bias[r], lane]


@jit
def _add_component(out, hist, state, true, weights, component):
    """Add a component to the covariances of the states that model it: weights (n_state,) of the component in them."""
    source, k = true.source[component], true.slot[component]
    g, lane = true.group[source], true.lane[source]
    variance, n = state.variance[g, k, 0, lane], weights.shape[0]
    for i in range(n):
        if weights[i] != 0.0:
            out.budget[hist, source, i] += weights[i] * (2.0 * state.cross[g, k, i, lane] + weights[i] * variance)
            for j in range(n):
                out.true[hist, i, j] += weights[i] * state.cross[g, k, j, lane]
                out.true[hist, j, i] += weights[i] * state.cross[g, k, j, lane]
                out.true[hist, i, j] += weights[i] * weights[j] * variance


@jit
def add_sums(out, hist, state, true, units, tick):
    """Add the sums of components that filter states model to the results at a history time (ImuArray, or None)."""
    if units is not None:
        for j in range(true.sensor.shape[0]):
            for c in range(3):
                weights = true.stands[units.stage[tick], j, c]
                if true.profile[j] >= 0:
                    for i in range(weights.shape[0]):
                        out.mean[hist, i] += weights[i] * state.profile[true.profile[j], c]
                else:
                    _add_component(out, hist, state, true, weights, true.first[j] + c)


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
    weights = np.zeros((len(units.solved), sensor.size, 3, layout.n_state))
    for stage, j in np.ndindex(weights.shape[:2]):
        if driver[j] < CONSTANT or driver[j] == SQUARE:
            continue
        frames, solved = units.frames[triad[j]], units.solved[stage, triad[j], sensor[j]]
        for c in range(3):
            for block in layout.parameters:
                if block.sensor != sensor[j]:
                    continue
                weights[stage, j, c, block.offset : block.offset + 3] += solved[:, c] * _share(
                    frames[c], c, int(driver[j]), block.driver
                )
        for p, at in enumerate(units.pair_state.tolist()):
            if at >= 0 and units.pair_sensor[p] == sensor[j] and driver[j] == CONSTANT:
                weights[stage, j, :, at : at + 3] += units.pair_solved[p, triad[j]].T
    return weights


def _share(frame: Floats, c: int, driver: int, wanted: int) -> Floats:
    """Return the part of a parameter of sensing axis c that each axis (3,) of a block of states models.

    frame : (3, 3) directions of the axis, body axes; driver, wanted : driver of the parameter, driver of the block
    """
    own, other = range(OWN_0, OWN_2 + 1), range(OTHER_0, OTHER_2 + 1)
    if driver == CONSTANT or wanted == CONSTANT:
        return np.full(3, float(driver == wanted))
    if driver in own and wanted in own:
        direction = frame[driver - OWN_0]
        return np.array([direction[(i + wanted - OWN_0) % 3] for i in range(3)])
    if driver in other and wanted in other:
        return np.full(3, frame[(driver - OTHER_0 - c) % 3][wanted - OTHER_0])
    return np.zeros(3)


class Differences(NamedTuple):
    """Differences of two IMUs as measurements.

    of : (n_channel,). Row of the channel in `reach`, -1 none.
    reach : (n_row, n_epoch, n_component). Derivative of the measurement with respect to each IMU error component.
    pair_of : (n_device,). Pair of IMUs that a sensor measures, -1 none.
    nominal : (n_pair, n_epoch, 3). Difference on the nominal flight, the same in every run.
    """

    of: Ints
    reach: Floats
    pair_of: Ints
    nominal: Floats


def no_differences(n_channel: int, n_device: int) -> Differences:
    """Return the empty record of a case without measured differences."""
    none = np.full(max(1, n_device), -1, dtype=np.int64)
    return Differences(np.full(n_channel, -1, dtype=np.int64), np.zeros((0, 0, 0)), none, np.zeros((0, 0, 3)))


def differences(
    prepared: Prepared, sensor: Ints, driver: Ints, triad: Ints, profile: Ints, first: Ints, n_component: int
) -> Differences:
    """Return the measured differences of two IMUs of a case.

    A difference is the sum of increments since the previous measurement. Its derivative is thus the sum of the driver
    of each component, which is approximated as constant over that time.

    Parameters
    ----------
    prepared
        Prepared case.
    sensor, driver, triad, profile, first
        (n_block,). As in `Components`.
    n_component
        Number of IMU error components.
    """
    units, channels, dt = prepared.options.units, prepared.channels, prepared.unit.dt
    empty = no_differences(channels.n_channel, len(prepared.devices))
    if units is None or not units.pair_sensor.size:
        return empty
    n_epoch, along = prepared.t_epoch.size, along_axes(units, dt)
    reach = np.zeros((3 * units.pair_sensor.size, n_epoch, n_component))
    nominal = np.zeros((units.pair_sensor.size, n_epoch, 3))
    for at, device, p in zip(channels.first, prepared.devices, units.pair_of.tolist(), strict=True):
        if p < 0:
            continue
        empty.of[at : at + 3] = range(3 * p, 3 * p + 3)
        s, solved = int(units.pair_sensor[p]), units.pair_solved[p]
        ticks = np.rint((np.stack([prepared.t_epoch - device.since, prepared.t_epoch]) - prepared.unit.start) / dt)
        nominal[p] = _summed(np.einsum("tic,tnc->ni", solved, along[s]), ticks)
        for j in np.flatnonzero((sensor == s) & (driver >= CONSTANT)).tolist():
            entering = inputs_of(units, dt, int(driver[j]), int(triad[j]), s)
            inputs = _summed(entering, ticks)
            if profile[j] >= 0:
                errors = _profile(prepared, int(profile[j])) * (entering / dt)
                nominal[p] += _summed(errors, ticks) @ solved[triad[j]].T
            else:
                axes = slice(int(first[j]), int(first[j]) + 3)
                reach[3 * p : 3 * p + 3, :, axes] = np.einsum("ic,ec->iec", solved[triad[j]], inputs)
    return Differences(empty.of, reach, units.pair_of, nominal)


def _summed(increments: Floats, ticks: Floats) -> Floats:
    """Return sums (n_epoch, k) of increments (n_tick, k) between two ticks (2, n_epoch) for each epoch."""
    total = np.vstack([np.zeros((1, increments.shape[1])), np.cumsum(increments, axis=0)])
    first, last = ticks.astype(np.int64)
    return np.asarray(total[last] - total[first])


def _profile(prepared: Prepared, profile: int) -> Floats:
    """Return the error of a deterministic profile times the tick, (n_tick, 3)."""
    unit = prepared.unit
    middle = unit.start + unit.dt * (np.arange(unit.dtheta.shape[0]) + 0.5)
    first, last = unit.profile_start[profile], unit.profile_end[profile]
    share = np.clip((middle - first) / (last - first), 0.0, 1.0)
    return np.asarray(unit.dt * share[:, None] * unit.profile[profile])
