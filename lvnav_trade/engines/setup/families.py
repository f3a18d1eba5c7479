"""Which errors the measurements of a case share: their causes, sizes, memory, and how each enters every row."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.setup.inputs import Shared
from lvnav_trade.kernels.random import source_word
from lvnav_trade.layout import StateLayout
from lvnav_trade.observables.partials import LEVER_AXES, Channels, Geometry, members, partial
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]

RECORDED = "recorded"  # kind of a family whose component is not drawn: the run's start in a recording sets it


class ErrorFamily(NamedTuple):
    """Random errors of one cause that measurements share.

    source: physical cause; kind of partial; state: extra state of the filter that would stand for it, empty for none;
    labels (n_component,) such as the satellite; member (n_channel,) component in each channel, -1 none; partial
    (n_epoch, n_channel); sigma; time_constant s (inf: constant over the flight, 0: new at every epoch).
    """

    source: str
    kind: str
    state: str
    labels: tuple[str, ...]
    member: Ints
    partial: Floats
    sigma: float
    time_constant: float


class Cause(NamedTuple):
    """A cause as cards state it: source, kind of partial, state, sigma, time constant; systems it is limited to."""

    source: str
    kind: str
    state: str
    sigma: float
    time_constant: float = math.inf
    systems: tuple[str, ...] = ()


def family_of(cause: Cause, geometry: Geometry, channels: Channels) -> ErrorFamily:
    """Return how a cause enters the rows of a case; without labels where it enters none."""
    labels, member = members(cause.kind, channels)
    if cause.systems and channels.tight:
        of_channel = np.repeat([system in cause.systems for system in channels.systems], 2)
        of_channel = np.pad(of_channel, (0, channels.n_channel - of_channel.size))
        member = np.where(of_channel, member, -1)
        kept = sorted(set(member[member >= 0].tolist()))
        labels = tuple(labels[k] for k in kept)
        member = np.array([kept.index(m) if m >= 0 else -1 for m in member.tolist()], dtype=np.int64)
    entering = partial(cause.kind, geometry, channels)
    return ErrorFamily(
        cause.source, cause.kind, cause.state, labels, member, entering, cause.sigma, cause.time_constant
    )  # fmt: skip


def lever_causes(sigma: float) -> Iterator[Cause]:
    """Yield the three body axes of an error of the lever arm."""
    for axis in LEVER_AXES:
        yield Cause("lever arm", axis, "", sigma)


def families_of(causes: list[Cause], geometry: Geometry, channels: Channels) -> tuple[ErrorFamily, ...]:
    """Return the families of causes that are not zero and enter some row."""
    found = (family_of(cause, geometry, channels) for cause in causes if cause.sigma > 0.0)
    return tuple(family for family in found if family.labels)


def _numbers(layout: StateLayout) -> dict[tuple[str, str], int]:
    """Return the number of every extra state by its name and label."""
    names = [(block.name, label) for block in layout.extras for label in block.labels]
    return {name: number for number, name in enumerate(names)}


def shared_of(
    families: tuple[ErrorFamily, ...], layout: StateLayout, interval: float, shape: tuple[int, int]
) -> Shared:
    """Return families in numbers for the kernels.

    Parameters
    ----------
    layout
        The filter's states: an extra block stands for every family that names it.
    interval
        s between epochs.
    shape
        (n_epoch, n_channel).
    """
    n_epoch, n_channel = shape
    member = np.full((len(families), n_channel), -1, dtype=np.int64)
    entering = np.zeros((len(families), n_epoch, n_channel))
    start: list[float] = []
    decay, walk, sources, satellites, extra, given = [], [], [], [], [], []
    number = _numbers(layout)
    for f, family in enumerate(families):
        member[f] = np.where(family.member >= 0, len(start) + family.member, -1)
        entering[f] = family.partial
        factor = math.exp(-interval / family.time_constant) if family.time_constant > 0.0 else 0.0
        for label in family.labels:
            start.append(family.sigma)
            decay.append(factor)
            walk.append(family.sigma * math.sqrt(1.0 - factor * factor))
            sources.append(source_word(f"{family.source} {family.kind}"))
            satellites.append(source_word(label) if label else np.uint64(0))
            extra.append(number.get((family.state, label), -1))
            given.append(family.kind == RECORDED)
    return Shared(
        member=member,
        partial=entering,
        start=np.array(start, dtype=float),
        decay=np.array(decay, dtype=float),
        walk=np.array(walk, dtype=float),
        sources=np.array(sources, dtype=np.uint64),
        satellites=np.array(satellites, dtype=np.uint64),
        extra=np.array(extra, dtype=np.int64),
        given=np.array(given, dtype=np.bool_),
    )
