"""Which numbers of a card are assumed or second hand, field by field, with the reason."""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, BeforeValidator, Field, PlainSerializer, WithJsonSchema

from lvnav_trade.errors import quoted
from lvnav_trade.limits import MESSAGE_LENGTH

MARKS = ("assumed", "second_hand")
"""Fields of a card that mark others: a number without a source, and a number that another publication quotes."""
_FORM = "reasons by dotted path of a field, such as {gyro.scale_factor: typical of the class}"


def _pairs(value: Any) -> Any:
    """Return a mapping of fields to reasons as pairs; ValueError where a reason is missing."""
    if isinstance(value, tuple):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"should be {_FORM}")
    for path, reason in value.items():
        if not isinstance(reason, str) or not reason.strip():
            raise ValueError(f"{path}: a reason in words is missing")
        if len(reason) > MESSAGE_LENGTH:
            raise ValueError(f"{path}: the reason is longer than {MESSAGE_LENGTH} characters")
    return tuple((str(path), " ".join(reason.split())) for path, reason in value.items())


Marks = Annotated[
    tuple[tuple[str, str], ...],
    BeforeValidator(_pairs),
    PlainSerializer(dict, return_type=dict[str, str]),
    WithJsonSchema({"type": "object", "additionalProperties": {"type": "string"}, "description": _FORM}),
]


class Mark(NamedTuple):
    """A marked field of resolved settings.

    card : dotted path of the card that marks it, empty at the top
    name : name of that card
    field : dotted path of the field within the card
    mark : "assumed" or "second hand"
    value : what the resolved settings have there
    reason : as the card states it
    """

    card: str
    name: str
    field: str
    mark: str
    value: Any
    reason: str


def misnamed(card: BaseModel) -> Iterator[str]:
    """Yield what is wrong with the marks of a card: a path that is no field of it, a field with both marks."""
    both = {path for path, _ in getattr(card, MARKS[0])} & {path for path, _ in getattr(card, MARKS[1])}
    for mark in MARKS:
        for path, _ in getattr(card, mark):
            if path in both:
                yield f"{mark}.{path}: marked as assumed and as second hand; leave one"
            elif wrong := _stray(card, path):
                yield f"{mark}.{path}: {wrong}"


def _stray(card: BaseModel, path: str) -> str:
    """Return which step of a path leads nowhere, empty where it names a field."""
    found: list[Any] = [card]
    for step in path.split("."):
        known = [name for one in found for name in _fields(one)]
        if step in MARKS or step not in known:
            near = difflib.get_close_matches(step, known, 1)
            hint = f"did you mean {quoted(near[0])}?" if near else f"known: {', '.join(dict.fromkeys(known)) or 'none'}"
            return f"{quoted(step)} is not a field of the card ({hint})"
        found = [below for one in found for below in _below(one, step)]
    return ""


def _fields(value: Any) -> Iterable[str]:
    """Return the steps that lead on from a value; from a list its numbers, and the fields of its items."""
    if isinstance(value, BaseModel):
        return [info.alias or name for name, info in type(value).model_fields.items()]
    if isinstance(value, tuple):
        return [*map(str, range(len(value))), *(name for one in value for name in _fields(one))]
    return map(str, value) if isinstance(value, Mapping) else ()


def _below(value: Any, step: str) -> list[Any]:
    """Return the values one step below: of a list an item, or that field of every item that has it."""
    if isinstance(value, BaseModel):
        names = {info.alias or name: name for name, info in type(value).model_fields.items()}
        return [getattr(value, names[step])] if step in names else []
    if isinstance(value, tuple | list):
        if step.isdigit():
            return [value[int(step)]] if int(step) < len(value) else []
        return [below for one in value for below in _below(one, step)]
    return [value[step]] if isinstance(value, Mapping) and step in value else []


def marks_in(data: Any, path: str = "") -> Iterator[Mark]:
    """Yield the marks within resolved settings (dictionaries, lists, scalars); path: where these are."""
    if isinstance(data, Mapping):
        for mark in MARKS:
            for field, reason in data[mark].items() if _is_marks(data, mark) else ():
                values: list[Any] = [data]
                for step in field.split("."):
                    values = [below for one in values for below in _below(one, step)]
                distinct = list({str(one): one for one in values}.values())
                value = distinct[0] if len(distinct) == 1 else distinct
                yield Mark(path, str(data.get("name") or ""), field, mark.replace("_", " "), value, str(reason))
        for key, below in data.items():
            yield from marks_in(below, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list) and data and isinstance(data[0], Mapping):
        for number, below in enumerate(data):
            yield from marks_in(below, f"{path}.{number}")


def without_marks(data: Any) -> Any:
    """Return settings (dictionaries, lists, scalars) without their marks: what is computed does not depend on them."""
    if isinstance(data, list):
        return [without_marks(one) for one in data]
    if not isinstance(data, Mapping):
        return data
    return {key: without_marks(below) for key, below in data.items() if not _is_marks(data, key)}


def unmarked(data: Any, steps: Sequence[str]) -> Any:
    """Return a mapping without its marks of what another value is about to replace: the field at `steps`, and all that
    is below it.
    """
    if not isinstance(data, Mapping):
        return data
    found = dict(data)
    for mark in MARKS:
        if _is_marks(data, mark):
            found[mark] = {path: one for path, one in data[mark].items() if path.split(".")[: len(steps)] != [*steps]}
    return found


def _is_marks(data: Mapping[str, Any], key: str) -> bool:
    """Return whether a key of a mapping has its marks, and is not one of the user's own names."""
    value = data.get(key)
    return key in MARKS and isinstance(value, Mapping) and all(isinstance(one, str) for one in value.values())


ASSUMED = Field((), description="fields whose numbers have no source; they are listed in the report")
SECOND_HAND = Field((), description="fields whose numbers are those that another publication quotes; listed likewise")
