"""Conversion of pydantic's errors to input errors: one line each, at the place where the value is written."""

import itertools
import re
from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import ValidationError

from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.input_limits import MESSAGES

# Units that datasheets use most, for "did you mean"
_UNITS = (
    "m", "km", "cm", "mm", "s", "ms", "us", "min", "h", "deg", "rad", "mrad", "arcsec", "deg/h", "deg/s", "rad/s",
    "m/s", "km/s", "cm/s", "mm/s", "m/s^2", "g", "mg", "ug", "Hz", "kHz", "kg", "t", "N", "kN", "ppm", "percent",
    "deg/sqrt(h)", "deg/h/sqrt(Hz)", "m/s/sqrt(h)", "ug/sqrt(Hz)", "mg/sqrt(Hz)", "deg/h/sqrt(h)", "mg/sqrt(h)",
    "deg/h/g", "ppm/sqrt(year)", "dB-Hz", "m^2", "dimensionless",
)  # fmt: skip
_MESSAGES = {
    "missing": "is missing",
    "extra_forbidden": "unknown key",
    "tuple_type": "should be a list",
    "list_type": "should be a list",
}
_CONTAINER_ERRORS = ("model_type", "model_attributes_type", "tuple_type", "list_type")
_FIELD_MESSAGE = re.compile(r"([a-z][a-z_0-9.]*): (.*)")  # message of a rule, with the path of the field to correct
_UNKNOWN_UNIT = re.compile(r"(\S+)' has no unit that is known")


def explain(error: ValidationError, node: tree.Node, annotation: fields.Annotation, path: str = "") -> list[Mistake]:
    """Return the input errors of a validation error.

    Parameters
    ----------
    error : pydantic.ValidationError
        The validation error.
    node : tree.Node
        The tree that was validated.
    annotation : fields.Annotation
        Annotation by which it was read.
    path : str
        Dotted path of the tree in the campaign.
    """
    all_items = error.errors(include_url=False)
    word_fields = {item["loc"][:-1] for item in all_items if item["type"] == "literal_error"}
    intended_items = (item for item in all_items if _is_intended(item, word_fields))
    items = list(itertools.islice(intended_items, MESSAGES + 1)) or all_items[:MESSAGES]
    mistakes = [_input_error(item, node, annotation, path) for item in items]
    return list(dict.fromkeys(mistakes))


def _is_intended(item: Any, word_fields: Container[Any]) -> bool:
    """Return whether the value was meant as the alternative that it was read as.

    word_fields : Locations of fields that also accept a word.
    """
    if item["type"] in ("literal_error", "none_required"):
        # a mapping was meant as settings, a list as several words
        return not isinstance(item.get("input"), Mapping | list | tuple)
    # if a word was meant, the error of the literal lists the permitted words
    return item["type"] not in _CONTAINER_ERRORS or item["loc"][:-1] not in word_fields


class _Location(NamedTuple):
    """Value to which an error of pydantic refers."""

    node: tree.Node  # the value
    annotation: fields.Annotation  # its annotation
    path: str  # its dotted path
    key: str  # last step of the path
    key_place: tree.Place  # place of the key in the file
    parent: tuple[fields.Annotation, tree.Node]  # annotation and node of the settings that contain it


def _find_location(steps: Sequence[str | int], root: tree.Node, annotation: fields.Annotation, path: str) -> _Location:
    """Return the value at a location of pydantic, which names the alternatives on the way in addition to the keys.

    Parameters
    ----------
    steps : sequence of str or int
        Location of pydantic.
    root : tree.Node
        The tree that was validated.
    annotation : fields.Annotation
        Annotation by which it was read.
    path : str
        Dotted path of the tree in the campaign.
    """
    location = _Location(root, annotation, path, "", root.place, (annotation, root))
    follows_tag = False
    for step in steps:
        node = location.node
        annotation = location.annotation
        child = tree.find(node, [step])
        is_tag = not follows_tag and str(step) in fields.tags(annotation)
        if child is None or is_tag:  # the tag of an alternative, not a key, which may have the same name
            follows_tag = True
            continue
        follows_tag = False
        location = _Location(
            node=child,
            annotation=fields.child(annotation, str(step), node),
            path=tree.join(location.path, step),
            key=str(step),
            key_place=node.keys.get(str(step), child.place),
            parent=(annotation, node),
        )
    return location


def _input_error(item: Any, root: tree.Node, annotation: fields.Annotation, path: str) -> Mistake:
    """Return the input error of one error of pydantic."""
    is_missing = item["type"] == "missing"
    steps = item["loc"][:-1] if is_missing else item["loc"]
    location = _find_location(steps, root, annotation, path)
    node = location.node
    message = _message(item, node, location.annotation)
    if item["type"] == "value_error" and node.is_map:
        match = _FIELD_MESSAGE.fullmatch(message)
        keys = (*fields.names(location.annotation, node), *node.value)
        if match and match[1].partition(".")[0] in keys:
            field_path = match[1]
            place = tree.nearest_place(node, field_path.split("."))
            return tree.mistake(place, tree.join(location.path, field_path), match[2])
    if is_missing:
        missing_path = tree.join(location.path, item["loc"][-1])
        return tree.mistake(node.place, missing_path, message)
    if item["type"] != "extra_forbidden":
        return tree.mistake(node.place, location.path, message)
    names = fields.names(*location.parent)
    suggestion = tree.hint(location.key, names)
    if not suggestion and names:
        suggestion = f" (known: {', '.join(names)})"
    return tree.mistake(location.key_place, location.path, f"{message}{suggestion}")


def _message(item: Any, node: tree.Node, annotation: fields.Annotation) -> str:
    """Return the message of an error of pydantic for the value of a node."""
    error_type = item["type"]
    if error_type in _MESSAGES:
        return _MESSAGES[error_type]
    if error_type == "literal_error":
        words = [str(word) for word in fields.literals(annotation)]
        suggestion = tree.hint(str(node.value), words)
        return f"{quoted(node.value)} is not one of {', '.join(words)}{suggestion}"
    if error_type == "union_tag_invalid":
        tags = list(fields.tags(annotation))
        value = item.get("ctx", {}).get("tag", "")
        if node.is_map and "kind" in node.value:
            value = node.value["kind"].value
        if not isinstance(value, dict | list):
            value = str(value)
        suggestion = tree.hint(str(value), tags)
        return f"kind {quoted(value)} is not one of {', '.join(tags)}{suggestion}"
    if error_type == "union_tag_not_found" and node.is_map:
        names = list(fields.names(annotation))
        unknown_key = next((key for key in node.value if key not in names), None)
        suggestion = "" if unknown_key is None else tree.hint(unknown_key, names)
        return f"needs a kind: {', '.join(fields.tags(annotation))}{suggestion}"
    if error_type in ("model_type", "model_attributes_type", "dict_type", "union_tag_not_found"):
        return "should be a mapping or the name of a card" if fields.models(annotation) else "should be a mapping"
    return _reworded_message(item, node)


def _reworded_message(item: Any, node: tree.Node) -> str:
    """Return pydantic's own message in the style of the other messages, with the value if that helps."""
    message = str(item["msg"]).removeprefix("Value error, ")
    if "is not a quantity" in message:
        return message
    unknown_unit = _UNKNOWN_UNIT.search(message)
    if unknown_unit:
        suggestion = tree.hint(unknown_unit.group(1), _UNITS)
        return message + suggestion
    if message.startswith("Input should be"):
        requirement = message.replace("Input should be", "should be", 1).partition(", unable")[0]
        return requirement if node.is_map or node.is_list else f"{requirement}, not {quoted(node.value)}"
    message = message.replace("Tuple should", "list should", 1).replace("List should", "list should", 1)
    return message.replace(" after validation", "")
