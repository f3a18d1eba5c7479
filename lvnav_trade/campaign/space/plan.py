"""What many designs take: time, disk and memory, and whether this machine has them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import cases, probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.plan import covariance_seconds, estimate
from lvnav_trade.campaign.space.choose import AT_RANDOM
from lvnav_trade.campaign.space.designs import Designs
from lvnav_trade.errors import InputError

# Measured on one core of a small virtual machine: preparation, metrics and row of a design beside its covariance; bytes
# of a row on disk (beside it the part, until the end), and of a design in memory of the process that deals them out.
_DESIGN_S, _ROW_BYTES, _DESIGN_BYTES = 0.035, 700.0, 6e3
_REPORT_BYTES = 150.0  # of a design in the page


class DesignsPlan(NamedTuple):
    """What the designs of a campaign take.

    designs : How many there are.
    whole : How many of them are analysed whole at most.
    runs : How many runs these have together at most.
    seconds : Time (s) of one core, without compilation.
    disk_mb : Size (MB) of the results.
    memory_mb : Memory (MB) of the process that deals the designs out.
    seconds_of_designs : Part of `seconds` for the rows.
    """

    designs: int
    whole: int
    runs: int
    seconds: float
    disk_mb: float
    memory_mb: float
    seconds_of_designs: float


def planned(campaign: Campaign, folder: Path, duration: float) -> DesignsPlan:
    """Return what the designs of a campaign take on a flight of a duration (s), each with a pass of its own: those that
    share passes take less.
    """
    designs = Designs(campaign)
    some = probes(campaign)
    each = sum(covariance_seconds(case, duration) for case in some) / len(some) + _DESIGN_S
    card = campaign.monte_carlo
    whole = 1 + (AT_RANDOM if campaign.covariance.spot_check else 0) + (card.chosen_most if card is not None else 0)
    whole = min(whole, len(designs))
    single = campaign.probe.model_copy(update={"axes": (), "design": "grid", "references": ()})
    alone = estimate(single, folder, {case.id: duration for case in cases(single)})
    bytes_of_rows = len(designs) * (2 * _ROW_BYTES + _REPORT_BYTES)
    return DesignsPlan(
        len(designs),
        whole,
        whole * card.runs if card is not None else 0,
        len(designs) * each + whole * alone.seconds,
        (bytes_of_rows + whole * 1e6 * alone.disk_mb) / 1e6,
        alone.memory_mb + len(designs) * _DESIGN_BYTES / 1e6,
        len(designs) * each,
    )


def refuse_too_large(plan: DesignsPlan, folder: Path) -> None:
    """InputError where the disk of a folder, or the memory, has no room for what is planned."""
    place = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    free = shutil.disk_usage(place).free / 1e6
    if plan.disk_mb > free:
        raise InputError(f"{plan.designs} designs take about {plan.disk_mb:.0f} MB of disk; {free:.0f} MB are free")
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
