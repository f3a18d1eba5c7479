"""Check of conditions (of faults, sensors, filter tuning) against the trajectories: conditions that are never met."""

from collections.abc import Iterator, Mapping

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, ImuFault, JumpFault
from lvnav_trade.gnss.faults import periods
from lvnav_trade.imu.array import excludes_units
from lvnav_trade.quantities.conditions import BOUNDS, Conditions, FlightProfile, is_inside, never_active_mistake
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.sensor import SensorCard
from lvnav_trade.simulation.preparation.cache import cached_sky, trajectory_of
from lvnav_trade.simulation.preparation.sensors import flight_view

_BRIEF_DURATION = 5.0
"""Longest duration (s) of an IMU fault that `filter.integrity` corrects as a brief failure."""
FieldErrors = Iterator[tuple[str, str]]
"""Field and message of each input error."""


def sensor_errors(card: SensorCard, scenario: Scenario, events: Mapping[str, float]) -> FieldErrors:
    """Yield the conditions of a sensor that name an unknown event or are never met.

    Parameters
    ----------
    card : SensorCard
        Card of the sensor.
    scenario : Scenario
        Scenario with the trajectory.
    events : mapping of str to float
        Times (s) of the events by name.
    """
    profile = _profile(card, scenario, events)
    errors = list(_condition_errors(card, profile))
    yield from errors
    if not errors and type(card).is_available is not SensorCard.is_available:
        yield from _capability_errors(card, scenario)


def _capability_errors(card: SensorCard, scenario: Scenario) -> FieldErrors:
    """Yield the setting that prevents a sensor from measuring whenever its conditions are met."""
    flight = trajectory_of(scenario)
    t = np.arange(flight.start, flight.end, 1.0 / (card.rate or scenario.filter.update_rate))
    conditions_met = is_inside(flight.flight_profile.active_intervals(card), t)
    if not np.any(conditions_met & card.is_available(flight_view(flight, t))):
        yield card.limiting_field, f"{card.availability_phrase} at no time of the flight while its conditions hold"


def fault_errors(fault: AnyFault, scenario: Scenario, events: Mapping[str, float]) -> FieldErrors:
    """Yield the times and conditions by which a fault is never active.

    Parameters
    ----------
    fault : AnyFault
        The fault.
    scenario : Scenario
        Scenario with the trajectory.
    events : mapping of str to float
        Times (s) of the events by name.
    """
    profile = _profile(fault, scenario, events)
    errors = list(_condition_errors(fault, profile))
    yield from errors
    if fault.start is not None and not errors:
        yield from _inactivity_errors(fault, fault.start, profile)


def imu_errors(scenario: Scenario, events: Mapping[str, float]) -> FieldErrors:
    """Yield an input error if the hand-over of a prime IMU is not during the flight; events: times (s) by name."""
    text = getattr(scenario.imu, "hand_over", None)
    if text is None:
        return
    first, last = _flight_ends(scenario, events)
    try:
        t = FlightProfile({"start": first, "end": last, **events}).time(text, "hand_over")
        if not first < t < last:
            yield "hand_over", f"{text!r} is {t:g} s: outside the flight, from {first:g} s to {last:g} s"
    except InputError as error:
        yield "hand_over", error.records[0].message


def unprotected_imu_warning(scenario: Scenario) -> str:
    """Return a warning if the filter tests innovations and an IMU fault persists without exclusion; else empty.

    Such tests attribute a brief IMU fault correctly. A persistent fault makes the attitude drift.
    """
    if scenario.filter.integrity is None or excludes_units(scenario.imu):
        return ""
    profile = trajectory_of(scenario).flight_profile
    persistent_faults = []
    for number, fault in enumerate(scenario.faults):
        if not isinstance(fault, ImuFault):
            continue
        for start, end in periods(number, fault, profile):
            last = min(end, profile.instants["end"])
            duration = last - profile.begin(start)
            if duration > _BRIEF_DURATION:
                persistent_faults.append(f"faults.{number} ({fault.kind})")
                break
    if not persistent_faults:
        return ""
    return (
        f"filter.integrity: {', '.join(persistent_faults)} persists and nothing excludes the IMU; "
        "tests of innovations keep position and velocity with the receiver, but attitude drifts: give three IMUs with "
        "imu.parity, or imu.selection: mid_value"
    )


def satellite_fault_effects(scenario: Scenario) -> Iterator[tuple[int, str, bool]]:
    """Yield, for each satellite named by a fault, whether the fault never affects it.

    Yields
    ------
    int, str, bool
        Number of the fault (from 0), name of the satellite, and whether the receiver never tracks the satellite while
        the fault is active.
    """
    faults = [(number, fault) for number, fault in enumerate(scenario.faults) if getattr(fault, "satellites", ())]
    if not faults:
        return
    flight = trajectory_of(scenario)
    t = np.arange(flight.start, flight.end, 1.0 / scenario.filter.update_rate)
    sky = cached_sky(scenario, flight, t, flight.start)
    for number, fault in faults:
        active_periods = periods(number, fault, flight.flight_profile)
        is_active = is_inside(active_periods, t)
        if isinstance(fault, JumpFault):  # it has no duration: it acts at the first epoch at or after its time
            for start, _ in active_periods:
                epoch = int(np.searchsorted(t, start))
                is_active[min(epoch, t.size - 1)] = True
        for name in getattr(fault, "satellites", ()):
            satellite = sky.names.index(name)
            is_tracked = sky.is_tracked[is_active, satellite]
            yield number, name, not np.any(is_tracked)


def filter_errors(scenario: Scenario, events: Mapping[str, float]) -> FieldErrors:
    """Yield the conditions of a filter's tuning that are never met; events: times (s) by name."""
    for name in ("underweighting", "region_noise"):
        for number, card in enumerate(getattr(scenario.filter, name)):
            profile = _profile(card, scenario, events)
            for field, message in _condition_errors(card, profile):
                yield f"{name}.{number}.{field}", message


def _profile(conditions: Conditions, scenario: Scenario, events: Mapping[str, float]) -> FlightProfile:
    """Return the profile for evaluating conditions: from the trajectory if they need it, otherwise from the events.

    Building the trajectory takes time, and most conditions refer to events alone.
    """
    if any(name in BOUNDS for name in conditions.condition_keys):
        return trajectory_of(scenario).flight_profile
    start, end = _flight_ends(scenario, events)
    return FlightProfile({"start": start, "end": end, **events})


def _flight_ends(scenario: Scenario, events: Mapping[str, float]) -> tuple[float, float]:
    """Return the start and the end (s) of the flight by its events."""
    card = scenario.trajectory
    start = min(events.values()) - card.pad_hold
    end = max(events.values()) + card.coast_after_injection
    return start, end


def _condition_errors(conditions: Conditions, profile: FlightProfile) -> FieldErrors:
    """Yield the condition that is never met, or the error in a condition."""
    try:
        condition_error = never_active_mistake(conditions, profile)
    except InputError as error:
        condition_error = error.records[0]
    if condition_error is not None:
        yield condition_error.path, condition_error.message


def _inactivity_errors(fault: AnyFault, text: str, profile: FlightProfile) -> FieldErrors:
    """Yield the reason why a fault that starts at a time `text` is never active."""
    first = profile.instants["start"]
    last = profile.instants["end"]
    try:
        start = profile.time(text, "start")
        if start >= last:
            yield "start", f"{text!r} is {start:g} s, at or after the end of the flight ({last:g} s)"
        elif start + (fault.duration or 0.0) < first:
            yield "start", f"{text!r} is {start:g} s: the fault is over before the flight begins ({first:g} s)"
        elif not periods(0, fault, profile):
            yield fault.condition_keys[0], "holds at no time between the start of the fault and its end"
    except InputError as error:
        yield "start", error.records[0].message
