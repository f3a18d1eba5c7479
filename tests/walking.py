"""Walks over the fields of a card as it is written, and digests of what is made of it."""

from __future__ import annotations

import copy
import datetime
import hashlib
import re
from collections.abc import Callable, Iterator, Set
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from lvnav_trade.quantities.errors import InputError

LABELS = {"kind", "name", "source", "resources", "assumed", "second_hand"}
"""What names a card and says where it is from; both stand in the report, no engine reads them."""
_FACTORS = (1.7, 0.1, 1e-6)
_ALIKE = 2  # members of a list of cards of one kind that are walked
Way = tuple[str | int, ...]


def others(value: Any) -> Iterator[Any]:
    """Yield other values of a field of a resolved card, as it is written: numbers grow and shrink, dates move on."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield value + 1
    elif isinstance(value, float) and value == 0.0:
        yield 0.3
    elif isinstance(value, float):
        yield from (factor * value for factor in _FACTORS)
    elif isinstance(value, str):
        if re.match(r"\d{4}-\d\d-\d\dT", value):
            yield (datetime.datetime.fromisoformat(value) + datetime.timedelta(days=1.1)).isoformat()
            return
        number, _, unit = value.partition(" ")
        try:
            other = [factor * float(number) for factor in _FACTORS] if float(number) != 0.0 else [0.3]
        except ValueError:
            return
        yield from (f"{one!r} {unit}".strip() for one in other)
    elif isinstance(value, list):
        for index, one in enumerate(value):
            for other in others(one):
                yield [*value[:index], other, *value[index + 1 :]]


def words(read: Callable[[Any], object], other: Callable[[Any], Any], way: Way) -> list[str]:
    """Return the words that a field takes, as the refusal of one that it does not take lists them."""
    try:
        read(other("?"))
    except ValidationError as error:
        for one in error.errors():
            if one["type"] == "literal_error" and one["loc"][-1:] == way[-1:]:
                return re.findall(r"'(\w+)'", one["ctx"]["expected"])
    except ValueError:
        pass
    return []


def leaves(text: Any, without: Set[str], way: Way = ()) -> Iterator[tuple[Way, Any]]:
    """Yield the fields of a resolved card, each with the keys that lead to it; of like cards in a list the first two.

    without: names of fields that are passed over.
    """
    if isinstance(text, dict):
        for name, value in text.items():
            if name not in without:
                yield from leaves(value, without, (*way, name))
    elif isinstance(text, list) and text and isinstance(text[0], dict):
        for index, value in enumerate(text[:_ALIKE]):
            yield from leaves(value, without, (*way, index))
    elif text is not None:
        yield way, text


def replaced(text: Any, way: Way, value: Any) -> Any:
    """Return the text of a card, the field at the end of a way being of another value."""
    found = copy.deepcopy(text)
    at = found
    for key in way[:-1]:
        at = at[key]
    at[way[-1]] = value
    return found


def idle(card: BaseModel, compute: Callable[[Any], str], without: Set[str] = frozenset()) -> list[str]:
    """Return the fields of a card whose every other value is accepted, and changes nothing that is computed.

    compute: digest of what is made of a card; without: names of fields that are passed over, beside its labels.
    """
    text, read = card.model_dump(mode="json", by_alias=True), type(card).model_validate
    itself, found = compute(read(text)), []
    for way, value in leaves(text, LABELS | without):

        def other(new: Any, way: Way = way) -> Any:
            return replaced(text, way, new)

        choices = [*others(value)] or [word for word in words(read, other, way) if word != value]
        if choices and not any(_acts(lambda new: compute(read(other(new))), new, itself) for new in choices):
            found.append(".".join(map(str, way)))
    return found


def _acts(of: Callable[[Any], str], new: Any, itself: str) -> bool:
    try:
        return of(new) != itself
    except (ValueError, InputError):
        return True


def digest(*values: Any) -> str:
    """Digest of every number and word in records, arrays and cards; functions are left out."""
    found = hashlib.sha256()

    def enter(one: Any) -> None:
        if isinstance(one, BaseModel):
            return
        if isinstance(one, np.ndarray):
            found.update(str(one.shape).encode() + np.ascontiguousarray(one).tobytes())
        elif isinstance(one, tuple | list):
            for each in one:
                enter(each)
        elif isinstance(one, dict):
            for key in sorted(one):
                enter((key, one[key]))
        elif isinstance(one, int | float | str | np.generic):
            found.update(repr(one).encode())

    enter(values)
    return found.hexdigest()
