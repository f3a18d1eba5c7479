"""When a sensor measures: its rate, the window that its card states, and the epochs of the filter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.observables.sensor import SensorCard
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.events import resolve
from lvnav_trade.world.faults import ROUNDING


def window(card: SensorCard, events: Mapping[str, float]) -> tuple[float, float]:
    """Return start (included) and end (excluded) of a sensor's measurements, s; infinite where the card states none.

    InputError names an event that the flight does not have.
    """
    start = -np.inf if card.from_ is None else resolve(card.from_, events)
    return float(start), float(np.inf if card.until is None else resolve(card.until, events))


def measures(scenario: Scenario, card: SensorCard, events: Mapping[str, float], t_epoch: Floats) -> NDArray[np.bool_]:
    """Return at which epochs (n_epoch,) s a sensor measures, (n_epoch,) bool.

    Its measurements stand at multiples of its interval since lift-off, on epochs of the filter.
    """
    start, end = window(card, events)
    on: NDArray[np.bool_] = (t_epoch >= start - ROUNDING) & (t_epoch < end - ROUNDING)
    if card.rate is None:
        return on
    every = round(scenario.filter.update_rate / card.rate)
    return on & (np.rint(t_epoch * scenario.filter.update_rate).astype(np.int64) % every == 0)
