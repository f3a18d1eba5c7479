"""What the settings models expect at a path: cards, alternatives, literals, file paths."""

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
    """Return the alternatives of an annotation, metadata and unions taken apart; metadata of the class `keep` stands in
    place of what it annotates.
    """
    origin = _origin(kind)
    if origin is Annotated:
        inner, *metadata = get_args(kind)
        return tuple(one for one in metadata if keep and isinstance(one, keep))[:1] or options(inner, keep)
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
    """Return the annotation of what a mapping with keys of the user's own holds, None for anything else."""
    found = (get_args(option)[1] for option in options(kind) if _origin(option) is dict)
    return next(found, None)


def old_key(kind: Kind, key: str) -> str:
    """Return what replaces a key of earlier versions, empty for any other."""
    return next((str(old[key]) for old in (getattr(one, "OLD_KEYS", {}) for one in models(kind)) if key in old), "")


@cache
def is_path(model: type[BaseModel], key: str) -> bool:
    """Whether the field holds a file path, relative to the file that names it."""
    field = by_key(model).get(key)
    extra = field.json_schema_extra if field else None
    return isinstance(extra, dict) and bool(extra.get("path"))


def child(kind: Kind, key: str, node: Node | None = None) -> Kind | None:
    """Return the annotation one step down, or None; `node` (the value there) chooses among alternatives."""
    known = (by_key(model) for model in _likely(kind, node))
    below = item(kind, int(key)) if is_index(key) else next((one[key].annotation for one in known if key in one), None)
    return entries(kind) or below


def item(kind: Kind, index: int) -> Kind | None:
    """Return the annotation of the item of a sequence."""
    sequences = (get_args(option) for option in options(kind) if _origin(option) in (tuple, list, Sequence))
    for held in sequences:
        if len(held) == 2 and held[1] is Ellipsis:
            return held[0]
        if index < len(held):
            return held[index]
    return None


def names(kind: Kind, node: Node | None = None) -> tuple[str, ...]:
    """Return the keys known at an annotation."""
    return tuple(dict.fromkeys(name for model in _likely(kind, node) for name in by_key(model)))


def tag_of(model: type[BaseModel]) -> str | None:
    """Return the one word of the model's `kind`, where it has exactly one."""
    field = model.model_fields.get("kind")
    words = literals(field.annotation) if field else ()
    return str(words[0]) if len(words) == 1 else None


def tags(kind: Kind) -> tuple[str, ...]:
    """Return the words of `kind` that the alternatives are known by."""
    return tuple(tag for tag in map(tag_of, models(kind)) if tag)


def member(kind: Kind, node: Node | None) -> type[BaseModel] | None:
    """Return the alternative that a mapping means: by its `kind`, else by a key that only one alternative has."""
    found = models(kind)
    if len(found) == 1 or node is None or not node.is_map:
        return found[0] if len(found) == 1 else None
    if "kind" in node.value:
        return next((model for model in found if tag_of(model) == node.value["kind"].value), None)
    # how many alternatives have a key: one that is distinctive has one
    known = Counter(name for model in found for name in by_key(model))
    likely = [model for model in found if any(key in by_key(model) and known[key] == 1 for key in node.value)]
    return likely[0] if len(likely) == 1 else None


def _likely(kind: Kind, node: Node | None) -> tuple[type[BaseModel], ...]:
    chosen = member(kind, node)
    return (chosen,) if chosen else models(kind)
