"""Slots of the error components: each source has a lane of a group, and in it one slot for each component."""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.lanes import GROUP, grouped_zeros
from lvnav_trade.quantities.records import Floats, Ints


class Component(NamedTuple):
    """A scalar error of a source.

    source : Number of the source.
    factor : (n_length,). Decay factor over a window, by window length.
    noise : (n_length,). Variance added by driving noise over a window.
    start : Initial variance.
    states : Filter states that model the component.
    has_cross : Whether its cross covariance with the joint states is propagated.
    drives_motion : Whether it drives attitude, velocity or position during propagation.
    enters_samples : Whether it enters IMU samples that are processed as measurements.
    has_echo : Whether its noise also enters the states with opposite sign, as a quantisation remainder does.
    """

    source: int
    factor: Floats
    noise: Floats
    start: float
    states: tuple[int, ...] = ()
    has_cross: bool = False
    drives_motion: bool = False
    enters_samples: bool = False
    has_echo: bool = False


def assign_lanes(count: list[int]) -> tuple[Ints, Ints, Ints]:
    """Return group and lane of each source, and the number of slots of each group.

    count : number of components of each source. Sources with many components share groups, so few slots are unused.
    """
    n_source = len(count)
    n_component = np.array(count)
    # sources with the most components first: a group has as many slots as its largest source
    order = np.argsort(-n_component, kind="stable")
    place = np.empty(n_source, dtype=np.int64)
    place[order] = np.arange(n_source)
    group = place // GROUP
    lane = place % GROUP
    n_group = -(-n_source // GROUP)  # rounded up
    n_slot = np.zeros(n_group, dtype=np.int64)
    np.maximum.at(n_slot, group, n_component)
    return group, lane, n_slot


def arrange_lanes(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values by source as groups of lanes, (n_group, ..., n_lane).

    Parameters
    ----------
    values
        (n_source, ...).
    group, lane
        (n_source,). As from `assign_lanes`.
    """
    n_group = int(group.max()) + 1
    lane_values = grouped_zeros((n_group, *values.shape[1:]))
    lane_values[group, ..., lane] = values
    return lane_values


def arrange_by_length(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values by source and window length as (n_length, n_group, ..., n_lane), aligned to a cache line.

    Parameters
    ----------
    values
        (n_source, n_length, ...).
    group, lane
        (n_source,). As from `assign_lanes`.
    """
    return align(np.swapaxes(arrange_lanes(values, group, lane), 0, 1))


def slot_tables(components: list[Component], n_source: int, n_length: int) -> dict[str, Any]:
    """Return places, flags, decay and noise of all components, by name of the field of `Components`.

    Parameters
    ----------
    components
        Components of all sources.
    n_source
        Number of sources.
    n_length
        Number of window lengths.
    """
    count = [0] * n_source
    slots = []
    states: list[int] = []
    state_from = [0]
    for component in components:
        source = component.source
        slots.append(count[source])
        count[source] += 1
        states += component.states
        state_from.append(len(states))
    group, lane, n_slot = assign_lanes(count)
    n_group = n_slot.size
    slot_count = max(1, int(n_slot.max(initial=0)))
    has_cross, drives_motion, enters_samples = np.zeros((3, n_group, slot_count), dtype=np.bool_)
    factor, noise, echo = np.zeros((3, n_source, n_length, slot_count, 1))
    for component, slot in zip(components, slots, strict=True):
        source = component.source
        g = group[source]
        factor[source, :, slot, 0] = component.factor
        noise[source, :, slot, 0] = component.noise
        echo[source, :, slot, 0] = component.noise * component.has_echo
        has_cross[g, slot] |= component.has_cross
        drives_motion[g, slot] |= component.drives_motion
        enters_samples[g, slot] |= component.enters_samples
    return {
        "group": group,
        "lane": lane,
        "n_slot": n_slot,
        "has_cross": has_cross,
        "drives_motion": drives_motion,
        "enters_samples": enters_samples,
        "component_decay": arrange_by_length(factor, group, lane),
        "noise": arrange_by_length(noise, group, lane),
        "echo": arrange_by_length(echo, group, lane),
        "slot": np.array(slots, dtype=np.int64),
        "source": np.array([component.source for component in components], dtype=np.int64),
        "states": np.array(states, dtype=np.int64),
        "state_from": np.array(state_from, dtype=np.int64),
        "initial_variance": np.array([component.start for component in components], dtype=float),
    }


def align(values: Floats) -> Floats:
    """Return a copy of the values that is aligned to a cache line."""
    copy = grouped_zeros(values.shape[:-1])
    copy[:] = values
    return copy
