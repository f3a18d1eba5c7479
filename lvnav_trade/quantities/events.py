"""Times by the name of an event: "stage1_cutoff + 20 s"."""

import difflib
import re
from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.units import parse

_TIMED = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)\s*(?:(?P<sign>[+-])\s*(?P<offset>\S.*))?$")


def resolve(text: str, events: Mapping[str, float]) -> float:
    """Return the time, in s since lift-off, of an event, an event plus or minus a duration, or a plain time.

    Parameters
    ----------
    text : str
        Such as ``"stage1_cutoff"``, ``"stage1_cutoff + 20 s"`` or ``"100 s"``.
    events : mapping
        Times (s) of the events of the flight.

    Raises
    ------
    InputError
        The flight has no such event (the message offers the nearest name), or the duration has no unit.
    """
    match = _TIMED.match(text)
    if match is None:
        return _seconds(text, text)
    name = match["name"]
    if name not in events:
        near = difflib.get_close_matches(name, list(events), n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"the flight has {', '.join(events)}"
        raise InputError(f"{text!r}: no event {name!r} ({hint})")
    offset = _seconds(match["offset"], text) if match["offset"] else 0.0
    return events[name] + (-offset if match["sign"] == "-" else offset)


def _seconds(part: str, text: str) -> float:
    try:
        return parse(part.strip(), "s")
    except ValueError as error:
        raise InputError(f"{text!r} is not a time: {error}") from None


def _instant(text: str) -> str:
    """Return the text after a check of its duration; ValueError if that is no time. Events are checked later."""
    match = _TIMED.match(text)
    part = text if match is None else match["offset"]
    try:
        parse((part or "0 s").strip(), "s")
    except ValueError as error:
        raise ValueError(f"{text!r} is not a time: {error}") from None
    return text


Instant = Annotated[str, AfterValidator(_instant)]
"""Text for `resolve`. The unit is checked when the card is read, the event when the flight is known."""
