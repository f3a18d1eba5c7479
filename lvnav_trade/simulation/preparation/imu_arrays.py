"""IMU arrays on the nominal flight: increments at each IMU, and the combined triad."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, DeadAxis, DroppedSamples
from lvnav_trade.gnss.faults import periods
from lvnav_trade.imu.array import ImuSet, imu_error_terms, list_triads, source_key
from lvnav_trade.imu.differences import difference
from lvnav_trade.imu.error_model import DeadElement, ImuCard, lag, sensor_output
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OTHER_0, OWN_0, OWN_2, SQUARE
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.error_sources import IMU_NOISE
from lvnav_trade.quantities.per_axis import axes
from lvnav_trade.quantities.records import Bools, Floats, Reference
from lvnav_trade.quantities.state_layout import RELATIVE, StateLayout
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray
from lvnav_trade.simulation.preparation.sensors import Sensor

_lag_cache: OrderedDict[tuple[int, float | None, float], tuple[Floats, Floats]] = OrderedDict()
_LAST = 4  # increments of two sensors of two trajectories


def _cached_lag(increments: Floats, bandwidth: float | None, dt: float) -> Floats:
    """Return increments filtered by the bandwidth of a sensor; the last few are cached, since cases share them."""
    key = (id(increments), bandwidth, dt)
    if key not in _lag_cache:
        filtered_increments = np.ascontiguousarray(lag(increments, bandwidth, dt))
        _lag_cache[key] = increments, filtered_increments  # keeping the increments alive keeps their id unique
        while len(_lag_cache) > _LAST:
            _lag_cache.popitem(last=False)
    return _lag_cache[key][1]


def band_limited_increments(
    ref: Reference,
    card: ImuCard,
    faults: Sequence[AnyFault],
    flight_profile: FlightProfile,
    unit: int = 0,
    lever_arm_dvel: Floats | None = None,
) -> list[Floats]:
    """Return angle and velocity increments sensed by an ideal IMU of a given bandwidth, (n_tick, 3) each, body axes.

    Parameters
    ----------
    ref
        True motion and ideal increments.
    card
        Card of the IMU.
    faults, flight_profile
        Faults, of which dropped samples act here; conditions of the trajectory.
    unit
        Number of the IMU in an array.
    lever_arm_dvel
        (n_tick, 3) m/s. Velocity increments by the lever arm of the IMU.
    """
    dt = 1.0 / card.rate
    dvel = ref.dvel if lever_arm_dvel is None else ref.dvel + lever_arm_dvel
    dtheta_out = _cached_lag(ref.dtheta, card.gyro.bandwidth, dt)
    dvel_out = _cached_lag(dvel, card.accel.bandwidth, dt)
    dropped_periods = []
    for number, fault in enumerate(faults):
        if isinstance(fault, DroppedSamples) and fault.unit == unit + 1:
            dropped_periods += [(fault, period) for period in periods(number, fault, flight_profile)]
    if not dropped_periods:
        return [dtheta_out, dvel_out]
    sensor_increments = [dtheta_out.copy(), dvel_out.copy()]  # the originals are shared with other cases
    for fault, (start, end) in dropped_periods:
        lost_ticks = np.flatnonzero(_ticks_within(ref.t[1:], start, end))
        for increments in sensor_increments:
            repeats = lost_ticks.size and fault.instead == "last"
            increments[lost_ticks] = increments[max(0, lost_ticks[0] - 1)] if repeats else 0.0
    return sensor_increments


def _ticks_within(t: Floats, start: float, end: float) -> Bools:
    """Return whether ticks that end at t (n,) s lie between two times (s), to rounding."""
    is_after_start = t > start + 1e-9
    is_until_end = t <= end + 1e-9
    return is_after_start & is_until_end


def elements(
    sensor_increments: Sequence[Floats],
    card: ImuCard,
    axes: Floats,
    first: int,
    faults: Sequence[AnyFault],
    flight_profile: FlightProfile,
    t: Floats,
    unit: int = 0,
) -> list[Floats]:
    """Return angle and velocity increments with dead axes and saturation of the sensing elements of a triad.

    Parameters
    ----------
    sensor_increments
        (n_tick, 3) each. Angle and velocity increments, body axes.
    card
        Card of the IMU.
    axes, first
        (k, 3). Directions of the axes of the triad, body axes; number of the first of them in the IMU.
    faults, flight_profile
        Faults, of which dead axes act here; conditions of the trajectory.
    t
        (n_tick,) s since lift-off. Ends of the ticks.
    unit
        Number of the IMU in an array.
    """
    increments_out = []
    for name, increments, triad in zip(
        ("gyro", "accelerometer"), sensor_increments, (card.gyro, card.accel), strict=True
    ):
        dead = []
        for number, fault in enumerate(faults):
            if not isinstance(fault, DeadAxis) or fault.unit != unit + 1 or fault.sensor != name:
                continue
            axis = fault.axis - 1 - first
            if 0 <= axis < len(axes):
                for start, end in periods(number, fault, flight_profile):
                    dead.append(DeadElement(axis, _ticks_within(t, start, end), fault.output == "last"))
        limit = math.inf if triad.full_scale is None else triad.full_scale / card.rate
        increments_out.append(np.ascontiguousarray(sensor_output(increments, axes, limit, dead)))
    return increments_out


def lever_arm_velocity_increments(ref: Reference, lever: Floats) -> Floats:
    """Return the velocity increments (n_tick, 3) m/s by a lever arm (3,) m, body axes.

    The tangential acceleration dw/dt x r is integrated exactly, the centripetal w x (w x r) by Simpson's rule.
    """
    dt = float(ref.t[1] - ref.t[0])
    rate = ref.w_ib_b
    mean_rate = ref.dtheta / dt
    rates = (rate[:-1], mean_rate, rate[1:])
    first, middle, last = (np.cross(w, np.cross(w, lever)) for w in rates)
    centripetal = dt / 6.0 * (first + 4.0 * middle + last)
    rate_change = np.diff(rate, axis=0)
    tangential = np.cross(rate_change, lever)
    return np.asarray(tangential + centripetal)


def imu_array_of(
    scenario: Scenario,
    ref: Reference,
    flight_profile: FlightProfile,
    devices: tuple[Sensor, ...],
    layout: StateLayout,
) -> ImuArray | None:
    """Return the IMUs of an array as arrays for the kernels; None for one IMU.

    Parameters
    ----------
    scenario
        Validated model of the case.
    ref
        True motion and ideal increments on the ticks.
    flight_profile
        Conditions of the trajectory, for the periods of faults.
    devices
        Sensors other than the receiver, among them differences of two IMUs.
    layout
        States of the filter.
    """
    card = scenario.imu
    if isinstance(card, ImuCard):
        return None
    dt = 1.0 / card.rate
    n_tick = ref.dtheta.shape[0]
    triads = list_triads(card)
    increments_by_imu = []
    for number, unit in enumerate(card.units):
        lever_arm_dvel = lever_arm_velocity_increments(ref, np.array(unit.lever_arm))
        increments_by_imu.append(
            band_limited_increments(ref, unit, scenario.faults, flight_profile, number, lever_arm_dvel)
        )
    owners = [triad.unit for triad in triads]
    increments_by_triad = []
    keys = []
    for index, triad in enumerate(triads):
        number = triad.unit
        triad_number = owners[:index].count(number)  # in its IMU
        axes_b = triad.frames[: triad.n_axis, 0]
        first_axis = 3 * triad_number
        tick_end = ref.t[1:]
        unit = card.units[number]
        increments_by_triad.append(
            elements(
                increments_by_imu[number], unit, axes_b, first_axis, scenario.faults, flight_profile, tick_end, number
            )
        )
        noise = f"{IMU_NOISE} {triad_number}" if triad_number else IMU_NOISE
        keys.append(source_key(noise, number))
    lever = np.array([card.units[number].lever_arm for number in owners], dtype=float)
    return ImuArray(
        dtheta=np.array([increments[GYRO] for increments in increments_by_triad]),
        dvel=np.array([increments[ACCEL] for increments in increments_by_triad]),
        n_axis=np.array([triad.n_axis for triad in triads], dtype=np.int64),
        frames=np.array([triad.frames for triad in triads]),
        axis_weights=np.array([[[triad.gyro, triad.accel] for triad in triads]]),
        error_factors=np.ones((1, 2, 2, 3)),
        shift=np.zeros((1, 2, 3)),
        stage=np.zeros(n_tick, dtype=np.int64),
        stage_without_exclusion=np.zeros(n_tick, dtype=np.int64),
        lever=lever * (card.lever_arms == "compensated"),
        noise_sources=np.array([source_word(key) for key in keys], dtype=np.uint64),
        white=np.array([noise_sigmas(card.units[number], dt) for number in owners]),
        triads=np.array([term.triad for term in imu_error_terms(card)], dtype=np.int64),
        **_measured_differences(card, devices, layout),
    )


def _measured_differences(card: ImuSet, devices: tuple[Sensor, ...], layout: StateLayout) -> dict[str, Any]:
    """Return the measured differences of two IMUs, by name of the field of `ImuArray`."""
    state = {extra.name: extra.offset for extra in layout.extras}
    pair_sensor: list[int] = []
    pair_weights: list[list[Floats]] = []
    pair_state: list[int] = []
    pair_of = np.full(max(1, len(devices)), -1, dtype=np.int64)
    for number, device in enumerate(devices):
        if isinstance(device.card, ImuDifferenceCard):
            sensor = GYRO if device.card.unit == "rad" else ACCEL
            first, second = device.card.units
            pair_of[number] = len(pair_sensor)
            pair_sensor.append(sensor)
            weights = difference(card, first - 1, second - 1)
            pair_weights.append([columns[sensor] for columns in weights])
            relative_bias = RELATIVE[device.card.measurement]
            pair_state.append(state.get(relative_bias, -1))
    n_pair = len(pair_sensor)
    return {
        "pair_sensor": np.array(pair_sensor, dtype=np.int64),
        "pair_weights": np.array(pair_weights).reshape(n_pair, len(list_triads(card)), 3, 3),
        "pair_state": np.array(pair_state, dtype=np.int64),
        "pair_of": pair_of,
    }


def noise_sigmas(unit: ImuCard, dt: float) -> Floats:
    """Return the sigma of white noise in an increment, (8,): gyro rad, accelerometer m/s; then quantisation steps."""
    gyro = unit.gyro
    accel = unit.accel
    root_dt = math.sqrt(dt)
    noise = [walk * root_dt for card in (gyro, accel) for walk in axes(card.random_walk)]
    return np.array([*noise, gyro.quantisation, accel.quantisation])


def axis_increments(units: ImuArray, dt: float) -> tuple[Floats, Floats]:
    """Return angle and velocity increments along the sensing axes, (n_triad, n_tick, 3) each, without errors.

    Lever arms are compensated as in the kernel (`simulation.imu_array.lever_arm_increment`).
    """
    directions = units.frames[:, :, 0]
    angles = np.einsum("tcj,tnj->tnc", directions, units.dtheta)
    angle = _combine_axes(units, GYRO, angles)
    change = np.diff(angle, axis=0, prepend=angle[:1])
    # increment of a lever arm r over a tick: (change of w) x r + w x (w x r) dt
    lever_arm_increments = []
    for lever in units.lever:
        centripetal = np.cross(angle, np.cross(angle, lever))
        tangential = np.cross(change, lever)
        lever_arm_increments.append((tangential + centripetal) / dt)
    compensated_dvel = units.dvel - np.array(lever_arm_increments)
    velocities = np.einsum("tcj,tnj->tnc", directions, compensated_dvel)
    return angles, velocities


def combined_increments(units: ImuArray, dt: float) -> tuple[Floats, Floats]:
    """Return angle and velocity increments of the combined triad without errors, (n_tick, 3) each, body axes."""
    angles, velocities = axis_increments(units, dt)
    angle_shift = units.shift[units.stage, GYRO]
    velocity_shift = units.shift[units.stage, ACCEL]
    angle = _combine_axes(units, GYRO, angles) + angle_shift
    velocity = _combine_axes(units, ACCEL, velocities) + velocity_shift
    return np.ascontiguousarray(angle), np.ascontiguousarray(velocity)


def _combine_axes(units: ImuArray, sensor: int, increments: Floats) -> Floats:
    """Return the combined increments (n_tick, 3) from increments along the sensing axes (n_triad, n_tick, 3)."""
    first_weights = units.axis_weights[0, :, sensor]
    triad_increments = np.einsum("tic,tnc->ni", first_weights, increments)
    later_stages = np.unique(units.stage[units.stage > 0])
    for stage in later_stages:
        in_stage = units.stage == stage
        weights = units.axis_weights[stage, :, sensor]
        triad_increments[in_stage] = np.einsum("tic,tnc->ni", weights, increments[:, in_stage])
    return np.asarray(triad_increments)


def inputs_of(units: ImuArray, dt: float, driver: int, triad: int, sensor: int) -> Floats:
    """Return the driver of the parameters of a triad times the tick, (n_tick, 3) by sensing axis.

    Parameters
    ----------
    units
        IMU array.
    dt
        s. Tick.
    driver, triad, sensor
        Driver as in `kernels.transition`; triad; GYRO or ACCEL.
    """
    frames = units.frames[triad]
    is_gyro = sensor == GYRO
    own_input = units.dtheta if is_gyro else units.dvel
    cross_input = units.dvel if is_gyro else units.dtheta
    if driver == CONSTANT:
        n_tick = own_input.shape[1]
        return np.full((n_tick, 3), dt)
    if driver == SQUARE:
        along_axes_of_triad = own_input[triad] @ frames[:, 0].T
        return np.asarray(along_axes_of_triad**2 / dt)
    if OWN_0 <= driver <= OWN_2:
        directions = frames[:, driver - OWN_0]
        return np.asarray(own_input[triad] @ directions.T)
    by_axis = []
    for axis in range(3):
        column = (driver - OTHER_0 - axis) % 3
        direction = frames[axis, column]
        by_axis.append(cross_input[triad] @ direction)
    return np.stack(by_axis, axis=1)
