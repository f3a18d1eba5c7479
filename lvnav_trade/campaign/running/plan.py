"""Plan of a campaign: cases, blocks of runs, finished work, time, memory, disk."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.state_layout import PARAMETERS
from lvnav_trade.results.tables.parts import paths, span

# Measured on one core of a small virtual machine, for flights of 630 s with 200 Hz and 10 covariance steps per second:
# 40 runs with 15, 17 and 44 states take 0.18, 0.20 and 0.46 s, a linear covariance 0.08, 0.10 and 0.32 s, and the rest
# of a case (preparation, diagnostics, tables) 0.9 s. The memory of a worker is 410 MB at most. Compilation, once in the
# first run, is not included. On disk, with 562 history times, a block of 40 runs is 1.9 MB with 17 states and 4.3 MB
# with 44. The tables of both cases together are 3.8 MB without runs and 7.3 MB with 80 runs each; until the campaign
# ends, the tables of single cases take twice as much in addition.
_RETUNED = 40  # linear covariances of a case for `sensitivity`: four for each of ten significant sources
_TICK_S, _STEP_S, _STEP_POWER = 2e-8, 9.4e-9, 1.33  # s of a run: per IMU sample; per step times n_states**power
_COVARIANCE_S, _COVARIANCE_POWER = 5.4e-7, 1.2  # s of a linear covariance per step times n_states**power
_CASE_S = 0.9  # s of preparation, diagnostics and tables of a case
_COLUMNS = 1.2  # columns of results per state: its error, and the norm of every three axes
# Bytes of a block for each of its columns: per time; per time and run; per run (its errors at some 16 events)
_SUM_BYTES, _BIN_BYTES, _RUN_BYTES = 32.0, 2.0, 560.0
# Bytes of the tables of a case: once, per time; and for each column per time without runs, per time more with them, per
# run
_CASE_BYTES, _TABLE_BYTES, _LINEAR_BYTES, _STATISTICS_BYTES, _ROW_BYTES = 4.8e5, 1.44e3, 30.0, 50.0, 257.0
# Bytes of memory of a worker: always; per IMU sample; per run and history time
_BASE_BYTES, _TICK_BYTES, _HISTORY_BYTES = 3e8, 600.0, 1.6e3


class Block(NamedTuple):
    """A block of runs of one case: the unit of computing, storing and resuming."""

    case: Case
    first_run: int  # number of its first run, from 0
    n_run: int  # number of runs


def blocks(campaign: Campaign, cases: Sequence[Case], done: Mapping[str, Sequence[tuple[int, int]]]) -> list[Block]:
    """Return the blocks still to be computed, case by case.

    Blocks start at multiples of their size, so that 500 runs and then 500 more give the same blocks as 1000 at once.
    Only an incomplete last block is computed again. `done` has the first run and the number of runs of the stored
    blocks, by digest of the case. A run takes all blocks, and leaves out the stored ones when it flies.
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
    """Estimated cost of a campaign."""

    cases: list[dict[str, Any]]  # by case: id, label, runs, done (stored runs)
    blocks: int  # number of blocks to compute
    seconds: float  # time on one core, s
    disk_mb: float  # size of new blocks and of all tables, MB
    memory_mb: float  # memory of one worker, MB
    warnings: Sequence[str] = ()  # requirements that the runs cannot demonstrate
    blocks_mb: float = 0.0  # part of the disk for new blocks of runs, MB


def estimate(campaign: Campaign, folder: Path, duration: Mapping[str, float]) -> Estimate:
    """Estimate the remaining work of a campaign.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    folder : Path
        Folder of its results, which need not exist.
    duration : mapping of str to float
        Duration of the flight (s) by digest of the case.

    Returns
    -------
    Estimate
        Time, disk and memory.

    Notes
    -----
    The times are those of the machine on which the constants of this module were measured. Their scaling with the rates
    and the number of states applies to other machines too.
    """
    all_cases = cases(campaign)
    stored = {case.id: [span(path) for path in paths(folder / "parts" / case.id)] for case in all_cases}
    remaining = blocks(campaign, all_cases, stored)
    card = campaign.monte_carlo
    runs = {case.id: card.runs_of(case.axes) if card else 0 for case in all_cases}
    to_do = {case.id: sum(block.n_run for block in remaining if block.case.id == case.id) for case in all_cases}
    rows = [{"id": c.id, "label": c.label, "runs": runs[c.id], "done": runs[c.id] - to_do[c.id]} for c in all_cases]
    linear = sum(_CASE_S + covariance_seconds(case, duration[case.id]) for case in all_cases)
    seconds = linear * (1 + _RETUNED * campaign.covariance.sensitivity)
    seconds += sum(block.n_run * _run_seconds(block.case, duration[block.case.id]) for block in remaining)
    times = {case.id: duration[case.id] / campaign.keep.history for case in all_cases}
    new = sum(_block_bytes(block, times[block.case.id]) for block in remaining)
    disk = new + sum(_table_bytes(case, times[case.id], runs[case.id]) for case in all_cases)
    size = min(card.runs, card.block) if card else 0
    memory = _BASE_BYTES + max(
        (duration[c.id] * c.scenario.imu.rate * _TICK_BYTES + size * times[c.id] * _HISTORY_BYTES for c in all_cases),
        default=0.0,
    )
    return Estimate(rows, len(remaining), seconds, disk / 1e6, memory / 1e6, blocks_mb=new / 1e6)


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
    """Return the computing time (s) of the linear covariance of a case, for a flight of a duration (s)."""
    step = _COVARIANCE_S * _states(case) ** _COVARIANCE_POWER
    return float(duration * step * case.scenario.filter.covariance_rate)
