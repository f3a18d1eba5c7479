"""State layout of a filter, from its card and its measurements."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ImuModel, ReceiverModel
from lvnav_trade.filter.card import BIASES, FilterCard
from lvnav_trade.filter.policies.epoch_differences import cloned_states
from lvnav_trade.filter.rows import NOISE_STATES
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import (
    BY_SATELLITE,
    EXTRAS,
    PARAMETERS,
    RELATIVE,
    ErrorTerm,
    ExtraBlock,
    StateLayout,
)
from lvnav_trade.sensors.receiver_observables import Channels, members, sensor_states

# Time constant (s) of a state that is independent from window to window.
NO_MEMORY = 1e-12


class Taken(NamedTuple):
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


def state_layout(card: FilterCard, taken: Taken, n_clone: int = 0) -> StateLayout:
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
