"""Searches from Python: inverse questions, global sensitivity, tuning of a filter; each writes its page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.errors import InputError
from lvnav_trade.store.contents import owned

if TYPE_CHECKING:
    from lvnav_trade.campaign.search.indices import Indexed
    from lvnav_trade.campaign.search.solve import Solved
    from lvnav_trade.campaign.search.tune import Tuned


def _jobs(jobs: int) -> int:
    return jobs if jobs > 0 else os.cpu_count() or 1


def solve(
    campaign: str | Path,
    sets: Sequence[str] = (),
    vary: Sequence[str] = (),
    log: bool = False,
    meet: Sequence[str] = (),
    out: str | Path | None = None,
    jobs: int = -1,
) -> tuple[Solved, Path]:
    """Answer the inverse question of a campaign (its block `solve`, or `vary`, `log`, `meet`); return it and its page.

    vary : ``initial.heading=0.01 deg:2 deg``, one or two
    out : folder of the page; ``results/NAME-solve`` if absent

    InputError where the campaign asks no such question.
    """
    from lvnav_trade.campaign.search import solve as inverse
    from lvnav_trade.report import search as page
    from lvnav_trade.report.blocks import Text

    found = load(campaign, sets)
    asked = inverse.from_words(vary, log, meet) if vary else found.solve
    if asked is None:
        raise InputError(f"{campaign}: asks no inverse question; give --vary PATH=LEAST:LARGEST, or a block solve")
    place = Path(out) if out is not None else Path("results") / f"{found.name}-solve"
    owned(place, "report")  # refused before anything is computed
    solved = inverse.solve(found, asked, _jobs(jobs))
    blocks = page.solved(solved.answers, solved.scanned, solved.confirmed, solved.names)
    blocks.append(Text(f"Wall time {solved.seconds:.0f} s with {_jobs(jobs)} worker processes."))
    frames = {"answers": solved.answers, "scanned": solved.scanned, "confirmed": solved.confirmed}
    return solved, page.write(place, found.name, found.description, blocks, frames)


def indices(
    campaign: str | Path, sets: Sequence[str] = (), out: str | Path | None = None, jobs: int = -1
) -> tuple[Indexed, Path]:
    """Compute the global sensitivity that the block `indices` of a campaign asks for; return it and its page.

    out : folder of the page; ``results/NAME-indices`` if absent
    """
    from lvnav_trade.campaign.search import indices as sensitivity
    from lvnav_trade.report import search as page
    from lvnav_trade.report.blocks import Text

    found = load(campaign, sets)
    if found.indices is None:
        raise InputError(f"{campaign}: asks for no sensitivity indices; give a block indices")
    place = Path(out) if out is not None else Path("results") / f"{found.name}-indices"
    owned(place, "report")  # refused before anything is computed
    made = sensitivity.indices(found, found.indices, _jobs(jobs))
    blocks = page.indexed(made.frame, made.case, made.error, made.covered, made.predicted, made.samples)
    blocks.append(Text(f"Wall time {made.seconds:.0f} s with {_jobs(jobs)} worker processes."))
    return made, page.write(place, found.name, found.description, blocks, {"indices": made.frame})


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
    from lvnav_trade.report.blocks import Text

    found = load(campaign, sets)
    if found.tune is None:
        raise InputError(f"{campaign}: tunes no filter; give a block tune")
    place = Path(out) if out is not None else Path("results") / f"{found.name}-tune"
    owned(place, "report")  # refused before anything is computed
    made = tuning.tune(found, found.tune, _jobs(jobs))
    blocks = page.tuned(made.values, made.cases)
    words = (
        f"{made.evaluations} looks at all cases; wall time {made.seconds:.0f} s with {_jobs(jobs)} worker processes."
    )
    blocks.append(Text(words))
    card = dump(made.card.model_dump(mode="json", exclude_defaults=True))
    frames = {"values": made.values, "cases": made.cases}
    return made, page.write(place, found.name, found.description, blocks, frames, {"filter.yaml": card})
