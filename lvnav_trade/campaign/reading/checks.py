"""What must fit together: rates, reporting frame, event names, times of faults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from lvnav_trade.campaign.definition.axes import Case, axis_names
from lvnav_trade.campaign.definition.schema import FRAME_AXES, Campaign, metric
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, mistake
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.scenario import Scenario, filter_models, measured, solves
from lvnav_trade.world.events import resolve
from lvnav_trade.world.faults import AnyFault, missing_antenna, missing_satellite
from lvnav_trade.world.sky.satellites import satellites

_FIELDS = {
    "imu.rate": "IMU rate",
    "filter.strapdown_rate": "strapdown rate",
    "filter.covariance_rate": "covariance rate",
    "filter.update_rate": "update rate",
    "receiver.rate": "receiver rate",
}


def _multiple(fast: float, slow: float) -> bool:
    ratio = fast / slow
    return ratio > 1 - 1e-9 and abs(ratio - round(ratio)) < 1e-9 * ratio


def rates(scenario: Scenario, node: Node) -> list[Mistake]:
    """Return the rates that are no multiples of each other, each at the slower one's place."""
    values = {
        "imu.rate": scenario.imu.rate,
        "imu.process_rate": scenario.imu.process_rate,
        "filter.covariance_rate": scenario.filter.covariance_rate,
        "filter.update_rate": scenario.filter.update_rate,
        "receiver.rate": scenario.receiver.rate,
    }
    strapdown = scenario.filter.strapdown_rate
    if strapdown is not None:
        values["filter.strapdown_rate"] = strapdown
    found = []
    pairs = [
        ("imu.rate", "imu.process_rate"),
        ("imu.rate", "filter.covariance_rate"),
        ("filter.covariance_rate", "filter.update_rate"),
    ]
    if strapdown is not None:
        pairs += [("imu.rate", "filter.strapdown_rate"), ("filter.strapdown_rate", "filter.covariance_rate")]
    if scenario.filter.tight or scenario.filter.loose:
        pairs.append(("receiver.rate", "filter.update_rate"))
    for name, card in scenario.sensors.items():
        if card is not None and card.rate is not None:
            values[f"sensors.{name}.rate"] = card.rate
            pairs.append(("filter.update_rate", f"sensors.{name}.rate"))
    for fast, slow in pairs:
        if not _multiple(values[fast], values[slow]):
            message = f"{values[slow]:g} Hz does not divide the {_FIELDS[fast]} of {values[fast]:g} Hz"
            found.append(mistake(tree.nearest(node, slow.split(".")), f"base.{slow}", message))
    return found


def measurements(scenario: Scenario, node: Node) -> list[Mistake]:
    """Return the measurements that the filter would model without noise: its covariance would lose its rank."""
    card = scenario.filter
    _, receiver, _ = filter_models(scenario)
    if solves(scenario) and isinstance(card.receiver, str):
        return []  # the receiver reports the covariance of its solutions, which is never zero
    found = []
    for measurement in card.measurements:
        name = f"{measurement}_sigma"
        if getattr(receiver, name, 1.0) > 0.0:
            continue
        truth = f"receiver.{name}" if card.tight else f"receiver.solution.{name}"
        path = truth if isinstance(card.receiver, str) else f"filter.receiver.{name}"
        message = f"the filter cannot model {measurement.replace('_', ' ')} without noise; should be greater than 0"
        found.append(mistake(tree.nearest(node, path.split(".")), f"base.{path}", message))
    return found


def requirements(campaign: Campaign, root: Node) -> list[Mistake]:
    """Return the requirements that name an axis which the reporting frame does not have, or share a name; and a
    campaign that would stop by requirements and has none.
    """
    found = []
    if campaign.monte_carlo is not None and campaign.monte_carlo.stop and not campaign.requirements:
        place = tree.nearest(root, ["monte_carlo", "stop"])
        message = "there is no requirement that could be decided"
        found.append(mistake(place, "monte_carlo.stop", message))
    known = FRAME_AXES[campaign.base.frame]
    names: set[str] = set()
    for index, requirement in enumerate(campaign.requirements):
        wanted = metric(requirement.metric)
        if wanted.quantity != "attitude" and wanted.axis not in (*known, "3d"):
            place = root.value["requirements"].value[index].value["metric"].place
            message = f"{requirement.metric!r}: frame {campaign.base.frame} has the axes {', '.join(known)}"
            found.append(mistake(place, f"requirements.{index}.metric", message))
        if requirement.name in names:
            place = root.value["requirements"].value[index].value["name"].place
            found.append(mistake(place, f"requirements.{index}.name", f"{requirement.name!r} stands twice"))
        names.add(requirement.name)
    return found


def flight(campaign: Campaign, cases: Sequence[Case], events: Mapping[str, Mapping[str, float]]) -> list[Mistake]:
    """Return the faults and requirements that name no event of a case's trajectory, or lie outside its flight.

    `events` holds for each case digest the times (s) of its trajectory's events in time order.
    """
    found: dict[Mistake, None] = {}
    for case in cases:
        times = events[case.id]
        wanted = [
            (f"requirements.{index}.{'during' if requirement.during else 'at'}", event)
            for index, requirement in enumerate(campaign.requirements)
            for event in requirement.events
        ]
        for key, statements in (("references", campaign.references), ("orderings", campaign.orderings)):
            wanted += [
                (f"{key}.{index}.{'during' if one.during else 'at'}", event)
                for index, one in enumerate(statements)
                for event in one.events
            ]
        if campaign.covariance.at is not None:
            wanted.append(("covariance.at", campaign.covariance.at))
        for path, event in wanted:
            if event not in times:
                near = tree.hint(event, times) or f" (it has {', '.join(times)})"
                message = f"{event!r} is not an event of the trajectory{near}"
                found.setdefault(campaign.written.mistake(path, message))
        for index, requirement in enumerate(campaign.requirements):
            message = _backwards(requirement.events, times) if requirement.during else ""
            if message:
                found.setdefault(campaign.written.mistake(f"requirements.{index}.during", message))
        message = _unbounded(case.scenario)
        if campaign.covariance.error_bound and message:
            found.setdefault(campaign.written.mistake("covariance.error_bound", message))
        for index, fault in enumerate(case.scenario.faults):
            message = _fault(fault, times, *span(case.scenario, times))
            if message:
                found.setdefault(written(campaign, case, f"base.faults.{index}.start", message))
            for field, message in _missing(fault, case.scenario):
                found.setdefault(written(campaign, case, f"base.faults.{index}.{field}", message))
    return list(found)


def _unbounded(scenario: Scenario) -> str:
    """Say why a case has no error bound, where it has none."""
    card = scenario.filter
    if not card.aided:
        return "the filter has no measurement; an error bound needs some"
    return "not available with attitude among the measurements" if "attitude" in measured(scenario) else ""


def _missing(fault: AnyFault, scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield field and message for antennas and satellites that a fault names and the case does not have."""
    n_antenna = len(scenario.receiver.antennas)
    for antenna in getattr(fault, "antennas", ()):
        if antenna > n_antenna:
            yield "antennas", missing_antenna(antenna, n_antenna)
    wanted = getattr(fault, "satellites", ())
    if wanted:
        names = satellites(scenario.constellation, scenario.trajectory.epoch).names
        for name in wanted:
            if name not in names:
                yield "satellites", missing_satellite(name, names)


def _backwards(ends: Sequence[str], times: Mapping[str, float]) -> str:
    """Say that a phase ends before it begins, where it does."""
    known = [times[event] for event in ends if event in times]
    if len(known) < 2 or known[0] < known[1]:
        return ""
    return f"the phase from {ends[0]} ({known[0]:g} s) to {ends[1]} ({known[1]:g} s) has no length"


def span(scenario: Scenario, events: Mapping[str, float]) -> tuple[float, float]:
    """Return the first and the last time (s) of a flight."""
    card = scenario.trajectory
    return min(events.values()) - card.pad_hold, max(events.values()) + card.coast_after_injection


def written(campaign: Campaign, case: Case, path: str, message: str) -> Mistake:
    """Return the mistake where a case's value was written: in the base, or in the axis that gave the case its level."""
    steps, root = [*path.split(".")], campaign.written.root
    for index, (name, axis) in enumerate(zip(axis_names(campaign.axes), campaign.axes, strict=True)):
        varied = ["base", *axis.path.removeprefix("base.").split(".")]
        level = case.axes.get(name, "")
        if steps[: len(varied)] == varied and level in (axis.labels or ()):
            at = str((axis.labels or ()).index(level))
            key = "cards" if root and tree.find(root, ["axes", index, "cards"]) else "values"
            steps = ["axes", str(index), key, at, *steps[len(varied) :]]
            break
    return campaign.written.mistake(path, message, steps)


def located(campaign: Campaign, case: Case, mistakes: Sequence[Mistake]) -> list[Mistake]:
    """Return the mistakes that showed when a case was put together where they were written, as far as a field is
    named (with ``base.`` or without); those of a file of data know their line.
    """
    return [
        one
        if one.line or not one.path
        else written(campaign, case, f"base.{one.path.removeprefix('base.')}", one.message)
        for one in mistakes
    ]


def _fault(fault: AnyFault, events: Mapping[str, float], first: float, last: float) -> str:
    """Return what is wrong with the times of a fault, or nothing; `first` and `last` (s) bound the flight."""
    try:
        start = resolve(fault.start, {"start": first, "end": last, **events})
    except InputError as error:
        return error.records[0].message
    if start >= last:
        return f"{fault.start!r} is {start:g} s, at or after the end of the flight ({last:g} s)"
    if start + fault.duration < first:
        return f"{fault.start!r} is {start:g} s: the fault is over before the flight begins ({first:g} s)"
    return ""
