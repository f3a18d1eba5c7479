"""What leaves the tool, from Python: the filter of a case as C."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.filter_code import FilterCode


def export_filter(
    campaign: str | Path | Campaign,
    folder: str | Path,
    case: str | None = None,
    runs: int = 10,
    sets: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> FilterCode:
    """Write the filter of a case (the first if none is named) as C99 to a folder, with runs to replay it on.

    runs : how many are recorded; where a C compiler is, they are replayed at once
    progress : called with what is being done

    InputError for a mistake in the campaign, redundant inertial units, or a folder that holds anything else: nothing
    has been written.
    """
    from lvnav_trade.api import case_of
    from lvnav_trade.campaign.filter_code import filter_code
    from lvnav_trade.store.contents import owned

    target = owned(folder, "code")
    found = filter_code(*case_of(campaign, sets, case), runs, progress)
    target.publish("code", found.files)
    return found
