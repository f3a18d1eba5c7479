"""States of a filter by its card and measurements, and the Jacobian rows of its measurement types."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ImuModel, ReceiverModel
from lvnav_trade.filter.card import BIASES, FilterCard
from lvnav_trade.filter.policies.epoch_differences import cloned_states, earlier_entries
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import N_NAV_ERROR
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import (
    BY_SATELLITE,
    EXTRAS,
    PARAMETERS,
    RELATIVE,
    ErrorTerm,
    ExtraBlock,
    StateLayout,
)
from lvnav_trade.sensors.family import SENSOR_MEASUREMENTS, SENSORS
from lvnav_trade.sensors.jacobian_row import D_EXTRA, H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, Channels, members, sensor_states

PSEUDORANGE, RANGE_RATE, POSITION, VELOCITY, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE, FIRST_SENSOR = range(8)
# Number of each measurement type in the kernels, by name.
TYPES = {
    "pseudorange": PSEUDORANGE,
    "range_rate": RANGE_RATE,
    "position": POSITION,
    "velocity": VELOCITY,
    "carrier_phase": CARRIER_PHASE,
    "tdcp": TDCP,
    "delta_pseudorange": DELTA_PSEUDORANGE,
} | {name: FIRST_SENSOR + k for k, name in enumerate(SENSOR_MEASUREMENTS)}
# Noise states of differences of two epochs; the filter has them although its card does not name them.
NOISE_STATES = {"tdcp": "phase_noise", "delta_pseudorange": "code_noise"}
# Pairs of a Jacobian entry and the state that it multiplies.
EntryPairs = list[tuple[int, int]]


def channel_types(channels: Channels) -> Ints:
    """Return the measurement type of each channel, (n_channel,), as numbered in `TYPES`."""
    types = [POSITION] * 3 + [VELOCITY] * 3
    if channels.tight:
        satellite_types = [TYPES[name] for name in channels.observables]
        types = satellite_types * len(channels.satellites)
    for sensor in channels.sensors:
        types += [TYPES[sensor.measurement]] * len(sensor.labels)
    return np.array(types, dtype=np.int64)


def _rate_state(layout: StateLayout) -> int:
    """Return the first of the three states that model the body-rate error: rate states or gyro biases; -1 if none."""
    if layout.motion >= 0:
        return layout.motion
    for block in layout.parameters:
        if block.sensor == GYRO and block.driver == transition.CONSTANT:
            return block.offset
    return -1


def _state_entries(layout: StateLayout, has_lever: bool, is_decorrelated: bool) -> dict[int, EntryPairs]:
    """Return the Jacobian entries of each measurement type and the states that they multiply, without extra states."""
    navigation = {
        "position": [(H_POS + i, POS + i) for i in range(3)],
        "velocity": [(H_VEL + i, VEL + i) for i in range(3)],
        "attitude": [(H_ATT + i, ATT + i) for i in range(3)],
    }
    position = navigation["position"]
    velocity = navigation["velocity"]
    # attitude and body rate move an antenna only through its lever arm
    attitude: EntryPairs = []
    rate: EntryPairs = []
    if has_lever:
        attitude = navigation["attitude"]
        rate_state = _rate_state(layout)
        if rate_state >= 0:
            rate = [(H_RATE + i, rate_state + i) for i in range(3)]
    bias: EntryPairs = []
    drift: EntryPairs = []
    if layout.clock >= 0:
        bias = [(H_CLOCK, layout.clock)]
        drift = [(H_CLOCK, layout.clock + 1)]
    entries = dict.fromkeys((PSEUDORANGE, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE), position + attitude + bias)
    entries[RANGE_RATE] = position + attitude + velocity + rate + drift
    entries[POSITION] = position + attitude
    entries[VELOCITY] = velocity + attitude + rate
    if is_decorrelated:  # decorrelation combines the rows of position and velocity
        entries[POSITION] = entries[POSITION] + velocity + rate
        entries[VELOCITY] = entries[VELOCITY] + position
    for card in SENSORS:
        sensor_entries: EntryPairs = []
        for name in card.jacobian:
            sensor_entries += navigation[name]
        entries[TYPES[card.measurement]] = sensor_entries
    return entries


def _extra_entries(layout: StateLayout, channel: int, measurement_type: int, is_decorrelated: bool) -> EntryPairs:
    """Return the Jacobian entries of the extra states of a channel, and these states."""
    member_entries = []
    for family, block in enumerate(layout.extras):
        member = int(block.member[channel])
        if member >= 0:
            member_entries.append((N_ENTRY + family, block.offset + member))
    if not is_decorrelated:
        return member_entries
    # decorrelation combines the rows of all axes, so every extra state has an entry of its own
    channel_states = {state for _, state in member_entries}
    is_solution = measurement_type in (POSITION, VELOCITY)
    pairs = []
    for index, state in enumerate(_extra_states(layout)):
        if is_solution or state in channel_states:
            pairs.append((N_ENTRY + index, state))
    return pairs


def _extra_states(layout: StateLayout) -> list[int]:
    """Return the indices of all extra states in the state vector, family by family."""
    return [block.offset + i for block in layout.extras for i in range(len(block.labels))]


def row_tables(
    layout: StateLayout, channel_type: Ints, has_lever: bool, is_decorrelated: bool
) -> tuple[Ints, Ints, Ints]:
    """Return the structure of the Jacobian row of each channel.

    Parameters
    ----------
    layout
        States of the filter.
    channel_type
        (n_channel,). Measurement types, of `channel_types`.
    has_lever
        Whether an antenna is away from the IMU; otherwise attitude and body rate do not enter.
    is_decorrelated
        Whether the rows of a solution are decorrelated. Each of them then has the entries of all six.

    Returns
    -------
    count
        (n_channel,). Number of entries that are not zero.
    entry, column
        (n_channel, n_entry). Places of these entries in the Jacobian row, and the states that they multiply.
    """
    state_entries = _state_entries(layout, has_lever, is_decorrelated)
    n_extra = len(_extra_states(layout)) if is_decorrelated else len(layout.extras)
    n_present = N_ENTRY + n_extra
    n_earlier = D_EXTRA + len(layout.extras) if layout.cloned_states else 0
    count = np.zeros(channel_type.size, dtype=np.int64)
    pairs = np.zeros((2, channel_type.size, n_present + n_earlier), dtype=np.int64)
    for channel, measurement_type in enumerate(channel_type.tolist()):
        extra_entries = _extra_entries(layout, channel, measurement_type, is_decorrelated)
        row = state_entries[measurement_type] + extra_entries
        if measurement_type in (TDCP, DELTA_PSEUDORANGE) and layout.cloned_states:
            row += earlier_entries(layout, row, n_present)
        count[channel] = len(row)
        pairs[:, channel, : len(row)] = np.transpose(row)
    return count, pairs[0], pairs[1]


def clock_gains(layout: StateLayout, channels: Channels) -> Floats:
    """Return the gains by which a reference satellite determines the clock, (n_observable, n_state).

    A range determines the bias and a range rate the drift, with gain 1. A difference of two epochs determines the bias
    at its earlier epoch; its partial derivative is -1, and so is its gain.
    """
    gains = np.zeros((len(channels.observables), layout.n_state))
    for observable, name in enumerate(channels.observables):
        if name in DIFFERENCES and layout.clock in layout.cloned_states:
            clock_clone = layout.clone + layout.cloned_states.index(layout.clock)
            gains[observable, clock_clone] = -1.0
        elif layout.clock >= 0 and name not in DIFFERENCES:
            clock_state = layout.clock + (name == "range_rate")
            gains[observable, clock_state] = 1.0
    return gains


def extra_tables(layout: StateLayout, n_channel: int) -> tuple[Ints, Ints]:
    """Return the state index of each extra state, and which extra state enters which channel.

    Returns
    -------
    offsets
        (n_extra,). Index in the state vector.
    member
        (n_family, n_channel). Extra state of the family that enters the channel, -1 none.
    """
    member = np.full((len(layout.extras), n_channel), -1, dtype=np.int64)
    n_extra = 0
    for family, block in enumerate(layout.extras):
        member[family] = np.where(block.member >= 0, n_extra + block.member, -1)
        n_extra += len(block.labels)
    return np.array(_extra_states(layout), dtype=np.int64), member


# Time constant (s) of a state that is independent from window to window.
NO_MEMORY = 1e-12


class FilterMeasurements(NamedTuple):
    """Sensor models, channels and measurements that a filter is built from, in addition to its card.

    imu : Model of the IMU.
    receiver : Model of the receiver.
    channels : Measurement channels.
    measurements : Names of the measurements that the filter processes.
    lever_arms : (n_antenna, 3) m. Antenna phase centres relative to the IMU, body axes.
    decimation : The receiver's measurements of every n-th epoch are processed, n being this number.
    has_covariance : Whether solutions have a reported covariance, by which they are decorrelated.
    has_solver : Whether the receiver computes its solution itself, from ranges.
    clock_drift : m/s. Initial one-sigma of the clock drift; a one-state clock models it as white noise.
    """

    imu: ImuModel
    receiver: ReceiverModel
    channels: Channels
    measurements: tuple[str, ...] = ()
    lever_arms: Floats = np.zeros((1, 3))
    decimation: int = 1
    has_covariance: bool = False
    has_solver: bool = False
    clock_drift: float = 0.0

    @property
    def has_lever(self) -> bool:
        """Whether an antenna is away from the IMU."""
        return bool(np.any(self.lever_arms))


def _parameter_blocks(names: list[str], imu: ImuModel, offset: int) -> list[ErrorTerm]:
    """Return the blocks of IMU parameters, three states each, from state `offset` on."""
    blocks: list[ErrorTerm] = []
    for name in names:
        parameter = PARAMETERS[name]
        for term, driver in enumerate(parameter.drivers):
            block = ErrorTerm(
                name,
                term,
                parameter.sensor,
                driver,
                imu.sigma(name),
                walk=getattr(imu, f"{name}_walk", 0.0),
                time_constant=getattr(imu, f"{name}_time", None) or math.inf,
                offset=offset + 3 * len(blocks),
            )
            blocks.append(block)
    return blocks


def _extra_blocks(
    names: list[str],
    imu: ImuModel,
    receiver: ReceiverModel,
    channels: Channels,
    offset: int,
    as_noise: tuple[str, ...] = (),
) -> list[ExtraBlock]:
    """Return the blocks of extra states from state `offset` on; names in `as_noise` have no memory."""
    blocks = []
    for name in names:
        labels, member = members(name, channels)
        if labels:
            card = imu if name in RELATIVE.values() else receiver
            field = BY_SATELLITE.get(name, name)
            time_constant = NO_MEMORY
            if name not in as_noise:  # noise has no correlation time: one that is given is refused as without effect
                time_constant = getattr(card, f"{field}_time", None) or math.inf
            block = ExtraBlock(
                name,
                labels,
                offset,
                member,
                getattr(card, field, 0.0),
                time_constant,
                EXTRAS[name],
                walk=getattr(card, f"{field}_walk", 0.0),
                correlation=getattr(card, f"{field}_correlation", 0.0),
            )
            blocks.append(block)
            offset += len(labels)
        for state, member, _ in sensor_states(name, channels):
            block = ExtraBlock(
                name,
                (state.label,),
                offset,
                member,
                state.sigma,
                NO_MEMORY if name in as_noise else state.time_constant,
                state.unit,
            )
            blocks.append(block)
            offset += 1
    return blocks


def _state_names(card: FilterCard, measurements: tuple[str, ...]) -> list[str]:
    """Return the names of the IMU parameters and extra states of a filter, estimated or considered."""
    names = [name for name in (*BIASES, *card.extra_states, *card.as_noise) if name not in card.neglect]
    for measurement, state in RELATIVE.items():
        if measurement in measurements and state not in names:
            names.append(state)
    if "carrier_phase" in measurements:
        names.append("ambiguity")
    return names + [name for name in card.consider if name not in names]


def _count_states(blocks: list[ExtraBlock]) -> int:
    """Return the number of states of some blocks of extra states."""
    return sum(len(block.labels) for block in blocks)


def state_layout(card: FilterCard, sources: FilterMeasurements, n_clone: int = 0) -> StateLayout:
    """Return the state layout of a filter.

    The order is: navigation errors, estimated IMU parameters, clock, estimated extra states, motion of the vehicle,
    states of the earlier epoch of differences, considered states. Noise that the scalar measurements of an epoch share
    (`as_noise`) is a state without memory: it is estimated within an epoch and then reset.

    Parameters
    ----------
    card
        Filter card.
    sources
        Sensor models, channels and measurements of the filter.
    n_clone
        Number of cloned states. The function finds it and calls itself once more; callers omit it.
    """
    layout = _number_states(card, sources, n_clone)
    # which states are cloned follows from the layout, whose offsets depend on their number
    differences = _differences(card, sources)
    clone_sources = cloned_states(layout, sources.channels, differences, sources.has_lever)
    if len(clone_sources) != n_clone:
        return state_layout(card, sources, len(clone_sources))
    return layout._replace(cloned_states=clone_sources)


def _differences(card: FilterCard, sources: FilterMeasurements) -> tuple[str, ...]:
    """Return the measurements of a filter that are differences of two epochs."""
    return tuple(name for name in card.differences if name in sources.measurements)


def _number_states(card: FilterCard, sources: FilterMeasurements, n_clone: int) -> StateLayout:
    """Return the state layout of a filter with a number of clones, without the states that are cloned."""
    imu, receiver, channels = sources.imu, sources.receiver, sources.channels
    names = _state_names(card, sources.measurements)
    estimated_names = [name for name in names if name not in card.consider]
    considered_names = [name for name in names if name in card.consider]
    has_one_state_clock = channels.tight and card.clock == "one_state"

    parameter_names = [name for name in estimated_names if name in PARAMETERS]
    parameters = _parameter_blocks(parameter_names, imu, N_NAV_ERROR)
    offset = N_NAV_ERROR + 3 * len(parameters)
    clock = -1
    if channels.tight and not has_one_state_clock:
        clock = offset
        offset += 2
    extra_names = [name for name in estimated_names if name not in PARAMETERS]
    extras = _extra_blocks(extra_names, imu, receiver, channels, offset, card.as_noise)
    offset += _count_states(extras)
    motion = -1
    if "imu" in sources.measurements:
        motion = offset
        offset += 6
    if has_one_state_clock:
        clock = offset
        offset += 1
    n_estimated = offset
    if has_one_state_clock:  # the drift: a state of zero variance that updates do not correct
        offset += 1

    earlier_epoch = offset
    # read for differences only: a setting that is not read is refused as one without effect
    differences = _differences(card, sources)
    noise_names = [NOISE_STATES[name] for name in differences if card.previous_noise == "estimated"]
    noise_blocks = _extra_blocks(noise_names, imu, receiver, channels, offset)
    n_earlier_epoch = _count_states(noise_blocks) + n_clone
    offset += n_earlier_epoch

    parameter_names = [name for name in considered_names if name in PARAMETERS]
    considered_parameters = _parameter_blocks(parameter_names, imu, offset)
    offset += 3 * len(considered_parameters)
    extra_names = [name for name in considered_names if name not in PARAMETERS]
    considered_extras = _extra_blocks(extra_names, imu, receiver, channels, offset, card.as_noise)
    offset += _count_states(considered_extras)

    return StateLayout(
        parameters=tuple(parameters + considered_parameters),
        clock=clock,
        n_estimated=n_estimated,
        n_state=offset,
        extras=tuple(extras + noise_blocks + considered_extras),
        motion=motion,
        samples=card.report_imu_samples,
        earlier_epoch=earlier_epoch,
        n_earlier_epoch=n_earlier_epoch,
        clone=earlier_epoch + n_earlier_epoch - n_clone if n_clone else -1,
    )
