"""What a case provides and its filter does not use, and the reverse: input errors, and warnings where cases differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.checks import span, written
from lvnav_trade.engines.setup.sensors import window
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.layout import EXTRAS
from lvnav_trade.observables.partials import Channels, members
from lvnav_trade.observables.sensors import SENSOR_MEASUREMENTS
from lvnav_trade.scenario import Scenario, measured
from lvnav_trade.world.flight.trajectory import identity
from lvnav_trade.world.sky.satellites import satellites


def mistakes(campaign: Campaign, cases: Sequence[Case], events: Mapping[str, Mapping[str, float]]) -> list[Mistake]:
    """Return sensors, measurements and states without effect, and sensors that measure outside the flight.

    `events` holds for each case digest the times (s) of its trajectory's events.
    """
    found = [
        *chain.from_iterable(_states(campaign, case) for case in cases),
        *chain.from_iterable(_windows(campaign, case, events[case.id]) for case in cases),
        *_unused(campaign, cases),
        *_missing(campaign, cases),
    ]
    return list(dict.fromkeys(found))


def warnings(cases: Sequence[Case]) -> list[str]:
    """Return a line for each sensor that some cases use and others do not, and for gains of another flight."""
    found = []
    for name in _sensors(cases):
        using, idle = _using(cases, name)
        if using and idle:
            labels = "; ".join(case.label for case in idle)
            found.append(f"sensors.{name}: no measurement of the filter uses it in {labels}")
    for case in cases:
        line = _other_flight(case.scenario)
        if line:
            found.append(f"{case.label}: {line}")
    return found


def _other_flight(scenario: Scenario) -> str:
    """Say that stored gains are of another flight, where they are, or that their card does not say of which."""
    gains = scenario.filter.gains
    if gains is None or gains.flight_digest == identity(scenario.trajectory):
        return ""
    if not gains.flight_digest:
        return f"filter.gains: {gains.name!r} does not say for which flight it was computed"
    name = scenario.trajectory.name
    here = f"{name!r}{' with other numbers' if name == gains.flight else ''}"
    return f"filter.gains: computed for the flight {gains.flight!r}, used on {here}"


def _sensors(cases: Sequence[Case]) -> list[str]:
    return list(dict.fromkeys(name for case in cases for name in case.scenario.sensors))


def _using(cases: Sequence[Case], name: str) -> tuple[list[Case], list[Case]]:
    """Return the cases with this sensor that use it, and those that do not; a vehicle under control uses attitude."""
    using: list[Case] = []
    idle: list[Case] = []
    for case in cases:
        card = case.scenario.sensors.get(name)
        if card is not None:
            steered = card.measurement == "attitude" and case.scenario.control is not None
            used = steered or card.measurement in case.scenario.filter.measurements
            (using if used else idle).append(case)
    return using, idle


def _unused(campaign: Campaign, cases: Sequence[Case]) -> Iterator[Mistake]:
    """Yield the sensors that no case uses."""
    for name in _sensors(cases):
        using, idle = _using(cases, name)
        if idle and not using:
            card = idle[0].scenario.sensors[name]
            assert card is not None
            message = f"no effect: {card.measurement} is not among the measurements of any filter"
            yield written(campaign, idle[0], f"base.sensors.{name}", message)


def _missing(campaign: Campaign, cases: Sequence[Case]) -> Iterator[Mistake]:
    """Yield the measurements whose sensor is null in every case."""
    for name in SENSOR_MEASUREMENTS:
        listing = [case for case in cases if name in case.scenario.filter.measurements]
        if listing and not any(name in measured(case.scenario) for case in listing):
            message = f"no sensor of the scenario measures {name} in any case"
            yield written(campaign, listing[0], "base.filter.measurements", message)


def _states(campaign: Campaign, case: Case) -> Iterator[Mistake]:
    """Yield the extra states that no measurement of the filter depends on."""
    card = case.scenario.filter
    if not any(name in EXTRAS for name in (*card.extra_states, *card.consider)):
        return
    known = satellites(case.scenario.constellation, case.scenario.trajectory.epoch)
    channels = Channels(card.tight, known.names, known.systems, (True,) * len(known.names))
    for field in ("extra_states", "consider"):
        for name in getattr(card, field):
            receiver = card.tight or card.loose
            if name in EXTRAS and not (receiver and members(name, channels)[0]):
                message = f"{name}: no measurement of the filter depends on it"
                yield written(campaign, case, f"base.filter.{field}", message)


def _windows(campaign: Campaign, case: Case, events: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield the sensors whose window names no event of the flight, or lies outside it."""
    first, last = span(case.scenario, events)
    for name, card in case.scenario.sensors.items():
        if card is None:
            continue
        path = f"base.sensors.{name}.{'until' if card.from_ is None else 'from'}"
        try:
            start, end = window(card, events)
        except InputError as error:
            yield written(campaign, case, path, error.records[0].message)
            continue
        if max(start, first) >= min(end, last):
            message = f"it does not measure within the flight ({first:g} s to {last:g} s)"
            yield written(campaign, case, path, message)
