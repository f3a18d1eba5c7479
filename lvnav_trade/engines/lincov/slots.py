"""Slots of the error components: a source owns a lane of a group and in it one slot for each of its components."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.groups import GROUP, grouped_zeros
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]


class Slot(NamedTuple):
    """A component of a source: decay and driving variance (n_length,), variance at the start; see Components."""

    source: int
    slot: int
    factor: Floats
    noise: Floats
    start: float
    followed: bool = False
    moves: bool = False
    samples: bool = False
    echoes: bool = False


class Slots:
    """Slots of the sources' lanes while they are given out."""

    def __init__(self, n_source: int, seconds: Floats) -> None:
        self.seconds, self.count = seconds, [0] * n_source
        self.entries: list[Slot] = []

    def take(self, source: int, factor: Floats, noise: Floats, start: float, **flags: bool) -> int:
        """Return the slot of a new component of a source; flags as of `Slot`."""
        slot = self.count[source]
        self.count[source] += 1
        self.entries.append(Slot(source, slot, factor, noise, start, **flags))
        return slot


def places_of(count: list[int]) -> tuple[Ints, Ints, Ints]:
    """Return group and lane of every source and the slots of every group; sources of many components stand together."""
    order = np.argsort(-np.array(count), kind="stable")
    place = np.empty(len(count), dtype=np.int64)
    place[order] = np.arange(len(count))
    group, lane = place // GROUP, place % GROUP
    n_slot = np.zeros(-(-len(count) // GROUP), dtype=np.int64)
    np.maximum.at(n_slot, group, np.array(count))
    return group, lane, n_slot


def as_lanes(values: Floats, group: Ints, lane: Ints) -> Floats:
    """Return values of sources (n_source, ...) in groups, (n_group, ..., n_lane)."""
    found = grouped_zeros((int(group.max()) + 1, *values.shape[1:]))
    found[group, ..., lane] = values
    return found


def slot_tables(slots: Slots, group: Ints, lane: Ints, n_slot: Ints) -> dict[str, Any]:
    """Return flags, decay, noise and start of all slots, by the names of Components' fields."""
    n_length, n_source = slots.seconds.size, len(slots.count)
    most = max(1, int(n_slot.max(initial=0)))
    factor, noise, echo = (np.zeros((n_source, n_length, most, 1)) for _ in range(3))
    start = np.zeros((n_source, most))
    followed, moves, samples = (np.zeros((n_slot.size, most), dtype=np.bool_) for _ in range(3))
    for one in slots.entries:
        at = (one.source, slice(None), one.slot, 0)
        factor[at], noise[at], start[one.source, one.slot] = one.factor, one.noise, one.start
        echo[at] = one.noise if one.echoes else 0.0
        place = (group[one.source], one.slot)
        followed[place] |= one.followed
        moves[place] |= one.moves
        samples[place] |= one.samples

    def by_length(values: Floats) -> Floats:
        lanes = as_lanes(values, group, lane)  # (n_group, n_length, n_slot, 1, n_lane)
        return aligned(np.swapaxes(lanes, 0, 1))

    return {
        "followed": followed, "moves": moves, "samples": samples, "start": start,
        "factor": by_length(factor), "noise": by_length(noise), "echo": by_length(echo),
    }  # fmt: skip


def aligned(values: Floats) -> Floats:
    """Return the same values in an array that begins where a cache line does."""
    found = grouped_zeros(values.shape[:-1])
    found[:] = values
    return found
