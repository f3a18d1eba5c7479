"""What many designs take: time, disk and memory, and whether this machine has them."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import cases, probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.plan import covariance_seconds, estimate
from lvnav_trade.campaign.space.choose import AT_RANDOM
from lvnav_trade.campaign.space.designs import Designs
from lvnav_trade.errors import InputError
from lvnav_trade.metrics.metric import NAVIGATION_UNITS

# Measured on one core of a small virtual machine: preparation, metrics and row of a design beside its covariance, and
# bytes of a design in memory of the process that deals them out
_DESIGN_S, _DESIGN_BYTES = 0.035, 6e3
# Bytes of a design on disk: table and CSV table, the page, and until the end the part that it was evaluated in
_ROW_BYTES, _PAGE_BYTES, _PART_BYTES = 1020.0, 150.0, 1160.0
_EVENT_BYTES, _EVENT_PART_BYTES = 27.0, 8.0  # the same of one more number
_CASE_TABLES = 2.0  # of the tables of designs that are analysed whole: what tables of single ones take until the end


class DesignsPlan(NamedTuple):
    """What the designs of a campaign take.

    store : What is stored of each: metrics, or events.
    designs : How many there are.
    whole : How many of them are analysed whole at most.
    runs : How many runs these have together at most.
    seconds : Time (s) of one core, without compilation.
    disk_mb : Size (MB) of the results.
    most_mb : Disk (MB) that is taken at most, before parts, blocks of runs and tables of single designs are removed.
    memory_mb : Memory (MB) of the process that deals the designs out.
    seconds_of_designs : Part of `seconds` for the rows.
    """

    store: str
    designs: int
    whole: int
    runs: int
    seconds: float
    disk_mb: float
    most_mb: float
    memory_mb: float
    seconds_of_designs: float


def planned(campaign: Campaign, folder: Path, flights: Mapping[str, Mapping[str, float]]) -> DesignsPlan:
    """Return what the designs of a campaign take, each with a pass of its own: those that share passes take less.

    flights : Times (s) of the events of each flight, by name of the event, the first and the last of them included.
    """
    designs = Designs(campaign)
    duration = max(max(times.values()) - min(times.values()) for times in flights.values())
    some = probes(campaign)
    each = sum(covariance_seconds(case, duration) for case in some) / len(some) + _DESIGN_S
    card = campaign.monte_carlo
    whole = 1 + (AT_RANDOM if campaign.covariance.spot_check else 0) + (card.chosen_most if card is not None else 0)
    whole = min(whole, len(designs))
    single = campaign.probe.model_copy(update={"axes": (), "design": "grid", "references": ()})
    alone = estimate(single, folder, {case.id: duration for case in cases(single)})
    further = _further_numbers(campaign, flights)
    disk = len(designs) * (_ROW_BYTES + _PAGE_BYTES + further * _EVENT_BYTES)
    tables = whole * 1e6 * (alone.disk_mb - alone.blocks_mb)
    disk += tables
    beside = len(designs) * (_PART_BYTES + further * _EVENT_PART_BYTES)
    beside += whole * 1e6 * alone.blocks_mb + _CASE_TABLES * tables
    return DesignsPlan(
        str(campaign.store),
        len(designs),
        whole,
        whole * card.runs if card is not None else 0,
        len(designs) * each + whole * alone.seconds,
        disk / 1e6,
        (disk + beside) / 1e6,
        alone.memory_mb + len(designs) * _DESIGN_BYTES / 1e6,
        len(designs) * each,
    )


def _further_numbers(campaign: Campaign, flights: Mapping[str, Mapping[str, float]]) -> int:
    """Return how many numbers a row has of all events together."""
    if campaign.store != "events":
        return 0
    of_requirements = sum(one.at is not None for one in campaign.requirements)
    return max(map(len, flights.values())) * (len(NAVIGATION_UNITS) + of_requirements)


def refuse_too_large(plan: DesignsPlan, folder: Path) -> None:
    """InputError where the disk of a folder, or the memory, has no room for what is planned."""
    place = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    free = shutil.disk_usage(place).free / 1e6
    if plan.most_mb > free:
        raise InputError(f"{plan.designs} designs take about {plan.most_mb:.0f} MB of disk; {free:.0f} MB are free")
    memory = _memory_mb()
    if plan.memory_mb > memory:
        raise InputError(
            f"{plan.designs} designs take about {plan.memory_mb:.0f} MB of memory; there are {memory:.0f} MB"
        )


def _memory_mb() -> float:
    """Return the memory of this machine (MB); infinite where it is not known."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
    except (AttributeError, OSError, ValueError):
        return float("inf")
