"""IMU arrays on the nominal flight: increments at each IMU, and the combined triad."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, DeadAxis, DroppedSamples
from lvnav_trade.gnss.faults import periods
from lvnav_trade.imu.array import ImuSet, keyed, terms_of, triads_of
from lvnav_trade.imu.differences import difference
from lvnav_trade.imu.error_model import DeadElement, ImuCard, lag, put_out
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OTHER_0, OWN_0, OWN_2, SQUARE
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.error_sources import IMU_NOISE
from lvnav_trade.quantities.per_axis import axes
from lvnav_trade.quantities.records import Floats, Reference
from lvnav_trade.quantities.state_layout import RELATIVE, StateLayout
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray
from lvnav_trade.simulation.preparation.sensors import Sensor

_kept: OrderedDict[tuple[int, float | None, float], tuple[Floats, Floats]] = OrderedDict()
_LAST = 4  # increments of two sensors of two trajectories


def _lagged(increments: Floats, bandwidth: float | None, dt: float) -> Floats:
    """Return increments filtered by the bandwidth of a sensor; the last few are cached, since cases share them."""
    key = (id(increments), bandwidth, dt)
    if key not in _kept:
        filtered = np.ascontiguousarray(lag(increments, bandwidth, dt))
        _kept[key] = increments, filtered  # keeping the increments alive keeps their id unique
        while len(_kept) > _LAST:
            _kept.popitem(last=False)
    return _kept[key][1]


def arriving(
    ref: Reference,
    card: ImuCard,
    faults: Sequence[AnyFault],
    course: FlightProfile,
    unit: int = 0,
    beside: Floats | None = None,
) -> list[Floats]:
    """Return angle and velocity increments sensed by an ideal IMU of a given bandwidth, (n_imu, 3) each, body axes.

    Parameters
    ----------
    ref
        True motion and ideal increments.
    card
        Card of the IMU.
    faults, course
        Faults, of which dropped samples act here; conditions of the trajectory.
    unit
        Number of the IMU in an array.
    beside
        (n_imu, 3) m/s. Velocity increments by the lever arm of the IMU.
    """
    dt = 1.0 / card.rate
    dvel = ref.dvel if beside is None else ref.dvel + beside
    sensed = ((ref.dtheta, card.gyro.bandwidth), (dvel, card.accel.bandwidth))
    out = [_lagged(increments, bandwidth, dt) for increments, bandwidth in sensed]
    dropped = [
        (fault, period)
        for number, fault in enumerate(faults)
        if isinstance(fault, DroppedSamples) and fault.unit == unit + 1
        for period in periods(number, fault, course)
    ]
    if dropped:
        out = [array.copy() for array in out]  # the reference is shared with other cases
    for fault, (start, end) in dropped:
        lost = np.flatnonzero((ref.t[1:] > start + 1e-9) & (ref.t[1:] <= end + 1e-9))
        for array in out:
            array[lost] = array[max(0, lost[0] - 1)] if lost.size and fault.instead == "last" else 0.0
    return out


def elements(
    sensed: Sequence[Floats],
    card: ImuCard,
    axes: Floats,
    first: int,
    faults: Sequence[AnyFault],
    course: FlightProfile,
    t: Floats,
    unit: int = 0,
) -> list[Floats]:
    """Return angle and velocity increments with dead axes and saturation of the sensing elements of a triad.

    Parameters
    ----------
    sensed
        (n_imu, 3) each. Angle and velocity increments, body axes.
    card
        Card of the IMU.
    axes, first
        (k, 3). Directions of the axes of the triad, body axes; number of the first of them in the IMU.
    faults, course
        Faults, of which dead axes act here; conditions of the trajectory.
    t
        (n_imu,) s since lift-off. Ends of the ticks.
    unit
        Number of the IMU in an array.
    """
    increments_out = []
    for name, increments, triad in zip(("gyro", "accelerometer"), sensed, (card.gyro, card.accel), strict=True):
        dead = [
            DeadElement(fault.axis - 1 - first, (t > start + 1e-9) & (t <= end + 1e-9), fault.output == "last")
            for number, fault in enumerate(faults)
            if isinstance(fault, DeadAxis) and fault.unit == unit + 1 and fault.sensor == name
            if first < fault.axis <= first + len(axes)
            for start, end in periods(number, fault, course)
        ]
        limit = math.inf if triad.full_scale is None else triad.full_scale / card.rate
        increments_out.append(np.ascontiguousarray(put_out(increments, axes, limit, dead)))
    return increments_out


def swing(ref: Reference, lever: Floats) -> Floats:
    """Return the velocity increments (n_imu, 3) m/s by a lever arm (3,) m, body axes.

    The tangential acceleration dw/dt x r is integrated exactly, the centripetal w x (w x r) by Simpson's rule.
    """
    dt = float(ref.t[1] - ref.t[0])
    rate = ref.w_ib_b
    middle = ref.dtheta / dt
    inward = [np.cross(w, np.cross(w, lever)) for w in (rate[:-1], middle, rate[1:])]
    return np.asarray(np.cross(np.diff(rate, axis=0), lever) + dt / 6.0 * (inward[0] + 4.0 * inward[1] + inward[2]))


def units_of(
    scenario: Scenario, ref: Reference, course: FlightProfile, devices: tuple[Sensor, ...], layout: StateLayout
) -> ImuArray | None:
    """Return the IMUs of an array as arrays for the kernels; None for one IMU.

    Parameters
    ----------
    scenario
        Validated model of the case.
    ref
        True motion and ideal increments on the ticks.
    course
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
    triads = triads_of(card)
    sensed = [
        arriving(ref, unit, scenario.faults, course, number, swing(ref, np.array(unit.lever_arm)))
        for number, unit in enumerate(card.units)
    ]
    owner = [triad.unit for triad in triads]
    part = [owner[:k].count(unit) for k, unit in enumerate(owner)]
    out = [
        elements(
            sensed[triad.unit],
            card.units[triad.unit],
            triad.frames[: triad.n_axis, 0],
            3 * k,
            scenario.faults,
            course,
            ref.t[1:],
            triad.unit,
        )
        for triad, k in zip(triads, part, strict=True)
    ]
    keys = [keyed(f"{IMU_NOISE} {k}" if k else IMU_NOISE, unit) for unit, k in zip(owner, part, strict=True)]
    lever = np.array([card.units[unit].lever_arm for unit in owner], dtype=float)
    return ImuArray(
        dtheta=np.array([increments[GYRO] for increments in out]),
        dvel=np.array([increments[ACCEL] for increments in out]),
        n_axis=np.array([triad.n_axis for triad in triads], dtype=np.int64),
        frames=np.array([triad.frames for triad in triads]),
        solved=np.array([[[triad.gyro, triad.accel] for triad in triads]]),
        noisy=np.ones((1, 2, 2, 3)),
        shift=np.zeros((1, 2, 3)),
        stage=np.zeros(ref.dtheta.shape[0], dtype=np.int64),
        flown=np.zeros(ref.dtheta.shape[0], dtype=np.int64),
        lever=lever * (card.lever_arms == "compensated"),
        noise_sources=np.array([source_word(key) for key in keys], dtype=np.uint64),
        white=np.array([white_of(card.units[triad.unit], dt) for triad in triads]),
        triads=np.array([block.triad for block in terms_of(card)], dtype=np.int64),
        **_pairs(card, devices, layout),
    )


def _pairs(card: ImuSet, devices: tuple[Sensor, ...], layout: StateLayout) -> dict[str, Any]:
    """Return the measured differences of two IMUs, by name of the field of `ImuArray`."""
    state = {extra.name: extra.offset for extra in layout.extras}
    pairs: list[tuple[int, Floats, int]] = []
    of = np.full(max(1, len(devices)), -1, dtype=np.int64)
    for number, device in enumerate(devices):
        if isinstance(device.card, ImuDifferenceCard):
            sensor = GYRO if device.card.unit == "rad" else ACCEL
            first, second = device.card.units
            solved = np.array([columns[sensor] for columns in difference(card, first - 1, second - 1)])
            of[number] = len(pairs)
            pairs.append((sensor, solved, state.get(RELATIVE[device.card.measurement], -1)))
    return {
        "pair_sensor": np.array([sensor for sensor, _, _ in pairs], dtype=np.int64),
        "pair_solved": np.array([solved for _, solved, _ in pairs]).reshape(len(pairs), len(triads_of(card)), 3, 3),
        "pair_state": np.array([at for _, _, at in pairs], dtype=np.int64),
        "pair_of": of,
    }


def white_of(unit: ImuCard, dt: float) -> Floats:
    """Return the sigma of white noise in an increment, (8,): gyro rad, accelerometer m/s; then quantisation steps."""
    noise = [walk * math.sqrt(dt) for card in (unit.gyro, unit.accel) for walk in axes(card.random_walk)]
    return np.array([*noise, unit.gyro.quantisation, unit.accel.quantisation])


def along_axes(units: ImuArray, dt: float) -> tuple[Floats, Floats]:
    """Return angle and velocity increments along the sensing axes, (n_triad, n_imu, 3) each, without errors.

    Lever arms are compensated as in the kernel (`simulation.imu_array.lever_arm_increment`).
    """
    directions = units.frames[:, :, 0]
    angles = np.einsum("tcj,tnj->tnc", directions, units.dtheta)
    angle = _solved(units, GYRO, angles)
    change = np.diff(angle, axis=0, prepend=angle[:1])
    # increment of a lever arm r over a tick: (change of w) x r + w x (w x r) dt
    lever_arm_increment = [
        (np.cross(change, lever) + np.cross(angle, np.cross(angle, lever))) / dt for lever in units.lever
    ]
    return angles, np.einsum("tcj,tnj->tnc", directions, units.dvel - np.array(lever_arm_increment))


def fused(units: ImuArray, dt: float) -> tuple[Floats, Floats]:
    """Return angle and velocity increments of the combined triad without errors, (n_imu, 3) each, body axes."""
    combined = (_solved(units, k, along) for k, along in enumerate(along_axes(units, dt)))
    angle, velocity = (np.ascontiguousarray(mean + units.shift[units.stage, k]) for k, mean in enumerate(combined))
    return angle, velocity


def _solved(units: ImuArray, sensor: int, along: Floats) -> Floats:
    """Return the combined increments (n_imu, 3) from increments along the sensing axes (n_triad, n_imu, 3)."""
    combined = np.einsum("tic,tnc->ni", units.solved[0, :, sensor], along)
    for stage in np.unique(units.stage[units.stage > 0]):
        in_stage = units.stage == stage
        combined[in_stage] = np.einsum("tic,tnc->ni", units.solved[stage, :, sensor], along[:, in_stage])
    return np.asarray(combined)


def inputs_of(units: ImuArray, dt: float, driver: int, triad: int, sensor: int) -> Floats:
    """Return the driver of the parameters of a triad times the tick, (n_imu, 3) by sensing axis.

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
    own, other = (units.dtheta, units.dvel)[:: 1 if sensor == GYRO else -1]
    if driver == CONSTANT:
        return np.full((own.shape[1], 3), dt)
    if driver == SQUARE:
        return np.asarray((own[triad] @ frames[:, 0].T) ** 2 / dt)
    if OWN_0 <= driver <= OWN_2:
        return np.asarray(own[triad] @ frames[:, driver - OWN_0].T)
    return np.stack([other[triad] @ frames[c, (driver - OTHER_0 - c) % 3] for c in range(3)], axis=1)
