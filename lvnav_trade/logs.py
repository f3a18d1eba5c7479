"""Recorded data from Python: the card of an inertial unit from its log."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from lvnav_trade.errors import writing

if TYPE_CHECKING:
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
