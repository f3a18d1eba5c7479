"""Searches from Python: inverse questions, global sensitivity, tuning of a filter; each writes its page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.errors import InputError
from lvnav_trade.store.contents import owned

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.search.indices import Indexed
    from lvnav_trade.campaign.search.least import Chosen
    from lvnav_trade.campaign.search.solve import Solved
    from lvnav_trade.campaign.search.tune import Tuned
    from lvnav_trade.report.blocks import Block


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
    campaign: Campaign, place: Path, blocks: list[Block], made: Any, jobs: int, frames: Sequence[str],
    files: dict[str, str] | None = None,
) -> Path:  # fmt: skip
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
    out: str | Path | None = None,
    jobs: int = -1,
    least: str = "",
) -> tuple[Solved | Chosen, Path]:
    """Answer the inverse question of a campaign (its block `solve`, or `vary`, `log`, `meet`, `least`); return it and
    its page.

    vary : ``initial.heading=0.01 deg:2 deg``, one or two
    least : ``cost``: which case meets the requirements and costs least
    out : folder of the page; ``results/NAME-solve`` if absent

    InputError where the campaign asks no such question.
    """
    from lvnav_trade.campaign.search import least as choice
    from lvnav_trade.campaign.search import solve as inverse
    from lvnav_trade.report import search as page

    found, place = _begun(campaign, sets, out, "solve")
    asked = inverse.from_words(vary, log, meet, least) if vary or least else found.solve
    if asked is None:
        raise InputError(
            f"{campaign}: asks no inverse question; give --vary PATH=LEAST:LARGEST, --least cost, or a block solve"
        )
    if asked.least is not None:
        chosen = choice.least(found, asked, _jobs(jobs))
        blocks = page.chosen(chosen.answers, chosen.confirmed, chosen.least)
        return chosen, _written(found, place, blocks, chosen, jobs, ("answers", "confirmed"))
    solved = inverse.solve(found, asked, _jobs(jobs))
    blocks = page.solved(solved.answers, solved.intervals, solved.scanned, solved.confirmed, solved.names)
    frames = ("answers", "intervals", "scanned", "confirmed")
    return solved, _written(found, place, blocks, solved, jobs, frames)


def indices(
    campaign: str | Path, sets: Sequence[str] = (), out: str | Path | None = None, jobs: int = -1
) -> tuple[Indexed, Path]:
    """Compute the global sensitivity that the block `indices` of a campaign asks for; return it and its page.

    out : folder of the page; ``results/NAME-indices`` if absent
    """
    from lvnav_trade.campaign.search import indices as sensitivity
    from lvnav_trade.report import search as page

    found, place = _begun(campaign, sets, out, "indices")
    if found.indices is None:
        raise InputError(f"{campaign}: asks for no sensitivity indices; give a block indices")
    made = sensitivity.indices(found, found.indices, _jobs(jobs))
    blocks = page.indexed(made.indices, made.case, made.error, made.covered, made.predicted, made.samples)
    return made, _written(found, place, blocks, made, jobs, ("indices",))


def tune(
    campaign: str | Path, sets: Sequence[str] = (), out: str | Path | None = None, jobs: int = -1
) -> tuple[Tuned, Path]:
    """Tune the filter as the block `tune` of a campaign asks; return what was found and its page, beside which stands
    the card (``filter.yaml``).

    out : folder of the page; ``results/NAME-tune`` if absent
    """
    from lvnav_trade.campaign.search import tune as tuning
    from lvnav_trade.campaign.syntax.tree import dump
    from lvnav_trade.report import search as page

    found, place = _begun(campaign, sets, out, "tune")
    if found.tune is None:
        raise InputError(f"{campaign}: tunes no filter; give a block tune")
    made = tuning.tune(found, found.tune, _jobs(jobs))
    frames = ("values", "cases")
    card = dump(made.card.model_dump(mode="json", exclude_defaults=True))
    blocks = page.tuned(made.values, made.cases, made.card.source)
    return made, _written(found, place, blocks, made, jobs, frames, {"filter.yaml": card})
