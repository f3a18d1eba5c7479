"""What a campaign takes before it runs: cases, blocks of runs, what is done already, time, memory, disk."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.store.parts import paths, span

# Measured on one core of a small virtual machine: 100 runs of 630 s with 200 Hz, 17 states and 10 covariance steps a
# second take 2.0 s, their linear covariance 0.4 s after 0.5 s of preparation; a block of 40 is 1.4 MB on disk, the
# tables of a case 8 MB, a worker's memory 410 MB at most. Compilation, which the first run pays once, is not in it.
_RETUNED = 40  # linear covariances of a case for `sensitivity`: four for each of ten sources that matter
_TICK_S, _STEP_S, _COVARIANCE_S, _PREPARE_S = 8e-8, 5.5e-9, 2.2e-7, 0.5
_PART_BYTES, _TABLE_BYTES, _BASE_BYTES = 2.2e3, 1.25e4, 3e8
_TICK_BYTES, _HISTORY_BYTES = 600.0, 1.6e3


class Block(NamedTuple):
    """A block of runs of one case: the unit of work, of storing and of resuming."""

    case: Case
    first_run: int
    n_run: int


def blocks(campaign: Campaign, cases: Sequence[Case], done: Mapping[str, Sequence[tuple[int, int]]]) -> list[Block]:
    """Return the blocks still to do, case by case.

    Blocks start at multiples of their size, so that 500 runs and then 500 more are the same blocks as 1000 at once:
    only an incomplete last block is done again. `done` holds (first run, runs) of the stored blocks of each case.
    """
    if campaign.monte_carlo is None:
        return []
    runs, size = campaign.monte_carlo.runs, campaign.monte_carlo.block
    return [
        Block(case, first, min(size, runs - first))
        for case in cases
        for first in range(0, runs, size)
        if (first, min(size, runs - first)) not in done.get(case.id, ())
    ]


class Estimate(NamedTuple):
    """What a campaign will take: one mapping per case (id, label, runs, done), seconds of one core, megabytes;
    warnings: what its runs cannot show.
    """

    cases: list[dict[str, Any]]
    blocks: int
    seconds: float
    disk_mb: float
    memory_mb: float
    warnings: Sequence[str] = ()


def estimate(campaign: Campaign, folder: Path, duration: Mapping[str, float]) -> Estimate:
    """Return what is left to do of a campaign whose results stand in `folder` (nothing need be there).

    `duration` is the flight's length (s) of each case digest. Seconds are those of the machine that the constants above
    were measured on; how they scale with rates and states is what the estimate is for.
    """
    found = cases(campaign)
    stored = {case.id: [span(path) for path in paths(folder / "parts" / case.id)] for case in found}
    left = blocks(campaign, found, stored)
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    to_do = {case.id: sum(unit.n_run for unit in left if unit.case.id == case.id) for case in found}
    rows = [{"id": c.id, "label": c.label, "runs": runs, "done": runs - to_do[c.id]} for c in found]
    linear = sum(_covariance_seconds(case, duration[case.id]) for case in found)
    seconds = linear * (1 + _RETUNED * campaign.covariance.sensitivity)
    seconds += sum(unit.n_run * _run_seconds(unit.case, duration[unit.case.id]) for unit in left)
    times = {case.id: duration[case.id] / campaign.keep.history for case in found}
    disk = sum(_PART_BYTES * times[unit.case.id] for unit in left) + sum(_TABLE_BYTES * n for n in times.values())
    size = min(runs, campaign.monte_carlo.block) if campaign.monte_carlo else 0
    memory = _BASE_BYTES + max(
        (duration[c.id] * c.scenario.imu.rate * _TICK_BYTES + size * times[c.id] * _HISTORY_BYTES for c in found),
        default=0.0,
    )
    return Estimate(rows, len(left), seconds, disk / 1e6, memory / 1e6)


def _states(case: Case) -> int:
    card = case.scenario.filter
    return 15 + 2 * card.tight + 6 * card.models_vehicle + 3 * len(card.extra_states)


def _run_seconds(case: Case, duration: float) -> float:
    rates = case.scenario
    return float(duration * (_TICK_S * rates.imu.rate + _STEP_S * _states(case) ** 2 * rates.filter.covariance_rate))


def _covariance_seconds(case: Case, duration: float) -> float:
    return float(_PREPARE_S + duration * _COVARIANCE_S * _states(case) ** 2 * case.scenario.filter.covariance_rate)
