"""Searches from Python: inverse problems, global sensitivity, filter tuning. Each search writes its own report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.api.types import Sensitivity, Solution, Tuning
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.contents import owned_folder

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.definition.searches import Solve
    from lvnav_trade.report.blocks import Block

_FILTER_CARD = "filter.yaml"


def _worker_count(jobs: int) -> int:
    """Return the number of worker processes, all cores for -1."""
    return jobs if jobs > 0 else os.cpu_count() or 1


def _campaign_and_folder(
    campaign: str | Path, sets: Sequence[str], folder: str | Path | None, search: str
) -> tuple[Campaign, Path]:
    """Return a campaign and the folder of the search's report.

    A folder with other files raises an InputError here, before anything is computed.
    """
    loaded_campaign = load(campaign, sets)
    place = Path(folder) if folder is not None else Path("results") / f"{loaded_campaign.name}-{search}"
    owned_folder(place, "report")
    return loaded_campaign, place


def _write_report(
    campaign: Campaign,
    place: Path,
    blocks: list[Block],
    result: Any,
    jobs: int,
    frames: Sequence[str],
    files: dict[str, str] | None = None,
) -> Path:
    """Write the report of a search result, with the wall time and the tables named in `frames`; return its file."""
    from lvnav_trade.report import search as page
    from lvnav_trade.report.blocks import Text

    time = Text(f"Wall time {result.seconds:.0f} s with {_worker_count(jobs)} worker processes.")
    tables = {name: getattr(result, name) for name in frames}
    return page.write(place, campaign.name, campaign.description, [*blocks, time], tables, files)


def solve(
    campaign: str | Path,
    sets: Sequence[str] = (),
    vary: Sequence[str] = (),
    log: bool = False,
    meet: Sequence[str] = (),
    folder: str | Path | None = None,
    jobs: int = -1,
    least: str = "",
) -> Solution:
    """Find the largest value of a field that meets the requirements, or the least expensive case that meets them.

    The search uses linear covariance, with the filter re-tuned to each value and with the filter frozen. Monte Carlo
    runs on both sides of the result confirm it. The problem is defined by the block `solve` of the campaign, or by
    `vary` or `least`.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    vary : sequence of str
        One field with its range, or two for a boundary: ``initial.heading=0.01 deg:2 deg``.
    log : bool
        Search on a logarithmic scale of the field.
    meet : sequence of str
        Names of the requirements to meet; all if empty.
    folder : str or Path, optional
        Folder of the report; ``results/NAME-solve`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    least : str
        Quantity to minimise over the cases that meet the requirements: cost, mass, power or volume.

    Returns
    -------
    Solution
        Results by case, their confirmation by runs, the report.

    Raises
    ------
    InputError
        The campaign defines no such problem, or a field or requirement is unknown.
    """
    from lvnav_trade.campaign.search import solve as inverse

    loaded_campaign, place = _campaign_and_folder(campaign, sets, folder, "solve")
    problem = inverse.parse_problem(vary, log, meet, least) if vary or least else loaded_campaign.solve
    if problem is None:
        raise InputError(
            f"{campaign}: asks no inverse question; give --vary PATH=LEAST:LARGEST, --least cost, or a block solve"
        )
    if problem.least is None:
        return _largest_values(loaded_campaign, problem, place, jobs)
    return _least_cases(loaded_campaign, problem, place, jobs)


def _largest_values(campaign: Campaign, problem: Solve, place: Path, jobs: int) -> Solution:
    """Return the largest values that meet the requirements, and write their report."""
    from lvnav_trade.campaign.search import solve as inverse
    from lvnav_trade.report import search as page

    solution = inverse.solve(campaign, problem, _worker_count(jobs))
    blocks = page.solution_blocks(
        solution.answers, solution.intervals, solution.scanned, solution.confirmed, solution.names
    )
    frames = ("answers", "intervals", "scanned", "confirmed")
    file = _write_report(campaign, place, blocks, solution, jobs, frames)
    return Solution(solution.answers, solution.confirmed, solution.seconds, file)


def _least_cases(campaign: Campaign, problem: Solve, place: Path, jobs: int) -> Solution:
    """Return the cases that meet the requirements at the least total cost, mass, power or volume; write their report.

    Which total is minimised is a setting of the problem.
    """
    from lvnav_trade.campaign.search import least as choice
    from lvnav_trade.report import search as page

    choices = choice.least_total_case(campaign, problem, _worker_count(jobs))
    blocks = page.least_case_blocks(choices.answers, choices.confirmed, choices.total_column)
    file = _write_report(campaign, place, blocks, choices, jobs, ("answers", "confirmed"))
    return Solution(choices.answers, choices.confirmed, choices.seconds, file)


def indices(
    campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, jobs: int = -1
) -> Sensitivity:
    """Compute the global sensitivity of an error to the sigmas of its sources, as defined by the block `indices`.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    folder : str or Path, optional
        Folder of the report; ``results/NAME-indices`` if absent.
    jobs : int
        Worker processes, -1 for all cores.

    Returns
    -------
    Sensitivity
        Sensitivity indices, quality of the fit, the report.

    Raises
    ------
    InputError
        The campaign has no block `indices`, or an input error.
    """
    from lvnav_trade.campaign.search import indices as sensitivity
    from lvnav_trade.report import search as page

    loaded_campaign, place = _campaign_and_folder(campaign, sets, folder, "indices")
    if loaded_campaign.indices is None:
        raise InputError(f"{campaign}: has no block indices; add one to compute sensitivity indices")
    result = sensitivity.indices(loaded_campaign, loaded_campaign.indices, _worker_count(jobs))
    blocks = page.sensitivity_blocks(
        result.indices,
        result.case,
        result.error,
        result.covered_share,
        result.determination,
        result.samples,
        result.remark,
    )
    file = _write_report(loaded_campaign, place, blocks, result, jobs, ("indices",))
    return Sensitivity(
        result.indices,
        result.case,
        result.error,
        result.determination,
        result.samples,
        result.remark,
        result.seconds,
        file,
    )


def tune(campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, jobs: int = -1) -> Tuning:
    """Tune a filter over several cases by linear covariance, as defined by the block `tune` of a campaign.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    folder : str or Path, optional
        Folder of the report and the filter card; ``results/NAME-tune`` if absent.
    jobs : int
        Worker processes, -1 for all cores.

    Returns
    -------
    Tuning
        Settings before and after, cases, filter card, the report.

    Raises
    ------
    InputError
        The campaign has no block `tune`, or an input error.
    """
    from lvnav_trade.campaign.search import tune as tuning
    from lvnav_trade.campaign.syntax.tree import dump
    from lvnav_trade.report import search as page

    loaded_campaign, place = _campaign_and_folder(campaign, sets, folder, "tune")
    if loaded_campaign.tune is None:
        raise InputError(f"{campaign}: tunes no filter; give a block tune")
    result = tuning.tune(loaded_campaign, loaded_campaign.tune, _worker_count(jobs))
    card = dump(result.card.model_dump(mode="json", exclude_defaults=True))
    blocks = page.tuning_blocks(result.values, result.cases, result.card.source)
    report = _write_report(loaded_campaign, place, blocks, result, jobs, ("values", "cases"), {_FILTER_CARD: card})
    return Tuning(
        result.values,
        result.cases,
        result.card,
        report.parent / _FILTER_CARD,
        result.evaluations,
        result.seconds,
        report,
    )
