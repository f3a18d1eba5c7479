"""Marks on the fields of a card: numbers that are assumed or second hand, each with the reason."""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, BeforeValidator, Field, PlainSerializer, WithJsonSchema

from lvnav_trade.quantities.errors import quoted
from lvnav_trade.quantities.input_limits import MESSAGE_LENGTH

MARKS = ("assumed", "second_hand")
"""Fields of a card that mark others: a number without a source, and a number that another publication quotes."""
_FORM = "reasons by dotted path of a field, such as {gyro.scale_factor: typical of the class}"


def _pairs(value: Any) -> Any:
    """Return a mapping of fields to reasons as pairs; ValueError if a reason is missing or too long."""
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


class MarkedField(NamedTuple):
    """A marked field of resolved settings.

    card : Dotted path of the card with the mark, empty at the top.
    name : Name of that card.
    field : Dotted path of the field within the card.
    mark : "assumed" or "second hand".
    value : Value of the field in the resolved settings.
    reason : Reason given by the card.
    """

    card: str
    name: str
    field: str
    mark: str
    value: Any
    reason: str


def mark_faults(card: BaseModel) -> Iterator[str]:
    """Yield the input errors of a card's marks: a path that is no field of the card, a field with both marks."""
    assumed_paths = {path for path, _ in getattr(card, MARKS[0])}
    second_hand_paths = {path for path, _ in getattr(card, MARKS[1])}
    repeated_paths = assumed_paths & second_hand_paths
    for mark in MARKS:
        for path, _ in getattr(card, mark):
            if path in repeated_paths:
                yield f"{mark}.{path}: marked as assumed and as second hand; leave one"
            elif fault := _path_fault(card, path):
                yield f"{mark}.{path}: {fault}"


def _path_fault(card: BaseModel, path: str) -> str:
    """Return the error of the first step of a path that is no field; empty if the whole path is a field."""
    values: list[Any] = [card]
    for step in path.split("."):
        fields = [name for value in values for name in _fields(value)]
        if step in MARKS or step not in fields:
            near = difflib.get_close_matches(step, fields, 1)
            if near:
                hint = f"did you mean {quoted(near[0])}?"
            else:
                hint = f"known: {', '.join(dict.fromkeys(fields)) or 'none'}"
            return f"{quoted(step)} is not a field of the card ({hint})"
        values = _all_child_values(values, step)
    return ""


def _all_child_values(values: list[Any], step: str) -> list[Any]:
    return [child for value in values for child in _child_values(value, step)]


def _fields(value: Any) -> Iterable[str]:
    """Return the path steps below a value: fields or keys; of a list its indices and the fields of its items."""
    if isinstance(value, BaseModel):
        return [info.alias or name for name, info in type(value).model_fields.items()]
    if isinstance(value, tuple):
        steps = [str(index) for index in range(len(value))]
        for item in value:
            steps += _fields(item)
        return steps
    return map(str, value) if isinstance(value, Mapping) else ()


def _child_values(value: Any, step: str) -> list[Any]:
    """Return the values one path step below; of a list the item with that index, or that field of each item."""
    if isinstance(value, BaseModel):
        names = {info.alias or name: name for name, info in type(value).model_fields.items()}
        return [getattr(value, names[step])] if step in names else []
    if isinstance(value, tuple | list):
        if step.isdigit():
            index = int(step)
            return [value[index]] if index < len(value) else []
        return _all_child_values(list(value), step)
    return [value[step]] if isinstance(value, Mapping) and step in value else []


def marks_in(data: Any, path: str = "") -> Iterator[MarkedField]:
    """Yield the marks within resolved settings (dictionaries, lists, scalars).

    path : Dotted path of `data` within the settings.
    """
    if isinstance(data, Mapping):
        for mark in MARKS:
            if not _is_marks(data, mark):
                continue
            for field, reason in data[mark].items():
                yield MarkedField(
                    card=path,
                    name=str(data.get("name") or ""),
                    field=field,
                    mark=mark.replace("_", " "),
                    value=_marked_value(data, field),
                    reason=str(reason),
                )
        for key, child in data.items():
            yield from marks_in(child, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list) and data and isinstance(data[0], Mapping):
        for number, child in enumerate(data):
            yield from marks_in(child, f"{path}.{number}")


def _marked_value(data: Any, field: str) -> Any:
    """Return the value of a marked field; a list if its items have different values."""
    values: list[Any] = [data]
    for step in field.split("."):
        values = _all_child_values(values, step)
    by_text = {str(value): value for value in values}
    distinct = list(by_text.values())
    return distinct[0] if len(distinct) == 1 else distinct


def without_marks(data: Any) -> Any:
    """Return settings (dictionaries, lists, scalars) without their marks, which no computed number depends on."""
    if isinstance(data, list):
        return [without_marks(item) for item in data]
    if not isinstance(data, Mapping):
        return data
    return {key: without_marks(child) for key, child in data.items() if not _is_marks(data, key)}


def without_field_marks(data: Any, steps: Sequence[str]) -> Any:
    """Return a mapping without the marks on the field at path `steps` and on the fields below it.

    An override gives the field a new value, to which the reason of the old value does not apply.
    """
    if not isinstance(data, Mapping):
        return data
    settings = dict(data)
    for mark in MARKS:
        if _is_marks(data, mark):
            reasons = {}
            for path, text in data[mark].items():
                leading_steps = path.split(".")[: len(steps)]
                if leading_steps != [*steps]:
                    reasons[path] = text
            settings[mark] = reasons
    return settings


def _is_marks(data: Mapping[str, Any], key: str) -> bool:
    """Return whether a key is a card's field of marks rather than a name that the user chose."""
    value = data.get(key)
    if key not in MARKS or not isinstance(value, Mapping):
        return False
    return all(isinstance(text, str) for text in value.values())


ASSUMED = Field((), description="fields whose numbers have no source; they are listed in the report")
SECOND_HAND = Field(
    (), description="fields whose numbers are quoted by another publication; they are listed in the report too"
)
