"""What must fit together: rates, reporting frame, event names, times of faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lvnav_trade.campaign import tree
from lvnav_trade.campaign.schema import FRAME_AXES, Campaign, metric
from lvnav_trade.campaign.tree import Node, Place, mistake
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.events import resolve
from lvnav_trade.world.faults import SatelliteOutage

if TYPE_CHECKING:
    from lvnav_trade.campaign.axes import Case

_FIELDS = {
    "imu.rate": "IMU rate",
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
        "filter.covariance_rate": scenario.filter.covariance_rate,
        "filter.update_rate": scenario.filter.update_rate,
        "receiver.rate": scenario.receiver.rate,
    }
    found = [
        mistake(_place(node, path), f"base.{path}", "should be above zero")
        for path, value in values.items()
        if not value > 0
    ]
    if found:
        return found
    pairs = [("imu.rate", "filter.covariance_rate"), ("filter.covariance_rate", "filter.update_rate")]
    if scenario.filter.kind != "inertial":
        pairs.append(("receiver.rate", "filter.update_rate"))
    for fast, slow in pairs:
        if not _multiple(values[fast], values[slow]):
            message = f"{values[slow]:g} Hz does not divide the {_FIELDS[fast]} of {values[fast]:g} Hz"
            found.append(mistake(_place(node, slow), f"base.{slow}", message))
    return found


def _place(node: Node, path: str) -> Place:
    """Return the place of a field, or of the nearest mapping above that was written (the field has its default)."""
    steps = path.split(".")
    while steps:
        found = tree.find(node, steps)
        if found is not None:
            return found.place
        steps.pop()
    return node.place


def requirements(campaign: Campaign, root: Node) -> list[Mistake]:
    """Return the requirements that name an axis which the reporting frame does not have, or share a name."""
    found = []
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
        last = max(times.values())
        for index, fault in enumerate(case.scenario.faults):
            found.update(dict.fromkeys(_fault(fault, f"base.faults.{index}", times, last)))
        for index, requirement in enumerate(campaign.requirements):
            if requirement.at not in times:
                message = f"{requirement.at!r} is not an event of the trajectory{tree.hint(requirement.at, times)}"
                found.setdefault(Mistake(message, f"requirements.{index}.at"))
    return list(found)


def _fault(fault: SatelliteOutage, path: str, events: Mapping[str, float], last: float) -> list[Mistake]:
    """Return what is wrong with the times of one fault; `last` (s) is the last event of the flight."""
    try:
        start = resolve(fault.start, dict(events))
    except InputError as error:
        return [Mistake(error.records[0].message, f"{path}.start")]
    found = []
    if start >= last:
        message = f"{fault.start!r} is {start:g} s, at or after the end of the flight ({last:g} s)"
        found.append(Mistake(message, f"{path}.start"))
    if fault.duration <= 0:
        found.append(Mistake("should be above zero", f"{path}.duration"))
    return found
