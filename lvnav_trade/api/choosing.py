"""One case of a campaign, by its digest or label."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.campaign.running.replay import find
from lvnav_trade.campaign.space.designs import Designs, number_in
from lvnav_trade.quantities.errors import InputError

_DIGITS = 6  # fewest digits of a digest that identify one of many designs


def case_of(campaign: str | Path | Campaign, sets: Sequence[str], case: str | None) -> tuple[Campaign, Case]:
    """Return a campaign and one of its cases.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``. They apply to a file and not to a loaded campaign.
    case : str or None
        Label of the case, its digest, or the first digits of its digest; the first case if None.

    Returns
    -------
    Campaign, Case
        The campaign and the case.

    Raises
    ------
    InputError
        The campaign has an input error, or the text fits no case or several.
    """
    loaded = campaign if isinstance(campaign, Campaign) else load_campaign(campaign, sets)
    if loaded.is_space:
        return loaded, _design(Designs(loaded), case)
    all_cases = cases(loaded)
    return loaded, find(all_cases, case) if case else all_cases[0]


def _design(designs: Designs, wanted: str | None) -> Case:
    """Return the design with a digest, its first digits, or a label (``design 12``); the first design if None."""
    number = None if wanted is None else number_in(wanted)
    if number is not None and number < len(designs):
        return designs.case(number)
    for case in designs.cases():
        if wanted is None or case.label == wanted or (len(wanted) >= _DIGITS and case.id.startswith(wanted)):
            return case
    raise InputError(f"no case {wanted!r} among {len(designs)} designs; give {_DIGITS} digits of its digest or more")
