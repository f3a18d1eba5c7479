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

    case: Case  # the case
    first_run: int  # number of its first run, from 0
    n_run: int  # number of runs


def blocks(
    campaign: Campaign, cases: Sequence[Case], stored_spans: Mapping[str, Sequence[tuple[int, int]]]
) -> list[Block]:
    """Return the blocks still to be computed, case by case.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    cases : sequence of Case
        Its cases.
    stored_spans : mapping of str to sequence of (int, int)
        First run and number of runs of the stored blocks, by digest of the case.

    Notes
    -----
    Blocks start at multiples of their size, so that 500 runs and then 500 more give the same blocks as 1000 at once.
    Only an incomplete last block is computed again. `execute.run` takes all blocks, and skips the stored blocks when it
    simulates.
    """
    card = campaign.monte_carlo
    if card is None:
        return []
    remaining_blocks = []
    for case in cases:
        runs = card.runs_of(case.axes)
        case_spans = stored_spans.get(case.id, ())
        for first in range(0, runs, card.block):
            count = min(card.block, runs - first)
            if (first, count) not in case_spans:
                remaining_blocks.append(Block(case, first, count))
    return remaining_blocks


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
    card = campaign.monte_carlo
    runs = {case.id: card.runs_of(case.axes) if card else 0 for case in all_cases}
    stored_spans = {case.id: [span(path) for path in paths(folder / "parts" / case.id)] for case in all_cases}
    remaining_blocks = blocks(campaign, all_cases, stored_spans)
    runs_to_do = dict.fromkeys(runs, 0)
    for block in remaining_blocks:
        runs_to_do[block.case.id] += block.n_run
    rows = [
        {
            "id": case.id,
            "label": case.label,
            "runs": runs[case.id],
            "done": runs[case.id] - runs_to_do[case.id],
        }
        for case in all_cases
    ]
    times = {case.id: duration[case.id] / campaign.keep.history for case in all_cases}
    block_bytes = sum(_block_bytes(block, times[block.case.id]) for block in remaining_blocks)
    table_bytes = sum(_table_bytes(case, times[case.id], runs[case.id]) for case in all_cases)
    return Estimate(
        cases=rows,
        blocks=len(remaining_blocks),
        seconds=_total_seconds(campaign, all_cases, remaining_blocks, duration),
        disk_mb=(block_bytes + table_bytes) / 1e6,
        memory_mb=_worker_bytes(campaign, all_cases, duration) / 1e6,
        blocks_mb=block_bytes / 1e6,
    )


def _total_seconds(
    campaign: Campaign, all_cases: Sequence[Case], remaining_blocks: Sequence[Block], duration: Mapping[str, float]
) -> float:
    """Return the computing time (s) of linear covariance of all cases and of the remaining blocks.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    all_cases : sequence of Case
        Its cases.
    remaining_blocks : sequence of Block
        Blocks still to be computed.
    duration : mapping of str to float
        Duration of the flight (s), by digest of the case.
    """
    linear = sum(_CASE_S + covariance_seconds(case, duration[case.id]) for case in all_cases)
    monte_carlo = sum(block.n_run * _run_seconds(block.case, duration[block.case.id]) for block in remaining_blocks)
    n_pass = 1 + _RETUNED * campaign.covariance.sensitivity
    return linear * n_pass + monte_carlo


def _worker_bytes(campaign: Campaign, all_cases: Sequence[Case], duration: Mapping[str, float]) -> float:
    """Return the memory (bytes) of a worker for the largest case.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    all_cases : sequence of Case
        Its cases.
    duration : mapping of str to float
        Duration of the flight (s), by digest of the case.
    """
    card = campaign.monte_carlo
    runs_at_once = min(card.runs, card.block) if card else 0
    largest = 0.0
    for case in all_cases:
        ticks = duration[case.id] * case.scenario.imu.rate
        history_times = duration[case.id] / campaign.keep.history
        tick_bytes = ticks * _TICK_BYTES
        history_bytes = runs_at_once * history_times * _HISTORY_BYTES
        largest = max(largest, tick_bytes + history_bytes)
    return _BASE_BYTES + largest


def _states(case: Case) -> int:
    """Return the number of filter states of a case."""
    card = case.scenario.filter
    n_states = 15 + 2 * card.tight + 6 * card.models_vehicle
    for name in card.extra_states:
        n_states += 3 * len(PARAMETERS[name].drivers) if name in PARAMETERS else 3
    return n_states


def _block_bytes(block: Block, times: float) -> float:
    columns = _COLUMNS * _states(block.case)
    bytes_per_run = _BIN_BYTES * times + _RUN_BYTES
    bytes_per_column = _SUM_BYTES * times + bytes_per_run * block.n_run
    return columns * bytes_per_column


def _table_bytes(case: Case, times: float, runs: int) -> float:
    columns = _COLUMNS * _states(case)
    bytes_per_time = _LINEAR_BYTES
    if runs > 0:
        bytes_per_time += _STATISTICS_BYTES
    bytes_per_column = bytes_per_time * times + _ROW_BYTES * runs
    return _CASE_BYTES + _TABLE_BYTES * times + columns * bytes_per_column


def _run_seconds(case: Case, duration: float) -> float:
    """Return the computing time (s) of a run."""
    scenario = case.scenario
    step_seconds = _STEP_S * _states(case) ** _STEP_POWER
    ticks_share = _TICK_S * scenario.imu.rate
    steps_share = step_seconds * scenario.filter.covariance_rate
    return float(duration * (ticks_share + steps_share))


def covariance_seconds(case: Case, duration: float) -> float:
    """Return the computing time (s) of the linear covariance of a case.

    Parameters
    ----------
    case : Case
        The case.
    duration : float
        Duration of its flight (s).
    """
    step = _COVARIANCE_S * _states(case) ** _COVARIANCE_POWER
    return float(duration * step * case.scenario.filter.covariance_rate)
