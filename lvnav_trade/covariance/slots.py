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
    followed : Whether its cross covariance with the joint states is propagated.
    moves : Whether it drives attitude, velocity or position during propagation.
    samples : Whether it enters IMU samples that are processed as measurements.
    echoes : Whether its noise also enters the states with opposite sign, as a quantisation remainder does.
    """

    source: int
    factor: Floats
    noise: Floats
    start: float
    states: tuple[int, ...] = ()
    followed: bool = False
    moves: bool = False
    samples: bool = False
    echoes: bool = False


def places_of(count: list[int]) -> tuple[Ints, Ints, Ints]:
    """Return group and lane of each source, and the number of slots of each group.

    count : number of components of each source. Sources with many components share groups, so few slots are unused.
    """
    place = np.empty(len(count), dtype=np.int64)
    place[np.argsort(-np.array(count), kind="stable")] = np.arange(len(count))
    group, lane = place // GROUP, place % GROUP
    n_slot = np.zeros(-(-len(count) // GROUP), dtype=np.int64)
    np.maximum.at(n_slot, group, np.array(count))
    return group, lane, n_slot


def as_lanes(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values by source (n_source, ...) as groups of lanes, (n_group, ..., n_lane)."""
    grouped = grouped_zeros((int(group.max()) + 1, *values.shape[1:]))
    grouped[group, ..., lane] = values
    return grouped


def by_length(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values by source and window length (n_source, n_length, ...) as (n_length, n_group, ..., n_lane), aligned
    to a cache line.
    """
    return aligned(np.swapaxes(as_lanes(values, group, lane), 0, 1))


def slot_tables(components: list[Component], n_source: int, n_length: int) -> dict[str, Any]:
    """Return places, flags, decay and noise of all components, by name of the field of `Components`."""
    count, slot = [0] * n_source, list[int]()
    for component in components:
        slot.append(count[component.source])
        count[component.source] += 1
    group, lane, n_slot = places_of(count)
    most = max(1, int(n_slot.max(initial=0)))
    flags, tables = np.zeros((3, n_slot.size, most), dtype=np.bool_), np.zeros((3, n_source, n_length, most, 1))
    for item, k in zip(components, slot, strict=True):
        tables[:, item.source, :, k, 0] = item.factor, item.noise, item.noise * item.echoes
        flags[:, group[item.source], k] |= np.array([item.followed, item.moves, item.samples])
    factor, noise, echo = (by_length(table, group, lane) for table in tables)
    return {
        "group": group,
        "lane": lane,
        "n_slot": n_slot,
        "followed": flags[0],
        "moves": flags[1],
        "samples": flags[2],
        "factor": factor,
        "noise": noise,
        "echo": echo,
        "slot": np.array(slot, dtype=np.int64),
        "source": np.array([item.source for item in components], dtype=np.int64),
        "states": np.array([state for item in components for state in item.states], dtype=np.int64),
        "state_from": np.cumsum([0, *(len(item.states) for item in components)], dtype=np.int64),
        "start": np.array([item.start for item in components], dtype=float),
    }


def aligned(values: Floats) -> Floats:
    """Return a copy of the values that is aligned to a cache line."""
    copy = grouped_zeros(values.shape[:-1])
    copy[:] = values
    return copy
