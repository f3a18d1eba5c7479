"""What a campaign takes before it runs: cases, blocks of runs, what is done already, time, memory, disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from lvnav_trade.campaign.axes import Case
from lvnav_trade.campaign.schema import Campaign


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
