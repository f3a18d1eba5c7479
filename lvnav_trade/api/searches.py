"""Searches from Python: inverse questions, global sensitivity, tuning of a filter; each writes its report."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.api.types import Sensitivity, Solution, Tuning
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.errors import InputError
from lvnav_trade.store.contents import owned

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.definition.searches import Solve
    from lvnav_trade.report.blocks import Block

_FILTER_CARD = "filter.yaml"


def _jobs(jobs: int) -> int:
    return jobs if jobs > 0 else os.cpu_count() or 1


def _begun(campaign: str | Path, sets: Sequence[str], out: str | Path | None, search: str) -> tuple[Campaign, Path]:
    """Return a campaign and the folder of a search's page; InputError, before anything is computed, where it is not
    the tool's own.
    """
    found = load(campaign, sets)
    place = Path(out) if out is not None else Path("results") / f"{found.name}-{search}"
    owned(place, "report")
    return found, place


def _written(
    campaign: Campaign,
    place: Path,
    blocks: list[Block],
    made: Any,
    jobs: int,
    frames: Sequence[str],
    files: dict[str, str] | None = None,
) -> Path:
    """Write the page of what was made, with its tables and the time that it took; return the page."""
    from lvnav_trade.report import search as page
    from lvnav_trade.report.blocks import Text

    time = Text(f"Wall time {made.seconds:.0f} s with {_jobs(jobs)} worker processes.")
    tables = {name: getattr(made, name) for name in frames}
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
    """Find the largest value of a field that meets the requirements, or the case of the least cost that does.

    By linear covariance, with the filter re-tuned and frozen; runs on both sides of the answer confirm it. The question
    is the block `solve` of the campaign, unless `vary` or `least` states it.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    vary : sequence of str
        One field, or two for a boundary: ``initial.heading=0.01 deg:2 deg``.
    log : bool
        Search in the logarithm.
    meet : sequence of str
        Names of the requirements that count; all if empty.
    folder : str or Path, optional
        Folder of the report; ``results/NAME-solve`` if absent.
    jobs : int
        Worker processes, -1 for all cores.
    least : str
        cost, mass, power or volume: which case meets the requirements with the least of it.

    Returns
    -------
    Solution
        Answers by case, their confirmation by runs, the report.

    Raises
    ------
    InputError
        The campaign states no such question, or a field or requirement is unknown.
    """
    from lvnav_trade.campaign.search import solve as inverse

    found, place = _begun(campaign, sets, folder, "solve")
    asked = inverse.from_words(vary, log, meet, least) if vary or least else found.solve
    if asked is None:
        raise InputError(
            f"{campaign}: asks no inverse question; give --vary PATH=LEAST:LARGEST, --least cost, or a block solve"
        )
    return (_solved if asked.least is None else _chosen)(found, asked, place, jobs)


def _solved(campaign: Campaign, asked: Solve, place: Path, jobs: int) -> Solution:
    """Return the largest values that meet the requirements, with their report."""
    from lvnav_trade.campaign.search import solve as inverse
    from lvnav_trade.report import search as page

    solved = inverse.solve(campaign, asked, _jobs(jobs))
    blocks = page.solved(solved.answers, solved.intervals, solved.scanned, solved.confirmed, solved.names)
    frames = ("answers", "intervals", "scanned", "confirmed")
    written = _written(campaign, place, blocks, solved, jobs, frames)
    return Solution(solved.answers, solved.confirmed, solved.seconds, written)


def _chosen(campaign: Campaign, asked: Solve, place: Path, jobs: int) -> Solution:
    """Return the cases that meet the requirements with the least of a total, with their report."""
    from lvnav_trade.campaign.search import least as choice
    from lvnav_trade.report import search as page

    chosen = choice.least(campaign, asked, _jobs(jobs))
    blocks = page.chosen(chosen.answers, chosen.confirmed, chosen.least)
    written = _written(campaign, place, blocks, chosen, jobs, ("answers", "confirmed"))
    return Solution(chosen.answers, chosen.confirmed, chosen.seconds, written)


def indices(
    campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, jobs: int = -1
) -> Sensitivity:
    """Compute global sensitivity to the sigmas of error sources, as the block `indices` of a campaign states.

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
        Indices, how well the fit predicts, the report.

    Raises
    ------
    InputError
        The campaign has no block `indices`, or a mistake in it.
    """
    from lvnav_trade.campaign.search import indices as sensitivity
    from lvnav_trade.report import search as page

    found, place = _begun(campaign, sets, folder, "indices")
    if found.indices is None:
        raise InputError(f"{campaign}: asks for no sensitivity indices; give a block indices")
    made = sensitivity.indices(found, found.indices, _jobs(jobs))
    blocks = page.indexed(made.indices, made.case, made.error, made.covered, made.predicted, made.samples, made.remark)
    written = _written(found, place, blocks, made, jobs, ("indices",))
    return Sensitivity(
        made.indices, made.case, made.error, made.predicted, made.samples, made.remark, made.seconds, written
    )


def tune(campaign: str | Path, sets: Sequence[str] = (), folder: str | Path | None = None, jobs: int = -1) -> Tuning:
    """Tune a filter over several cases by linear covariance, as the block `tune` of a campaign states.

    Parameters
    ----------
    campaign : str or Path
        Campaign file, or name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    folder : str or Path, optional
        Folder of the report and the filter's card; ``results/NAME-tune`` if absent.
    jobs : int
        Worker processes, -1 for all cores.

    Returns
    -------
    Tuning
        Numbers before and after, cases, filter card, the report.

    Raises
    ------
    InputError
        The campaign has no block `tune`, or a mistake in it.
    """
    from lvnav_trade.campaign.search import tune as tuning
    from lvnav_trade.campaign.syntax.tree import dump
    from lvnav_trade.report import search as page

    found, place = _begun(campaign, sets, folder, "tune")
    if found.tune is None:
        raise InputError(f"{campaign}: tunes no filter; give a block tune")
    made = tuning.tune(found, found.tune, _jobs(jobs))
    card = dump(made.card.model_dump(mode="json", exclude_defaults=True))
    blocks = page.tuned(made.values, made.cases, made.card.source)
    written = _written(found, place, blocks, made, jobs, ("values", "cases"), {_FILTER_CARD: card})
    file = written.parent / _FILTER_CARD
    return Tuning(made.values, made.cases, made.card, file, made.evaluations, made.seconds, written)
