"""Plan of a campaign: cases, blocks of runs, finished work, time, memory, disk."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.layout import PARAMETERS
from lvnav_trade.store.parts import paths, span

# Measured on one core of a small virtual machine, of flights of 630 s with 200 Hz and 10 covariance steps a second: 40
# runs with 15, 17 and 44 states take 0.18, 0.20 and 0.46 s, a linear covariance 0.08, 0.10 and 0.32 s, and the rest of
# a case (preparation, diagnostics, tables) 0.9 s; a worker's memory is 410 MB at most. Compilation, which the first run
# pays once, is not in it. On disk, with 562 history times, a block of 40 runs is 1.9 MB with 17 states and 4.3 MB with
# 44, and the tables of both cases together are 3.8 MB without runs and 7.3 MB with 80 runs each. Until the end, the
# tables of single cases take twice that beside them.
_RETUNED = 40  # linear covariances of a case for `sensitivity`: four for each of ten sources that matter
_TICK_S, _STEP_S, _STEP_POWER = 2e-8, 9.4e-9, 1.33  # of a run: a sample, a step by a power of the number of states
_COVARIANCE_S, _COVARIANCE_POWER = 5.4e-7, 1.2  # of a step of a linear covariance, alike
_CASE_S = 0.9
_COLUMNS = 1.2  # of results, per state: the errors of the states and the norms of those of three axes
# Bytes of a block for each of its columns: per time, per time and run, per run (its errors at some 16 events)
_SUM_BYTES, _BIN_BYTES, _RUN_BYTES = 32.0, 2.0, 560.0
# Bytes of the tables of a case: once, per time; and for each column per time without runs, per time more with them, per
# run
_CASE_BYTES, _TABLE_BYTES, _LINEAR_BYTES, _STATISTICS_BYTES, _ROW_BYTES = 4.8e5, 1.44e3, 30.0, 50.0, 257.0
_BASE_BYTES, _TICK_BYTES, _HISTORY_BYTES = 3e8, 600.0, 1.6e3  # of memory


class Block(NamedTuple):
    """A block of runs of one case: one item of work, of storage and of resuming."""

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
    card, size = campaign.monte_carlo, campaign.monte_carlo.block
    return [
        Block(case, first, min(size, runs - first))
        for case, runs in ((case, card.runs_of(case.axes)) for case in cases)
        for first in range(0, runs, size)
        if (first, min(size, runs - first)) not in done.get(case.id, ())
    ]


class Estimate(NamedTuple):
    """What a campaign will take: one mapping per case (id, label, runs, done), seconds of one core, megabytes;
    blocks_mb: of the disk what new blocks of runs take; warnings: what its runs cannot show.
    """

    cases: list[dict[str, Any]]
    blocks: int
    seconds: float
    disk_mb: float
    memory_mb: float
    warnings: Sequence[str] = ()
    blocks_mb: float = 0.0


def estimate(campaign: Campaign, folder: Path, duration: Mapping[str, float]) -> Estimate:
    """Return the remaining work of a campaign whose results are in `folder`, which need not exist.

    `duration` is the flight's length (s) of each case digest. Seconds are those of the machine that the constants above
    were measured on; their scaling with rates and states holds on others. Disk: new blocks, and tables of all cases.
    """
    found = cases(campaign)
    stored = {case.id: [span(path) for path in paths(folder / "parts" / case.id)] for case in found}
    left = blocks(campaign, found, stored)
    card = campaign.monte_carlo
    runs = {case.id: card.runs_of(case.axes) if card else 0 for case in found}
    to_do = {case.id: sum(unit.n_run for unit in left if unit.case.id == case.id) for case in found}
    rows = [{"id": c.id, "label": c.label, "runs": runs[c.id], "done": runs[c.id] - to_do[c.id]} for c in found]
    linear = sum(_CASE_S + covariance_seconds(case, duration[case.id]) for case in found)
    seconds = linear * (1 + _RETUNED * campaign.covariance.sensitivity)
    seconds += sum(unit.n_run * _run_seconds(unit.case, duration[unit.case.id]) for unit in left)
    times = {case.id: duration[case.id] / campaign.keep.history for case in found}
    new = sum(_block_bytes(unit, times[unit.case.id]) for unit in left)
    disk = new + sum(_table_bytes(case, times[case.id], runs[case.id]) for case in found)
    size = min(card.runs, card.block) if card else 0
    memory = _BASE_BYTES + max(
        (duration[c.id] * c.scenario.imu.rate * _TICK_BYTES + size * times[c.id] * _HISTORY_BYTES for c in found),
        default=0.0,
    )
    return Estimate(rows, len(left), seconds, disk / 1e6, memory / 1e6, blocks_mb=new / 1e6)


def _states(case: Case) -> int:
    card = case.scenario.filter
    extra = sum(3 * len(PARAMETERS[name].drivers) if name in PARAMETERS else 3 for name in card.extra_states)
    return 15 + 2 * card.tight + 6 * card.models_vehicle + extra


def _block_bytes(block: Block, times: float) -> float:
    per_run = _BIN_BYTES * times + _RUN_BYTES
    return _COLUMNS * _states(block.case) * (_SUM_BYTES * times + per_run * block.n_run)


def _table_bytes(case: Case, times: float, runs: int) -> float:
    history = _LINEAR_BYTES + _STATISTICS_BYTES * (runs > 0)
    return _CASE_BYTES + _TABLE_BYTES * times + _COLUMNS * _states(case) * (history * times + _ROW_BYTES * runs)


def _run_seconds(case: Case, duration: float) -> float:
    rates = case.scenario
    step = _STEP_S * _states(case) ** _STEP_POWER
    return float(duration * (_TICK_S * rates.imu.rate + step * rates.filter.covariance_rate))


def covariance_seconds(case: Case, duration: float) -> float:
    """Return how long (s) the linear covariance of a case takes on a flight of a duration (s)."""
    step = _COVARIANCE_S * _states(case) ** _COVARIANCE_POWER
    return float(duration * step * case.scenario.filter.covariance_rate)
