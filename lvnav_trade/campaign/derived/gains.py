"""Gain schedules that are computed from a case: the gains that its filter has on the nominal flight, as a card."""

from __future__ import annotations

from typing import Literal

import numpy as np

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.engines.analysis.explain import flown_events
from lvnav_trade.engines.lincov.components import components
from lvnav_trade.engines.lincov.history import forward_tape
from lvnav_trade.engines.lincov.sources import source_names
from lvnav_trade.engines.setup.prepare import prepare
from lvnav_trade.errors import InputError
from lvnav_trade.filters.scheduled import GainSchedule, schedule_of
from lvnav_trade.layout import state_names
from lvnav_trade.scenario import has_covariance
from lvnav_trade.world.flight.trajectory import identity


def gain_schedule(
    campaign: Campaign, case: Case, by: Literal["event", "time"], tolerance: float, name: str = ""
) -> GainSchedule:
    """Return the gains of a case's filter on its nominal flight, as linear covariance finds them, between as few knots
    as a tolerance (of each gain's largest size in the segment) allows.

    InputError for a filter without measurements, or with solutions whose own covariance decides the gains.
    """
    if has_covariance(case.scenario):
        raise InputError(f"case {case.label}: the covariance that comes with each solution decides the gains")
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance of {tolerance:g} is no share between 0 and 1")
    prepared = prepare(case.scenario, history=campaign.keep.history)
    tape, n = forward_tape(prepared, components(prepared, source_names(prepared))), prepared.layout.n_state
    used = int(tape.used[0])
    names = prepared.channels.names
    gains, updated = np.zeros((prepared.t_epoch.size, len(names), n)), np.zeros(prepared.t_epoch.size, dtype=np.bool_)
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    updated[tape.epoch[:used]] = True
    taken = np.unique(tape.channel[:used])
    if not np.any(updated):
        raise InputError(f"case {case.label}: the filter takes no measurement on this flight")
    label = f", {case.label}" if case.axes else ""
    schedule = schedule_of(
        name or f"Gains of {case.scenario.filter.name}, {case.scenario.trajectory.name}, by {by}",
        f"schedule-gains of {campaign.name}{label}: nominal flight, linear to {tolerance:g} between knots",
        by,
        state_names(prepared.layout),
        prepared.t_epoch[updated],
        gains[updated][:, taken],
        flown_events(prepared),
        tolerance,
        measurements=[names[channel] for channel in taken],
    )
    card = case.scenario.trajectory
    return schedule.model_copy(update={"flight": card.name, "flight_digest": identity(card)})
