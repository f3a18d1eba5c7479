"""One case of a campaign, by its digest or label."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running.replay import find
from lvnav_trade.campaign.space.designs import Designs, number_in
from lvnav_trade.errors import InputError

_DIGITS = 6  # of a digest that names one of many designs


def case_of(campaign: str | Path | Campaign, sets: Sequence[str], case: str | None) -> tuple[Campaign, Case]:
    """Return a campaign and one of its cases.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``; of a file only.
    case : str or None
        Label of the case, or its digest or the beginning of it; the first case if None.

    Returns
    -------
    Campaign, Case
        The campaign and the case.

    Raises
    ------
    InputError
        A mistake in the campaign, no such case or several.
    """
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, sets)
    if loaded.is_space:
        return loaded, _design(Designs(loaded), case)
    every = cases(loaded)
    return loaded, find(every, case) if case else every[0]


def _design(designs: Designs, wanted: str | None) -> Case:
    """Return the design of a digest, the beginning of one, or a label (``design 12``); the first without any."""
    number = None if wanted is None else number_in(wanted)
    if number is not None and number < len(designs):
        return designs.case(number)
    for case in designs.cases():
        if wanted is None or case.label == wanted or (len(wanted) >= _DIGITS and case.id.startswith(wanted)):
            return case
    raise InputError(f"no case {wanted!r} among {len(designs)} designs; give {_DIGITS} digits of its digest or more")
