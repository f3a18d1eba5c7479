"""Observables of satellites beside pseudorange and range rate: carrier phases, and differences of two epochs."""

import numpy as np

from lvnav_trade.engines.setup.families import ErrorFamily
from lvnav_trade.engines.setup.inputs import Further, Signals
from lvnav_trade.engines.setup.receiver.noise import assumed_sigma
from lvnav_trade.engines.setup.receiver.signals import Line, hold
from lvnav_trade.filters.base import ReceiverModel
from lvnav_trade.filters.delayed import Delayed
from lvnav_trade.filters.model import FilterModel
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.random import source_word
from lvnav_trade.layout import StateLayout
from lvnav_trade.observables.base import D_EXTRA
from lvnav_trade.observables.partials import DIFFERENCES, OF_ONE, PHASES, Channels
from lvnav_trade.records import Bools, Floats, Sky
from lvnav_trade.scenario import Scenario
from lvnav_trade.sources import PHASE_NOISE

L1 = 1.57542e9  # Hz; of a receiver without a link


def wavelength(scenario: Scenario) -> float:
    """Return the wavelength of the carrier (m): of the link, else L1."""
    link = scenario.receiver.link
    return SPEED_OF_LIGHT / L1 if link is None else link.wavelength


def linked(seen: Sky, signals: Signals) -> tuple[Bools, Bools, Bools]:
    """Return whether a satellite begins a new phase; whether it was measured at the epoch before too; and whether its
    phase went on since then, (n_epoch, n_sat) each.

    A new phase begins where a carrier was not followed since the satellite was last used. An output that stands still
    repeats itself.
    """
    shape = seen.tracked.shape
    restart, before, going_on = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    broken, last = np.ones(shape[1], np.bool_), np.zeros(shape[1], np.bool_)
    for epoch in range(shape[0]):
        broken |= ~seen.continuous[epoch]
        use = np.zeros(shape[1], np.bool_)
        use[signals.used[epoch, : signals.n_used[epoch]]] = True
        still = bool(signals.frozen[epoch])
        restart[epoch], before[epoch] = use & broken & (not still), use & last
        going_on[epoch] = use & last & (~broken | still)
        broken &= ~use | still
        last = use
    return restart, before, going_on


def further_of(
    scenario: Scenario, seen: Sky, signals: Signals, families: tuple[ErrorFamily, ...], channels: Channels,
    left: Floats, slip: Floats,
) -> Further | None:  # fmt: skip
    """Return what is true of further observables, None without any.

    left (n_epoch, n_sat) m that is wrong with a carrier phase in every run, slip (n_epoch, n_sat) cycles.
    """
    if not channels.further:
        return None
    ambiguity = np.full(len(seen.names), -1, dtype=np.int64)
    first = 0
    for family in families:
        if family.kind == "ambiguity":
            for k, label in enumerate(family.labels):
                ambiguity[seen.names.index(label)] = first + k
        first += len(family.labels)
    phase = np.asarray(left + wavelength(scenario) * slip)
    hold(signals.frozen, phase)
    return Further(
        phase=phase,
        is_phase=np.array([name in PHASES for name in channels.observables]),
        is_difference=np.array([name in DIFFERENCES for name in channels.observables]),
        restart=linked(seen, signals)[0],
        ambiguity=ambiguity,
        source=source_word(PHASE_NOISE),
    )


def delayed_of(
    scenario: Scenario, model: ReceiverModel, seen: Sky, line: Line, signals: Signals, layout: StateLayout,
    numbers: FilterModel, channels: Channels,
) -> Delayed | None:  # fmt: skip
    """Return how the filter processes further observables, None without any; model: what it assumes of the receiver."""
    if not channels.further:
        return None
    n_epoch = len(seen.tracked)
    restart, before, going_on = linked(seen, signals)
    present = np.ones((n_epoch, channels.n_receiver), dtype=np.bool_)
    for name in DIFFERENCES:
        if name in channels.further:
            present[:, channels.of(name)] = going_on if name in PHASES else before
    renewed = np.full((n_epoch, max(1, numbers.extra_offset.size)), -1.0)
    first = 0
    for block in layout.extras:
        if block.name in OF_ONE:
            own = np.array([seen.names.index(label) for label in block.labels], dtype=np.int64)
            anew = renewed[:, first : first + own.size]
            if block.name == "ambiguity":
                anew[:] = np.where(restart[:, own], model.ambiguity**2, -1.0)
            else:
                anew[:] = assumed_sigma(scenario, model, seen, line, OF_ONE[block.name])[:, own] ** 2
        first += len(block.labels)
    return Delayed(
        difference=np.array([name in DIFFERENCES for name in channels.observables]),
        present=present,
        earlier=numbers.entry.shape[1] - D_EXTRA - len(layout.extras),
        renewed=renewed,
        cloned=np.array(layout.cloned, dtype=np.int64),
        clone=layout.clone,
        back=bool(layout.cloned) and scenario.filter.delayed_state == "back_propagated",
    )
