"""Checks that need the simulated trajectory: events, faults, phases, sensors."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.campaign.definition.axes import Case, axis_names
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading import switched
from lvnav_trade.campaign.reading.expand import expanded_tree
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf, command_line_place
from lvnav_trade.gnss.fault_cards import AnyFault, DeadAxis, Jamming, missing_antenna, missing_axis, missing_satellite
from lvnav_trade.gnss.satellites import broken_record_remarks, satellites
from lvnav_trade.imu.array import axis_counts
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.state_layout import BACKUP
from lvnav_trade.scenario.filter_models import filter_measurements
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import SENSOR_MEASUREMENTS
from lvnav_trade.trajectory.flight import TrajectoryCard, build, identity, motion
from lvnav_trade.trajectory.truth import BEYOND, NOTE, WARNING, Remark

_NOT_RECEIVED = "is received at no time of the flight while the fault holds"

# Kinds of remarks by their name in the manifest, the most important first
KINDS = {"beyond_limits": BEYOND, "warnings": WARNING, "notes": NOTE}


def mistakes(campaign: Campaign, cases: Sequence[Case], events: Mapping[str, Mapping[str, float]]) -> list[Mistake]:
    """Return the input errors of a campaign with respect to its trajectories.

    Requirements and published numbers at events that do not occur, phases without length, faults and sensors that are
    never active, and measurements without a sensor.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    cases : sequence of Case
        Cases to check.
    events : mapping of str to mapping of str to float
        Times (s) of the events in order of time, by digest of the case and name.

    Returns
    -------
    list of Mistake
        Each error once; settings without effect only if there is no other error.
    """
    errors: list[Mistake] = []
    for case in cases:
        times = events[case.id]
        errors += _event_errors(campaign, times)
        errors += _requirement_errors(campaign, case, times)
        errors += _covariance_errors(campaign, case)
        errors += _imu_and_fault_errors(campaign, case, times)
    for case in cases:
        errors += _condition_errors(campaign, case, events[case.id])
    errors += _missing_sensor_errors(campaign, cases)
    return list(dict.fromkeys(errors)) or list(_unreceived_satellite_errors(campaign, cases))


def _event_errors(campaign: Campaign, times: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield the requirements, published numbers and diagnostics at events that do not occur."""
    named_events = []
    for key in ("requirements", "references"):
        for index, statement in enumerate(getattr(campaign, key)):
            field = "during" if statement.during else "at"
            named_events += [(f"{key}.{index}.{field}", event) for event in statement.events]
    if campaign.covariance.at is not None:
        named_events.append(("covariance.at", campaign.covariance.at))
    for path, event in named_events:
        if event not in times:
            suggestion = tree.hint(event, times) or f" (it has {', '.join(times)})"
            yield campaign.source_tree.mistake(path, f"{event!r} is not an event of the trajectory{suggestion}")


def _requirement_errors(campaign: Campaign, case: Case, times: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield the requirements on a backup strapdown if a case has none, and those in phases without length."""
    for index, requirement in enumerate(campaign.requirements):
        if requirement.metric.startswith(BACKUP) and not case.scenario.filter.backup:
            message = f"{requirement.metric!r}: a case has no such strapdown (filter.backup)"
            yield campaign.source_tree.mistake(f"requirements.{index}.metric", message)
        ends = requirement.events
        if requirement.during and len(ends) == 2 and all(event in times for event in ends):
            begin, end = ends
            t_begin = times[begin]
            t_end = times[end]
            if t_begin >= t_end:
                message = f"the phase from {begin} ({t_begin:g} s) to {end} ({t_end:g} s) has no length"
                yield campaign.source_tree.mistake(f"requirements.{index}.during", message)


def _covariance_errors(campaign: Campaign, case: Case) -> Iterator[Mistake]:
    """Yield the diagnostics of linear covariance that are not available for the filter of a case."""
    if campaign.covariance.error_bound:
        message = ""
        if not case.scenario.filter.is_aided:
            message = "the filter has no measurement; an error bound needs some"
        elif "attitude" in filter_measurements(case.scenario):
            message = "not available with attitude among the measurements"
        if message:
            yield campaign.source_tree.mistake("covariance.error_bound", message)
    if campaign.covariance.protection is not None:
        message = _missing_separation(case.scenario)
        if message:
            yield campaign.source_tree.mistake("covariance.protection", message)


def _imu_and_fault_errors(campaign: Campaign, case: Case, times: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield the settings of the IMU and of faults that do not fit the trajectory or the devices of a case."""
    for field, message in switched.imu_errors(case.scenario, times):
        yield case_mistake(campaign, case, f"base.imu.{field}", message)
    for index, fault in enumerate(case.scenario.faults):
        for field, message in _fault_errors(fault, case.scenario, times):
            yield case_mistake(campaign, case, f"base.faults.{index}.{field}", message)


def _missing_separation(scenario: Scenario) -> str:
    """Return the reason why solution separation is not available for a filter; empty if it is."""
    card = scenario.filter
    if not card.tight:
        return "sub-filters leave out satellites one by one, and the filter takes no ranges"
    if card.clock == "differenced":
        return "every difference has the reference satellite in it; no sub-filter is without"
    if card.gains is not None or card.consider:
        return "the separation's variance is that of optimal filters: no stored gains, no considered states"
    return ""


def _fault_errors(fault: AnyFault, scenario: Scenario, events: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Yield field and message for times outside the flight, and for unknown antennas, axes and satellites."""
    yield from switched.fault_errors(fault, scenario, events)
    n_antenna = len(scenario.receiver.antennas)
    for antenna in getattr(fault, "antennas", ()):
        if antenna > n_antenna:
            yield "antennas", missing_antenna(antenna, n_antenna)
    if isinstance(fault, DeadAxis):
        n_axis = axis_counts(scenario.imu)[fault.unit - 1]
        if fault.axis > n_axis:
            yield "axis", missing_axis(fault.axis, n_axis)
    if isinstance(fault, Jamming) and scenario.receiver.link is None:
        yield "kind", "jamming lowers C/N0, and the receiver has no link budget (receiver.link)"
    fault_satellites = getattr(fault, "satellites", ())
    if fault_satellites:
        names = satellites(scenario.constellation, scenario.trajectory.epoch).names
        for name in fault_satellites:
            if name not in names:
                yield "satellites", missing_satellite(name, names)


def case_mistake(campaign: Campaign, case: Case, path: str, message: str) -> Mistake:
    """Return an input error of a case, with the place of the value: in the base, or in the level of an axis."""
    steps = path.split(".")
    root = campaign.source_tree.root
    for index, (name, axis) in enumerate(zip(axis_names(campaign.axes), campaign.axes, strict=True)):
        varied_steps = ["base", *axis.steps]
        labels = axis.labels or ()
        label = case.axes.get(name, "")
        if steps[: len(varied_steps)] == varied_steps and label in labels:
            key = "cards" if root and tree.find(root, ["axes", index, "cards"]) else "values"
            level = str(labels.index(label))
            steps = ["axes", str(index), key, level, *steps[len(varied_steps) :]]
            break
    return campaign.source_tree.mistake(path, message, steps)


def locate_mistakes(campaign: Campaign, case: Case, mistakes: Sequence[Mistake]) -> list[Mistake]:
    """Return input errors found while a case was prepared, with the places of their fields in the campaign.

    Paths may begin with ``base.`` or not. Errors in a data file have the line in that file already.
    """
    errors = []
    for error in mistakes:
        if error.path and not error.line:
            path = f"base.{error.path.removeprefix('base.')}"
            error = case_mistake(campaign, case, path, error.message)
        errors.append(error)
    return errors


def remarks(cases: Sequence[Case], trajectory_remarks: Sequence[Remark]) -> dict[str, list[str]]:
    """Return the remarks on a valid campaign as lines, by their kind in the manifest and in JSON output.

    Parameters
    ----------
    cases : sequence of Case
        Cases of the campaign.
    trajectory_remarks : sequence of Remark
        Remarks on their trajectories.

    Returns
    -------
    dict of str to list of str
        Lines by kind: beyond_limits, warnings, notes.
    """
    lines = {}
    for name, category in KINDS.items():
        texts = [remark.text for remark in trajectory_remarks if remark.category == category]
        lines[name] = list(dict.fromkeys(texts))
    lines["warnings"] += warnings(cases)
    lines["notes"] += _damaged_records(cases)
    return lines


def _damaged_records(cases: Sequence[Case]) -> list[str]:
    """Return a line for each navigation file of a case in which records of satellites are damaged."""
    constellations = {case.scenario.constellation.model_dump_json(): case.scenario.constellation for case in cases}
    lines: dict[str, None] = {}
    for constellation in constellations.values():
        lines |= dict.fromkeys(broken_record_remarks(constellation))
    return list(lines)


def remark_lines(remarks: Mapping[str, Sequence[str]]) -> list[str]:
    """Return remarks as lines to print, each with its kind; the first line combines all settings beyond limits."""
    lines = []
    beyond_limits = "; ".join(remarks.get("beyond_limits", ()))
    if beyond_limits:
        lines.append(f"{BEYOND}: {beyond_limits}")
    for name in ("warnings", "notes"):
        lines += [f"{KINDS[name]}: {line}" for line in remarks.get(name, ())]
    return lines


def warnings(cases: Sequence[Case]) -> list[str]:
    """Return the warnings on a set of cases.

    A line is returned for each sensor that only some cases use, for each satellite that a fault affects only in some
    cases, for stored gains of another trajectory, and for persistent IMU faults that no test excludes.
    """
    lines = []
    for name, user_cases, idle_cases in _sensor_users(cases):
        if user_cases and idle_cases:
            labels = "; ".join(case.label for case in idle_cases)
            lines.append(f"sensors.{name}: no measurement of the filter uses it in {labels}")
    for (_, name), (index, affected_cases, idle_cases) in _affected_satellites(cases).items():
        if affected_cases and idle_cases:
            labels = "; ".join(case.label for case in idle_cases)
            lines.append(f"faults.{index}.satellites: {name} {_NOT_RECEIVED} in {labels}")
    for make_warning in (_stored_gain_warning, switched.unprotected_imu_warning):
        for case in cases:
            warning = make_warning(case.scenario)
            if warning:
                lines.append(f"{case.label}: {warning}")
    return lines


def _unreceived_satellite_errors(campaign: Campaign, cases: Sequence[Case]) -> Iterator[Mistake]:
    """Yield the satellites named by a fault that no case receives while the fault is active."""
    for (_, name), (index, affected_cases, idle_cases) in _affected_satellites(cases).items():
        if not affected_cases:
            yield case_mistake(campaign, idle_cases[0], f"base.faults.{index}.satellites", f"{name} {_NOT_RECEIVED}")


class _FaultEffect(NamedTuple):
    """Cases with and without an effect of a fault on a satellite that it names."""

    fault_index: int  # from 0
    affected_cases: list[Case]
    idle_cases: list[Case]


def _affected_satellites(cases: Sequence[Case]) -> dict[tuple[str, str], _FaultEffect]:
    """Return, by fault and satellite, the cases in which the satellite is received while the fault is active."""
    effects: dict[tuple[str, str], _FaultEffect] = {}
    for case in cases:
        for index, name, is_idle in switched.satellite_fault_effects(case.scenario):
            key = (case.scenario.faults[index].model_dump_json(), name)
            effect = effects.setdefault(key, _FaultEffect(index, [], []))
            effect_cases = effect.idle_cases if is_idle else effect.affected_cases
            effect_cases.append(case)
    return effects


def _stored_gain_warning(scenario: Scenario) -> str:
    """Return a warning if stored gains were computed for another trajectory, or their card does not name it."""
    gains = scenario.filter.gains
    if gains is None or gains.flight_digest == identity(scenario.trajectory):
        return ""
    if not gains.flight_digest:
        return f"filter.gains: {gains.name!r} does not say for which flight it was computed"
    name = scenario.trajectory.name
    flight = f"{name!r} with other numbers" if name == gains.flight else repr(name)
    return f"filter.gains: computed for the flight {gains.flight!r}, used on {flight}"


def _sensor_users(cases: Sequence[Case]) -> Iterator[tuple[str, list[Case], list[Case]]]:
    """Yield each sensor with the cases that use it and those that do not; control of the vehicle uses attitude."""
    names = [name for case in cases for name in case.scenario.sensors]
    for name in dict.fromkeys(names):
        user_cases: list[Case] = []
        idle_cases: list[Case] = []
        for case in cases:
            card = case.scenario.sensors.get(name)
            if card is None:
                continue
            is_for_control = card.measurement == "attitude" and case.scenario.control is not None
            is_for_filter = card.measurement in case.scenario.filter.measurements
            if is_for_control or is_for_filter:
                user_cases.append(case)
            else:
                idle_cases.append(case)
        yield name, user_cases, idle_cases


def _missing_sensor_errors(campaign: Campaign, cases: Sequence[Case]) -> Iterator[Mistake]:
    """Yield the measurements whose sensor is null in every case."""
    for name in SENSOR_MEASUREMENTS:
        user_cases = [case for case in cases if name in case.scenario.filter.measurements]
        if user_cases and not any(name in filter_measurements(case.scenario) for case in user_cases):
            message = f"no sensor of the scenario measures {name} in any case"
            yield case_mistake(campaign, user_cases[0], "base.filter.measurements", message)


def _condition_errors(campaign: Campaign, case: Case, events: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield the sensors that cannot be simulated on a trajectory, or whose conditions are never met."""
    for name, card in case.scenario.sensors.items():
        if card is None:
            continue
        path = f"base.sensors.{name}"
        reason = card.refusal(case.scenario.trajectory.epoch)
        if reason:
            yield case_mistake(campaign, case, path, reason)
        for field, message in switched.sensor_errors(card, case.scenario, events):
            yield case_mistake(campaign, case, f"{path}.{field}" if field else path, message)
    for field, message in switched.filter_errors(case.scenario, events):
        yield case_mistake(campaign, case, f"base.filter.{field}", message)


_STEP = 1.0  # s between points of a preview


class Preview(NamedTuple):
    """A trajectory for display."""

    name: str  # of the card
    reference: dict[str, Any]  # columns of the table `reference` by name
    events: dict[str, Any]  # columns of the table `events` by name


def read_card(name: str, folder: Path) -> TrajectoryCard:
    """Return the trajectory card with a name such as trajectories/two_stage_leo, or at a path.

    Cards of the user are searched for in `folder` and in its folder `configs`. InputError if there is no such card, or
    if it is not valid.
    """
    annotation: Any = Scenario.model_fields["trajectory"].annotation
    node = expanded_tree(tree.Node(name, command_line_place(name)), annotation, Shelf.from_folder(folder), "trajectory")
    try:
        return TypeAdapter(annotation).validate_python(tree.plain_data(node))
    except ValidationError as error:
        raise InputError(records=explain(error, node, fields.member(annotation, node), "trajectory")) from None


def preview(card: TrajectoryCard) -> Preview:
    """Return the trajectory of a card every second and at its events; InputError if the trajectory is invalid."""
    flight = build(card)
    names = list(flight.events)
    times = list(flight.events.values())
    grid = np.arange(np.ceil(flight.start / _STEP), np.floor(flight.end / _STEP) + 1.0) * _STEP
    t = np.unique(np.concatenate([[flight.start], grid, times, [flight.end]]))
    state = motion(flight, t)
    r_e = frames.ecef_from_eci(state.r_i, frames.earth_angle(flight.theta0, t))
    ground_velocity_i = frames.earth_velocity(state.r_i, state.v_i)
    latitude, longitude, altitude = frames.geodetic_from_ecef(r_e)
    reference = {
        "t_s": t,
        "latitude_rad": latitude,
        "longitude_rad": longitude,
        "altitude_m": altitude,
        "ground_speed_m_per_s": np.linalg.norm(ground_velocity_i, axis=1),
    }
    events = {"event": names, "kind": ["event"] * len(names), "t_s": times, "t_end_s": times}
    return Preview(card.name, reference, events)
