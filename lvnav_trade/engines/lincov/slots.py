"""Slots of the error components: a source owns a lane of a group and in it one slot for each of its components."""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.kernels.groups import GROUP, grouped_zeros
from lvnav_trade.records import Floats, Ints


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
    """Return group and lane of every source and the slots of every group; sources of many components stand together."""
    place = np.empty(len(count), dtype=np.int64)
    place[np.argsort(-np.array(count), kind="stable")] = np.arange(len(count))
    group, lane = place // GROUP, place % GROUP
    n_slot = np.zeros(-(-len(count) // GROUP), dtype=np.int64)
    np.maximum.at(n_slot, group, np.array(count))
    return group, lane, n_slot


def as_lanes(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values of sources (n_source, ...) in groups, (n_group, ..., n_lane)."""
    found = grouped_zeros((int(group.max()) + 1, *values.shape[1:]))
    found[group, ..., lane] = values
    return found


def by_length(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values of sources by window length (n_source, n_length, ...) as (n_length, n_group, ..., n_lane), from the
    start of a cache line on.
    """
    return aligned(np.swapaxes(as_lanes(values, group, lane), 0, 1))


def slot_tables(components: list[Component], n_source: int, n_length: int) -> dict[str, Any]:
    """Return places, flags, decay and noise of all components, by the names of Components' fields."""
    count, slot = [0] * n_source, list[int]()
    for one in components:
        slot.append(count[one.source])
        count[one.source] += 1
    group, lane, n_slot = places_of(count)
    most = max(1, int(n_slot.max(initial=0)))
    flags, tables = np.zeros((3, n_slot.size, most), dtype=np.bool_), np.zeros((3, n_source, n_length, most, 1))
    for one, k in zip(components, slot, strict=True):
        tables[:, one.source, :, k, 0] = one.factor, one.noise, one.noise * one.echoes
        flags[:, group[one.source], k] |= np.array([one.followed, one.moves, one.samples])
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
        "source": np.array([one.source for one in components], dtype=np.int64),
        "states": np.array([state for one in components for state in one.states], dtype=np.int64),
        "state_from": np.cumsum([0, *(len(one.states) for one in components)], dtype=np.int64),
        "start": np.array([one.start for one in components], dtype=float),
    }


def aligned(values: Floats) -> Floats:
    """Return the same values in an array that begins where a cache line does."""
    found = grouped_zeros(values.shape[:-1])
    found[:] = values
    return found
