"""Structure of the Jacobian: measurement type of each channel, and the state of each entry that is not zero."""

import numpy as np

from lvnav_trade.filter.policies.epoch_differences import earlier_entries
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.sensors.family import SENSOR_MEASUREMENTS, SENSORS
from lvnav_trade.sensors.jacobian_row import D_EXTRA, H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, Channels

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
