"""Which errors the measurements of a case share: their causes, sizes, memory, and how each enters every row."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.setup.inputs import Shared
from lvnav_trade.kernels.random import source_word
from lvnav_trade.layout import StateLayout, standing_for
from lvnav_trade.observables.partials import PHASES, Channels, Geometry, members, partial
from lvnav_trade.records import Floats, Ints

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
    """A cause as cards state it: source, kind of partial, state, sigma, time constant; systems it is limited to;
    of_code: it is not in the carrier's phase.
    """

    source: str
    kind: str
    state: str
    sigma: float
    time_constant: float = math.inf
    systems: tuple[str, ...] = ()
    of_code: bool = False


def family_of(cause: Cause, geometry: Geometry, channels: Channels) -> ErrorFamily:
    """Return how a cause enters the rows of a case; without labels where it enters none."""
    labels, member = members(cause.kind, channels)
    if cause.systems and channels.tight:
        of_channel = np.repeat([system in cause.systems for system in channels.systems], len(channels.observables))
        of_channel = np.pad(of_channel, (0, channels.n_channel - of_channel.size))
        member = np.where(of_channel, member, -1)
        kept = sorted(set(member[member >= 0].tolist()))
        labels = tuple(labels[k] for k in kept)
        member = np.array([kept.index(m) if m >= 0 else -1 for m in member.tolist()], dtype=np.int64)
    entering = partial(cause.kind, geometry, channels)
    for phase in PHASES if cause.of_code else ():
        if phase in channels.further:
            entering[:, channels.of(phase)] = 0.0
    return ErrorFamily(
        cause.source, cause.kind, cause.state, labels, member, entering, cause.sigma, cause.time_constant
    )  # fmt: skip


def families_of(causes: list[Cause], geometry: Geometry, channels: Channels) -> tuple[ErrorFamily, ...]:
    """Return the families of causes that are not zero and enter some row."""
    found = (family_of(cause, geometry, channels) for cause in causes if cause.sigma > 0.0)
    return tuple(family for family in found if family.labels)


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
    n_channel = shape[1]
    labelled = [(family, label) for family in families for label in family.labels]
    stand = [[number for _, number in standing_for(layout.extras, family.state, label)] for family, label in labelled]
    counts = np.array([len(family.labels) for family in families], dtype=np.int64)
    first = np.cumsum(counts) - counts
    sigma = np.array([family.sigma for family in families], dtype=float)
    times = [family.time_constant for family in families]
    factor = np.array([math.exp(-interval / time) if time > 0.0 else 0.0 for time in times], dtype=float)
    return Shared(
        member=np.array(
            [np.where(family.member >= 0, at + family.member, -1) for family, at in zip(families, first, strict=True)],
            dtype=np.int64,
        ).reshape(-1, n_channel),
        partial=np.array([np.broadcast_to(family.partial, shape) for family in families]).reshape(-1, *shape),
        start=np.repeat(sigma, counts),
        decay=np.repeat(factor, counts),
        walk=np.repeat(sigma * np.sqrt(1.0 - factor * factor), counts),
        sources=np.array([source_word(f"{family.source} {family.kind}") for family, _ in labelled], dtype=np.uint64),
        satellites=np.array([source_word(label) if label else 0 for _, label in labelled], dtype=np.uint64),
        extra=np.array([found[0] if found else -1 for found in stand], dtype=np.int64),
        error_of=np.array([m for m, found in enumerate(stand) for _ in found], dtype=np.int64),
        state_of=np.array([number for found in stand for number in found], dtype=np.int64),
        given=np.array([family.kind == RECORDED for family, _ in labelled], dtype=np.bool_),
    )
