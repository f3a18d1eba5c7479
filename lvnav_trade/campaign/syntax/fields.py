"""Annotations of the settings models at a path: cards, alternatives, literals, file paths."""

import types
from collections import Counter
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lvnav_trade.campaign.syntax.tree import Node, is_index

Kind = Any  # a type annotation


def options(kind: Kind, keep: type | None = None) -> tuple[Kind, ...]:
    """Return the alternatives of an annotation, without metadata and unions.

    Metadata of the class `keep` replaces the annotation that it belongs to.
    """
    origin = _origin(kind)
    if origin is Annotated:
        inner, *metadata = get_args(kind)
        return tuple(data for data in metadata if keep and isinstance(data, keep))[:1] or options(inner, keep)
    if origin in (Union, types.UnionType):
        return tuple(option for part in get_args(kind) for option in options(part, keep))
    return (kind,)


def _origin(kind: Kind) -> Any:
    return get_origin(kind)


def models(kind: Kind) -> tuple[type[BaseModel], ...]:
    """Return the settings models among the alternatives of an annotation."""
    return tuple(option for option in options(kind) if isinstance(option, type) and issubclass(option, BaseModel))


def literals(kind: Kind) -> tuple[Any, ...]:
    """Return the literal words among the alternatives."""
    return tuple(word for option in options(kind) if _origin(option) is Literal for word in get_args(option))


def by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a model by the keys that a user writes."""
    return {info.alias or name: info for name, info in model.model_fields.items()}


def entries(kind: Kind) -> Kind | None:
    """Return the annotation of the values of a mapping with free keys; None for anything else."""
    return next((get_args(option)[1] for option in options(kind) if _origin(option) is dict), None)


def old_key(kind: Kind, key: str) -> str:
    """Return the message on the replacement of a key of earlier versions; empty for any other key."""
    former = (getattr(model, "OLD_KEYS", {}) for model in models(kind))
    return next((str(keys[key]) for keys in former if key in keys), "")


@cache
def is_path(model: type[BaseModel], key: str) -> bool:
    """Whether a field is a file path, relative to the file that names it."""
    field = by_key(model).get(key)
    extra = field.json_schema_extra if field else None
    return isinstance(extra, dict) and bool(extra.get("path"))


def child(kind: Kind, key: str, node: Node | None = None) -> Kind | None:
    """Return the annotation of a field, or None; `node` (the present value) selects among alternatives."""
    if is_index(key):
        below = item(kind, int(key))
    else:
        candidates = (by_key(model) for model in _likely(kind, node))
        below = next((fields[key].annotation for fields in candidates if key in fields), None)
    return entries(kind) or below


def item(kind: Kind, index: int) -> Kind | None:
    """Return the annotation of an item of a sequence; None for anything else."""
    sequences = (get_args(option) for option in options(kind) if _origin(option) in (tuple, list, Sequence))
    for items in sequences:
        if len(items) == 2 and items[1] is Ellipsis:
            return items[0]
        if index < len(items):
            return items[index]
    return None


def names(kind: Kind, node: Node | None = None) -> tuple[str, ...]:
    """Return the keys of the settings of an annotation; `node` (the present value) selects among alternatives."""
    return tuple(dict.fromkeys(name for model in _likely(kind, node) for name in by_key(model)))


def tag_of(model: type[BaseModel]) -> str | None:
    """Return the value of a model's field `kind`; None if it has no such field or several values."""
    field = model.model_fields.get("kind")
    words = literals(field.annotation) if field else ()
    return str(words[0]) if len(words) == 1 else None


def tags(kind: Kind) -> tuple[str, ...]:
    """Return the values of `kind` of all alternatives."""
    return tuple(tag for tag in map(tag_of, models(kind)) if tag)


def member(kind: Kind, node: Node | None) -> type[BaseModel] | None:
    """Return the alternative of a mapping: by its `kind`, or else by a key that only one alternative has."""
    found = models(kind)
    if len(found) == 1 or node is None or not node.is_map:
        return found[0] if len(found) == 1 else None
    if "kind" in node.value:
        return next((model for model in found if tag_of(model) == node.value["kind"].value), None)
    # number of alternatives with each key; a key is distinctive if the number is one
    counts = Counter(name for model in found for name in by_key(model))
    likely = [model for model in found if any(key in by_key(model) and counts[key] == 1 for key in node.value)]
    return likely[0] if len(likely) == 1 else None


def _likely(kind: Kind, node: Node | None) -> tuple[type[BaseModel], ...]:
    chosen = member(kind, node)
    return (chosen,) if chosen else models(kind)
