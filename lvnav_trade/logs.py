"""Recorded data from Python: the card of an inertial unit from its log, a log through the filters of a campaign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lvnav_trade.errors import writing

if TYPE_CHECKING:
    from lvnav_trade.campaign.recorded import Processed
    from lvnav_trade.campaign.unit_card import FittedUnit


def fit_unit(
    log: str | Path,
    card: str | Path,
    plot: str | Path | None = None,
    start: float | None = None,
    end: float | None = None,
    shortest: float = 0.0,
    longest: float = math.inf,
) -> FittedUnit:
    """Write the card of a unit from its log at rest, and its Allan deviation as PNG to `plot`; return the fit.

    start, end : part of the log, s after its first row; shortest, longest : averaging times (s) that are fitted

    InputError where the log cannot be read, has gaps, is uneven or too short: nothing has been written.
    """
    from lvnav_trade.campaign import unit_card
    from lvnav_trade.campaign.syntax.cards import write_text
    from lvnav_trade.plots.inertial import allan_of_log
    from lvnav_trade.plots.raster import written

    found = unit_card.fit_unit(str(log), start, end, shortest, longest)
    write_text(Path(card), found.text)
    if plot is not None:
        with writing(plot, "the figure cannot be written there"):
            Path(plot).write_bytes(written(allan_of_log(found.curves), "png"))
    return found


def process_log(
    campaign: str | Path,
    log: str | Path,
    folder: str | Path,
    lengths: Sequence[float] = (15.0, 60.0),
    first: float = 20.0,
    every: float = 5.0,
    sets: Sequence[str] = (),
) -> Processed:
    """Run a recorded log, named by its card, through the filters of a campaign; write page and tables to a folder.

    lengths (s) of the outages that are withheld, the first from `first` s after the rest on, then every so many s;
    sets: changes of the campaign, PATH=VALUE.

    InputError where campaign or log cannot be read, or a filter takes what the log has not: nothing has been written.
    """
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.campaign.recorded import Asked, process
    from lvnav_trade.report.build import html_page, markdown_page, pictures
    from lvnav_trade.report.escape import csv_text
    from lvnav_trade.report.recorded import page
    from lvnav_trade.store.contents import owned

    target, loaded = owned(folder, "report"), load(campaign, sets)
    done = process(loaded, Path(log), Asked(tuple(lengths), first, every))
    made = page(done, loaded)
    tables = {"outages.csv": done.outages, "summary.csv": done.summary, "track.csv": done.track}
    with writing(folder, "the page cannot be written there"):
        files = {name: csv_text(frame) for name, frame in tables.items()}
        pages = {"report.html": html_page(*made), "report.md": markdown_page(*made)}
        target.publish("report", {**files, **pages, **pictures(made[2])})
    return done
