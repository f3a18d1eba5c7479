"""States of a filter by its card and measurements, and the Jacobian rows of its measurement types."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ImuModel, ReceiverModel
from lvnav_trade.filter.card import BIASES, FilterCard
from lvnav_trade.filter.policies.epoch_differences import cloned_states, earlier_entries
from lvnav_trade.kernels import transition
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


def row_types(channels: Channels) -> Ints:
    """Return the measurement type of each channel, (n_channel,), as numbered in `TYPES`."""
    types = [POSITION] * 3 + [VELOCITY] * 3
    if channels.tight:
        types = [TYPES[name] for name in channels.observables] * len(channels.satellites)
    types += [TYPES[sensor.measures] for sensor in channels.sensors for _ in sensor.labels]
    return np.array(types, dtype=np.int64)


def _rate_state(layout: StateLayout) -> int:
    """Return the first of the three states that model the body-rate error: rate states or gyro biases; -1 if none."""
    if layout.motion >= 0:
        return layout.motion
    gyro_biases = [b.offset for b in layout.parameters if b.sensor == GYRO and b.driver == transition.CONSTANT]
    return gyro_biases[0] if gyro_biases else -1


def row_tables(layout: StateLayout, row_type: Ints, has_lever: bool, whitened: bool) -> tuple[Ints, Ints, Ints]:
    """Return the structure of the Jacobian row of each channel.

    Parameters
    ----------
    layout
        States of the filter.
    row_type
        (n_channel,). Measurement types, of `row_types`.
    has_lever
        Whether an antenna is away from the IMU; otherwise attitude and body rate do not enter.
    whitened
        Whether the rows of a solution are decorrelated. Each of them then has the entries of all six.

    Returns
    -------
    count
        (n_channel,). Number of entries that are not zero.
    entry, column
        (n_channel, n_entry). Places of these entries in the Jacobian row, and the states that they multiply.
    """
    navigation = (("position", H_POS, POS), ("velocity", H_VEL, VEL), ("attitude", H_ATT, ATT))
    whole = {name: [(entry + i, state + i) for i in range(3)] for name, entry, state in navigation}
    position, velocity, attitude = whole["position"], whole["velocity"], whole["attitude"] if has_lever else []
    rate = [(H_RATE + i, _rate_state(layout) + i) for i in range(3)] if has_lever and _rate_state(layout) >= 0 else []
    bias, drift = ([(H_CLOCK, layout.clock + k)] if layout.clock >= 0 else [] for k in (0, 1))
    types = {
        **dict.fromkeys((PSEUDORANGE, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE), position + attitude + bias),
        RANGE_RATE: position + attitude + velocity + rate + drift,
        POSITION: position + attitude + (velocity + rate if whitened else []),
        VELOCITY: velocity + attitude + rate + (position if whitened else []),
    }
    for card in SENSORS:
        types[TYPES[card.measurement]] = [pair for name in card.jacobian for pair in whole[name]]
    extras = [e.offset + i for e in layout.extras for i in range(len(e.labels))]
    count = np.zeros(row_type.size, dtype=np.int64)
    width = N_ENTRY + len(extras if whitened else layout.extras)
    n_earlier = D_EXTRA + len(layout.extras) if layout.cloned else 0
    pairs = np.zeros((2, row_type.size, width + n_earlier), dtype=np.int64)
    for channel, kind in enumerate(row_type.tolist()):
        if whitened:
            states = [e.offset + int(e.member[channel]) for e in layout.extras if e.member[channel] >= 0]
            extra = [(N_ENTRY + e, at) for e, at in enumerate(extras) if kind in (POSITION, VELOCITY) or at in states]
        else:
            extra = [
                (N_ENTRY + f, e.offset + int(e.member[channel]))
                for f, e in enumerate(layout.extras)
                if e.member[channel] >= 0
            ]
        row = types[kind] + extra
        if kind in (TDCP, DELTA_PSEUDORANGE) and layout.cloned:
            row += earlier_entries(layout, row, width)
        count[channel] = len(row)
        pairs[:, channel, : len(row)] = np.transpose(row)
    return count, pairs[0], pairs[1]


def clock_gains(layout: StateLayout, channels: Channels) -> Floats:
    """Return the gains by which a reference satellite determines the clock, (n_kind, n_state).

    A range determines the bias and a range rate the drift, with gain 1. A difference of two epochs determines the bias
    at its earlier epoch; its partial derivative is -1, and so is its gain.
    """
    gains = np.zeros((len(channels.observables), layout.n_state))
    for kind, name in enumerate(channels.observables):
        if name in DIFFERENCES and layout.clock in layout.cloned:
            gains[kind, layout.clone + layout.cloned.index(layout.clock)] = -1.0
        elif layout.clock >= 0 and name not in DIFFERENCES:
            gains[kind, layout.clock + (name == "range_rate")] = 1.0
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
    offsets: list[int] = []
    member = np.full((len(layout.extras), n_channel), -1, dtype=np.int64)
    for f, block in enumerate(layout.extras):
        member[f] = np.where(block.member >= 0, len(offsets) + block.member, -1)
        offsets += [block.offset + i for i in range(len(block.labels))]
    return np.array(offsets, dtype=np.int64), member


# Time constant (s) of a state that is independent from window to window.
NO_MEMORY = 1e-12


class FilterMeasurements(NamedTuple):
    """Sensor models, channels and measurements that a filter is built from, in addition to its card.

    imu : Model of the IMU.
    receiver : Model of the receiver.
    channels : Measurement channels.
    measurements : Names of the measurements that the filter processes.
    lever_arms : (n_antenna, 3) m. Antenna phase centres relative to the IMU, body axes.
    every : The receiver's measurements of every n-th epoch are processed, n being this number.
    has_covariance : Whether solutions have a reported covariance, by which they are decorrelated.
    solves : Whether the receiver computes its solution itself, from ranges.
    clock_drift : m/s. Initial one-sigma of the clock drift; a one-state clock models it as white noise.
    """

    imu: ImuModel
    receiver: ReceiverModel
    channels: Channels
    measurements: tuple[str, ...] = ()
    lever_arms: Floats = np.zeros((1, 3))
    every: int = 1
    has_covariance: bool = False
    solves: bool = False
    clock_drift: float = 0.0

    @property
    def has_lever(self) -> bool:
        """Whether an antenna is away from the IMU."""
        return bool(np.any(self.lever_arms))


def _parameter_blocks(names: list[str], imu: ImuModel, offset: int) -> list[ErrorTerm]:
    """Return the blocks of IMU parameters, three states each, from state `offset` on."""
    blocks: list[ErrorTerm] = []
    for name in names:
        walk, time_constant = getattr(imu, f"{name}_walk", 0.0), getattr(imu, f"{name}_time", None) or math.inf
        kind = PARAMETERS[name]
        for part, driver in enumerate(kind.drivers):
            at = offset + 3 * len(blocks)
            sigma = imu.sigma(name)
            blocks.append(ErrorTerm(name, part, kind.sensor, driver, sigma, walk, time_constant, offset=at))
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
            card, field = imu if name in RELATIVE.values() else receiver, BY_SATELLITE.get(name, name)
            ends = ("", "_walk", "_correlation")
            sigma, *more = (getattr(card, field + end, 0.0) for end in ends)
            time = NO_MEMORY if name in as_noise else getattr(card, f"{field}_time", None) or math.inf
            blocks.append(ExtraBlock(name, labels, offset, member, sigma, time, EXTRAS[name], *more))
            offset += len(labels)
        for state, member, _ in sensor_states(name, channels):
            time = NO_MEMORY if name in as_noise else state.time_constant
            blocks.append(ExtraBlock(name, (state.label,), offset, member, state.sigma, time, state.unit))
            offset += 1
    return blocks


def state_layout(card: FilterCard, taken: FilterMeasurements, n_clone: int = 0) -> StateLayout:
    """Return the state layout of a filter.

    The order is: navigation errors, estimated IMU parameters, clock, estimated extra states, motion of the vehicle,
    states of the earlier epoch of differences, considered states. Noise that the scalar measurements of an epoch share
    (`as_noise`) is a state without memory: it is estimated within an epoch and then reset.

    Parameters
    ----------
    card
        Filter card.
    taken
        Sensor models, channels and measurements of the filter.
    n_clone
        Number of cloned states. The function finds it and calls itself once more; callers omit it.
    """
    imu, receiver, channels, measurements = taken.imu, taken.receiver, taken.channels, taken.measurements
    differences = tuple(name for name in card.differences if name in measurements)
    noises = [NOISE_STATES[name] for name in differences if card.previous_noise == "estimated"]
    wanted = [n for n in (*BIASES, *card.extra_states, *card.as_noise) if n not in card.neglect]
    wanted += [state for name, state in RELATIVE.items() if name in measurements and state not in wanted]
    wanted += ["ambiguity"] if "carrier_phase" in measurements else []
    wanted += [n for n in card.consider if n not in wanted]
    parameters: list[ErrorTerm] = []
    extras: list[ExtraBlock] = []
    offset, clock, motion, n_estimated, delayed, n_delayed = 9, -1, -1, 9, 9, 0
    for considered in (False, True):
        group = [n for n in wanted if (n in card.consider) == considered]
        blocks = _parameter_blocks([n for n in group if n in PARAMETERS], imu, offset)
        offset += 3 * len(blocks)
        reduced = channels.tight and card.clock == "one_state"
        if not considered and channels.tight and not reduced:
            clock, offset = offset, offset + 2
        shared = _extra_blocks(
            [n for n in group if n not in PARAMETERS], imu, receiver, channels, offset, card.as_noise
        )
        offset += sum(len(block.labels) for block in shared)
        parameters, extras = parameters + blocks, extras + shared
        if not considered:
            if "imu" in measurements:
                motion, offset = offset, offset + 6
            clock = offset if reduced else clock
            n_estimated = offset = offset + reduced
            offset += reduced  # the drift of a one-state clock: a state of zero variance that updates do not correct
            delayed = offset
            extras += (noise_blocks := _extra_blocks(noises, imu, receiver, channels, offset))
            n_delayed = sum(len(block.labels) for block in noise_blocks) + n_clone
            offset += n_delayed
    layout = StateLayout(
        tuple(parameters), clock, n_estimated, offset, tuple(extras), motion, samples=card.report_imu_samples
    )
    # which states are cloned follows from the layout, whose offsets depend on their number
    cloned = cloned_states(layout, channels, differences, taken.has_lever)
    if len(cloned) != n_clone:
        return state_layout(card, taken, len(cloned))
    clone = delayed + n_delayed - n_clone if n_clone else -1
    return layout._replace(delayed=delayed, n_delayed=n_delayed, clone=clone, cloned=cloned)
