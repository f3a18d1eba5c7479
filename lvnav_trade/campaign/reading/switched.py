"""Check of conditions (of faults, sensors, filter tuning) against the trajectories: conditions that are never met."""

from collections.abc import Iterator, Mapping

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, ImuFault, JumpFault
from lvnav_trade.gnss.faults import periods
from lvnav_trade.imu.array import excludes_units
from lvnav_trade.quantities.conditions import BOUNDS, Conditions, FlightProfile, inside, never
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.sensor import SensorCard
from lvnav_trade.simulation.preparation.cache import seen_in, trajectory_of
from lvnav_trade.simulation.preparation.sensors import view_of

_BRIEF = 5.0
"""Longest duration (s) of an IMU fault that `filter.integrity` corrects as a brief failure."""
Found = Iterator[tuple[str, str]]
"""Field and message of each input error."""


def of_sensor(card: SensorCard, scenario: Scenario, events: Mapping[str, float]) -> Found:
    """Yield the conditions of a sensor that name an unknown event or are never met; events: times (s) by name."""
    course = _course(card, scenario, events)
    errors = list(_never(card, course))
    yield from errors
    if not errors and type(card).available is not SensorCard.available:
        yield from _unable(card, scenario)


def _unable(card: SensorCard, scenario: Scenario) -> Found:
    """Yield the setting that prevents a sensor from measuring whenever its conditions are met."""
    flight = trajectory_of(scenario)
    t = np.arange(flight.start, flight.end, 1.0 / (card.rate or scenario.filter.update_rate))
    if not np.any(inside(flight.course.holding(card), t) & card.available(view_of(flight, t))):
        yield card.limiting, f"{card.able} at no time of the flight while its conditions hold"


def of_fault(fault: AnyFault, scenario: Scenario, events: Mapping[str, float]) -> Found:
    """Yield the times and conditions by which a fault is never active; events: times (s) by name."""
    course = _course(fault, scenario, events)
    conditions = list(_never(fault, course))
    yield from conditions
    if fault.start is not None and not conditions:
        yield from _timed(fault, fault.start, course)


def of_imu(scenario: Scenario, events: Mapping[str, float]) -> Found:
    """Yield that the hand-over of a prime IMU is at no time of the flight; events: times (s)."""
    text = getattr(scenario.imu, "hand_over", None)
    if text is None:
        return
    card = scenario.trajectory
    first, last = min(events.values()) - card.pad_hold, max(events.values()) + card.coast_after_injection
    try:
        at = FlightProfile({"start": first, "end": last, **events}).time(text, "hand_over")
        if not first < at < last:
            yield "hand_over", f"{text!r} is {at:g} s: outside the flight, from {first:g} s to {last:g} s"
    except InputError as error:
        yield "hand_over", error.records[0].message


def unprotected(scenario: Scenario) -> str:
    """Return a warning if the filter tests innovations and an IMU fault persists without exclusion; else empty.

    Such tests attribute a brief IMU fault correctly. A persistent fault makes the attitude drift.
    """
    if scenario.filter.integrity is None or excludes_units(scenario.imu):
        return ""
    course = trajectory_of(scenario).course
    lasting = [
        f"faults.{number} ({fault.kind})"
        for number, fault in enumerate(scenario.faults)
        if isinstance(fault, ImuFault)
        and any(
            min(end, course.instants["end"]) - course.begin(start) > _BRIEF
            for start, end in periods(number, fault, course)
        )
    ]
    if not lasting:
        return ""
    return (
        f"filter.integrity: {', '.join(lasting)} persists and nothing excludes the IMU; tests of innovations keep "
        "position and velocity with the receiver, but attitude drifts: give three IMUs with imu.parity, or "
        "imu.selection: mid_value"
    )


def unreceived(scenario: Scenario) -> Iterator[tuple[int, str, bool]]:
    """Yield, for each satellite named by a fault, whether the fault never affects it.

    Yields
    ------
    int, str, bool
        Number of the fault (from 0), name of the satellite, and whether the receiver never tracks the satellite while
        the fault is active.
    """
    naming = [(number, fault) for number, fault in enumerate(scenario.faults) if getattr(fault, "satellites", ())]
    if not naming:
        return
    flight = trajectory_of(scenario)
    t = np.arange(flight.start, flight.end, 1.0 / scenario.filter.update_rate)
    seen = seen_in(scenario, flight, t, flight.start)
    for number, fault in naming:
        active = periods(number, fault, flight.course)
        within = inside(active, t)
        if isinstance(fault, JumpFault):  # it has no duration: it acts at the first epoch at or after its time
            within[[min(int(np.searchsorted(t, start)), t.size - 1) for start, _ in active]] = True
        for name in getattr(fault, "satellites", ()):
            yield number, name, not np.any(seen.tracked[within, seen.names.index(name)])


def of_filter(scenario: Scenario, events: Mapping[str, float]) -> Found:
    """Yield the conditions of a filter's tuning that are never met; events: times (s) by name."""
    for name in ("underweighting", "region_noise"):
        for number, card in enumerate(getattr(scenario.filter, name)):
            for field, message in _never(card, _course(card, scenario, events)):
                yield f"{name}.{number}.{field}", message


def _course(conditions: Conditions, scenario: Scenario, events: Mapping[str, float]) -> FlightProfile:
    """Return the course for evaluating conditions: from the trajectory if they need it, otherwise from the events.

    Building the trajectory takes time, and most conditions refer to events alone.
    """
    if any(name in BOUNDS for name in conditions.stated):
        return trajectory_of(scenario).course
    card = scenario.trajectory
    first, last = min(events.values()) - card.pad_hold, max(events.values()) + card.coast_after_injection
    return FlightProfile({"start": first, "end": last, **events})


def _never(conditions: Conditions, course: FlightProfile) -> Found:
    try:
        unmet = never(conditions, course)
    except InputError as error:
        unmet = error.records[0]
    if unmet is not None:
        yield unmet.path, unmet.message


def _timed(fault: AnyFault, text: str, course: FlightProfile) -> Found:
    first, last = course.instants["start"], course.instants["end"]
    try:
        start = course.time(text, "start")
        if start >= last:
            yield "start", f"{text!r} is {start:g} s, at or after the end of the flight ({last:g} s)"
        elif start + (fault.duration or 0.0) < first:
            yield "start", f"{text!r} is {start:g} s: the fault is over before the flight begins ({first:g} s)"
        elif not periods(0, fault, course):
            yield fault.stated[0], "holds at no time between the start of the fault and its end"
    except InputError as error:
        yield "start", error.records[0].message
