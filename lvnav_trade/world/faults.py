"""Faults that a campaign names: what fails, when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lvnav_trade.errors import InputError
from lvnav_trade.records import Floats
from lvnav_trade.units import Card, Pause
from lvnav_trade.world.events import resolve

Mask = NDArray[np.bool_]

ROUNDING = 1e-6  # s; an epoch that rounding has moved by less still lies on the fault's edge


class SatelliteOutage(Card):
    """All satellites lost, or all but `keep` (the highest at the start of the outage)."""

    kind: Literal["satellite_outage"] = "satellite_outage"
    start: str = Field(description="time such as '100 s', or relative to an event: 'stage1_cutoff + 20 s'")
    duration: Pause
    keep: int = Field(0, ge=0)


def lost(
    faults: Sequence[SatelliteOutage], events: dict[str, float], t: Floats, elevation: Floats, visible: Mask
) -> Mask:
    """Return which satellites the faults take away, (n_epoch, n_sat) bool.

    Parameters
    ----------
    faults
        Each holds from its start (included) to its end (excluded); where several hold, each takes its share.
    events
        Event times of the flight (s), that a fault's start may refer to.
    t
        (n_epoch,) s, rising.
    elevation, visible
        (n_epoch, n_sat) rad; and whether the satellite could be tracked without any fault.

    Raises
    ------
    InputError
        Where a start cannot be resolved, or the fault lies wholly before or after the epochs.
    """
    gone = np.zeros_like(visible)
    for number, fault in enumerate(faults):
        start = _start(number, fault, events)
        within = (t >= start - ROUNDING) & (t < start + fault.duration - ROUNDING)
        if np.any(within):
            first = int(np.argmax(within))
            gone |= within[:, None] & ~highest(elevation[first], visible[first], fault.keep)
        elif t.size and (start + fault.duration < t[0] or t[-1] < start):
            raise InputError(
                f"faults[{number}]: the outage from {start:g} s to {start + fault.duration:g} s "
                f"lies outside the flight ({t[0]:g} s to {t[-1]:g} s)"
            )
    return gone


def _start(number: int, fault: SatelliteOutage, events: dict[str, float]) -> float:
    try:
        return float(resolve(fault.start, events))
    except InputError as error:
        raise InputError(f"faults[{number}].start: {error}") from None


def highest(elevation: Floats, candidates: Mask, count: int) -> Any:
    """Return which of the candidates are the `count` highest, along the last axis; equal heights keep their order.

    elevation (..., n_sat) rad; candidates (..., n_sat) bool; all candidates where they are no more than `count`.
    """
    order = np.argsort(np.where(candidates, -elevation, np.inf), axis=-1, kind="stable")
    rank = np.argsort(order, axis=-1, kind="stable")
    return candidates & (rank < count)
