"""Gain schedules that are computed from a case: the gains that its filter has on the nominal flight, as a card."""

from __future__ import annotations

from typing import Literal

import numpy as np

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.engines.explain import flown_events
from lvnav_trade.engines.lincov import forward_tape
from lvnav_trade.engines.prepare import prepare
from lvnav_trade.engines.truth import source_names, true_model
from lvnav_trade.errors import InputError
from lvnav_trade.filters.scheduled import ROWS, GainSchedule, schedule_of
from lvnav_trade.layout import state_names
from lvnav_trade.observables.sensors import RECEIVER_SOLUTION
from lvnav_trade.scenario import judged, measured
from lvnav_trade.world.flight.trajectory import identity


def gain_schedule(
    campaign: Campaign, case: Case, by: Literal["event", "time"], tolerance: float, name: str = ""
) -> GainSchedule:
    """Return the gains of a case's filter on its nominal flight, as linear covariance finds them, between as few knots
    as a tolerance (of each gain's largest size in the segment) allows.

    InputError for a filter that has no such gains: it takes more or less than the solution of the receiver, or
    solutions with a covariance of their own.
    """
    if set(measured(case.scenario)) != set(RECEIVER_SOLUTION) or judged(case.scenario):
        raise InputError(
            f"case {case.label}: gains are scheduled for measurements: [position, velocity] of a receiver with a "
            "direct solution"
        )
    if not 0.0 < tolerance < 1.0:
        raise InputError(f"a tolerance of {tolerance:g} is no share between 0 and 1")
    prepared = prepare(case.scenario, history=campaign.keep.history)
    tape, n = forward_tape(prepared, true_model(prepared, source_names(prepared))), prepared.layout.n_state
    used = int(tape.used[0])
    gains = np.full((prepared.t_epoch.size, len(ROWS), n), np.nan)
    gains[tape.epoch[:used], tape.channel[:used]] = tape.gain[:used, :n]
    updated = np.all(np.isfinite(gains), axis=(1, 2))
    if not np.any(updated):
        raise InputError(f"case {case.label}: the filter takes no measurement on this flight")
    label = f", {case.label}" if case.axes else ""
    schedule = schedule_of(
        name or f"Gains of {case.scenario.filter.name}, {case.scenario.trajectory.name}, by {by}",
        f"schedule-gains of {campaign.name}{label}: nominal flight, linear to {tolerance:g} between knots",
        by,
        state_names(prepared.layout),
        prepared.t_epoch[updated],
        gains[updated],
        flown_events(prepared),
        tolerance,
    )
    card = case.scenario.trajectory
    return schedule.model_copy(update={"flight": card.name, "flight_digest": identity(card)})
