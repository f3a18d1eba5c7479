"""Estimated time, disk and memory of a design space, and comparison with those of the machine."""

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
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.metric import NAVIGATION_UNITS

# Measured on one core of a small virtual machine: time of preparation, metrics and row of a design, in addition to its
# covariance; memory per design of the process that distributes them
_DESIGN_S, _DESIGN_BYTES = 0.035, 6e3
# Bytes of a design on disk: table and CSV table; report; until the end the part in which it was evaluated
_ROW_BYTES, _PAGE_BYTES, _PART_BYTES = 1020.0, 150.0, 1160.0
_EVENT_BYTES, _EVENT_PART_BYTES = 27.0, 8.0  # bytes of one more number, in the tables and in the part
_CASE_TABLES = 2.0  # size of the tables of single cases until the end, over that of the final tables


class DesignsPlan(NamedTuple):
    """Estimated cost of a design space.

    store : Data stored for each design: metrics or events.
    designs : Number of designs.
    whole : Largest number of designs with a full analysis.
    runs : Largest number of runs of these together.
    seconds : Time (s) on one core, without compilation.
    disk_mb : Size (MB) of the results.
    most_mb : Peak size (MB) on disk, before parts, blocks of runs and tables of single designs are removed.
    memory_mb : Memory (MB) of the process that distributes the designs.
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
    """Estimate the cost of a design space, with one covariance pass per design; shared passes take less time.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    folder : Path
        Folder of its results, which need not exist.
    flights : mapping of str to mapping of str to float
        Times (s) of the events by digest of the case and by name; the first and last give the duration.
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
    """Return the number of further numbers of a row, of all events together."""
    if campaign.store != "events":
        return 0
    of_requirements = sum(requirement.at is not None for requirement in campaign.requirements)
    return max(map(len, flights.values())) * (len(NAVIGATION_UNITS) + of_requirements)


def refuse_too_large(plan: DesignsPlan, folder: Path) -> None:
    """Raise an InputError if the disk of a folder or the memory is too small for a planned design space."""
    place = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(place).free / 1e6
    if plan.most_mb > free:
        raise InputError(f"{plan.designs} designs take about {plan.most_mb:.0f} MB of disk; {free:.0f} MB are free")
    memory = _memory_mb()
    if plan.memory_mb > memory:
        raise InputError(
            f"{plan.designs} designs take about {plan.memory_mb:.0f} MB of memory; there are {memory:.0f} MB"
        )


def _memory_mb() -> float:
    """Return the memory of this machine (MB); infinite if it is not known."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
    except (AttributeError, OSError, ValueError):
        return float("inf")
