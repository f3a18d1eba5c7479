"""From pydantic's errors to mistakes: one line each, at the place that wrote the value."""

import itertools
import re
from collections.abc import Container, Mapping
from typing import Any

from pydantic import ValidationError

from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.input_limits import MESSAGES

# Units that datasheets use most, for "did you mean".
_UNITS = (
    *("m", "km", "cm", "mm", "s", "ms", "us", "min", "h", "deg", "rad", "mrad", "arcsec", "deg/h", "deg/s", "rad/s"),
    *("m/s", "km/s", "cm/s", "mm/s", "m/s^2", "g", "mg", "ug", "Hz", "kHz", "kg", "t", "N", "kN", "ppm", "percent"),
    *("deg/sqrt(h)", "deg/h/sqrt(Hz)", "m/s/sqrt(h)", "ug/sqrt(Hz)", "mg/sqrt(Hz)", "deg/h/sqrt(h)", "mg/sqrt(h)"),
    *("deg/h/g", "ppm/sqrt(year)", "dB-Hz", "m^2", "dimensionless"),
)
_MESSAGES = {
    "missing": "is missing",
    "extra_forbidden": "unknown key",
    "tuple_type": "should be a list",
    "list_type": "should be a list",
}
_OTHER_THAN_A_WORD = ("model_type", "model_attributes_type", "tuple_type", "list_type")
_INSIDE = re.compile(r"([a-z][a-z_0-9.]*): (.*)")
_SPELLED = re.compile(r"(\S+)' has no unit that is known")


def explain(error: ValidationError, node: tree.Node, kind: fields.Kind, path: str = "") -> list[Mistake]:
    """Return the mistakes behind a validation error of the tree `node` read as `kind`; `path` is where it hangs."""
    every = error.errors(include_url=False)
    words = {item["loc"][:-1] for item in every if item["type"] == "literal_error"}
    meant = list(itertools.islice((item for item in every if _is_meant(item, words)), MESSAGES + 1))
    return list(dict.fromkeys(_explain_one(item, node, kind, path) for item in meant or every[:MESSAGES]))


def _is_meant(item: Any, words: Container[Any]) -> bool:
    """Return whether the value was meant as the alternative that it was read as; `words`: where a word may stand."""
    if item["type"] in ("literal_error", "none_required"):
        # a mapping was meant as settings, a list as several words
        return not isinstance(item.get("input"), Mapping | list | tuple)
    # where a word was meant, the error of the literal says which are known
    return item["type"] not in _OTHER_THAN_A_WORD or item["loc"][:-1] not in words


def _explain_one(item: Any, root: tree.Node, kind: fields.Kind, path: str) -> Mistake:
    """Walk the location down the tree, skipping the names of alternatives, and word the message."""
    node, key_place, last, holder = root, root.place, "", (kind, root)
    missing, chosen = item["type"] == "missing", False
    for step in item["loc"][: -1 if missing else None]:
        below = tree.find(node, [step])
        if below is None or (not chosen and str(step) in fields.tags(kind)):
            chosen = True
            continue  # the tag of an alternative, not a key, which may be of the same name
        chosen, holder = False, (kind, node)
        key_place = node.keys.get(str(step), below.place)
        kind, node, last = fields.child(kind, str(step), node), below, str(step)
        path = tree.join(path, step)
    message = _message(item, node, kind)
    inside = _INSIDE.fullmatch(message) if item["type"] == "value_error" and node.is_map else None
    known = (*fields.names(kind, node), *node.value) if inside else ()
    if inside and inside[1].partition(".")[0] in known:  # a rule names the field to mend, or the key to replace
        return tree.mistake(tree.nearest(node, inside[1].split(".")), tree.join(path, inside[1]), inside[2])
    if missing:
        return tree.mistake(node.place, tree.join(path, item["loc"][-1]), message)
    if item["type"] != "extra_forbidden":
        return tree.mistake(node.place, path, message)
    known = fields.names(*holder)
    near = tree.hint(last, known) or (f" (known: {', '.join(known)})" if known else "")
    return tree.mistake(key_place, path, f"{message}{near}")


def _message(item: Any, node: tree.Node, kind: fields.Kind) -> str:
    name, context = item["type"], item.get("ctx", {})
    if name in _MESSAGES:
        return _MESSAGES[name]
    if name == "literal_error":
        known = [str(word) for word in fields.literals(kind)]
        return f"{quoted(node.value)} is not one of {', '.join(known)}{tree.hint(str(node.value), known)}"
    if name == "union_tag_invalid":
        known = list(fields.tags(kind))
        written = node.value["kind"].value if node.is_map and "kind" in node.value else context.get("tag", "")
        value = written if isinstance(written, dict | list) else str(written)
        return f"kind {quoted(value)} is not one of {', '.join(known)}{tree.hint(str(value), known)}"
    if name == "union_tag_not_found" and node.is_map:
        known = list(fields.names(kind))
        near = next((tree.hint(key, known) for key in node.value if key not in known), "")
        return f"needs a kind: {', '.join(fields.tags(kind))}{near}"
    if name in ("model_type", "model_attributes_type", "dict_type", "union_tag_not_found"):
        return f"should be a mapping{' or the name of a card' if fields.models(kind) else ''}"
    return _worded(item, node)


def _worded(item: Any, node: tree.Node) -> str:
    """Return pydantic's own message in our voice, with the value where that helps."""
    message = str(item["msg"]).removeprefix("Value error, ")
    if "is not a quantity" in message:
        return message
    spelled = _SPELLED.search(message)
    if spelled:
        return message + tree.hint(spelled.group(1), _UNITS)
    if message.startswith("Input should be"):
        value = "" if node.is_map or node.is_list else f", not {quoted(node.value)}"
        return message.replace("Input should be", "should be", 1).partition(", unable")[0] + value
    message = message.replace("Tuple should", "list should", 1).replace("List should", "list should", 1)
    return message.replace(" after validation", "")
