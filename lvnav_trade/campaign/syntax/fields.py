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
        for data in metadata:
            if keep and isinstance(data, keep):
                return (data,)
        return options(inner, keep)
    if origin in (Union, types.UnionType):
        alternatives: list[Kind] = []
        for alternative in get_args(kind):
            alternatives += options(alternative, keep)
        return tuple(alternatives)
    return (kind,)


def _origin(kind: Kind) -> Any:
    return get_origin(kind)


def models(kind: Kind) -> tuple[type[BaseModel], ...]:
    """Return the settings models among the alternatives of an annotation."""
    return tuple(option for option in options(kind) if isinstance(option, type) and issubclass(option, BaseModel))


def literals(kind: Kind) -> tuple[Any, ...]:
    """Return the literal words among the alternatives."""
    words: list[Any] = []
    for option in options(kind):
        if _origin(option) is Literal:
            words += get_args(option)
    return tuple(words)


def by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a model by the keys that a user writes."""
    return {info.alias or name: info for name, info in model.model_fields.items()}


def entries(kind: Kind) -> Kind | None:
    """Return the annotation of the values of a mapping with free keys; None for anything else."""
    for option in options(kind):
        if _origin(option) is dict:
            _, values = get_args(option)
            return values
    return None


def old_key(kind: Kind, key: str) -> str:
    """Return the message on the replacement of a key of earlier versions; empty for any other key."""
    for model in models(kind):
        replacements = getattr(model, "OLD_KEYS", {})
        if key in replacements:
            return str(replacements[key])
    return ""


@cache
def is_path(model: type[BaseModel], key: str) -> bool:
    """Whether a field is a file path, relative to the file that names it."""
    field = by_key(model).get(key)
    extra = field.json_schema_extra if field else None
    return isinstance(extra, dict) and bool(extra.get("path"))


def child(kind: Kind, key: str, node: Node | None = None) -> Kind | None:
    """Return the annotation of a field; None if there is no such field.

    Parameters
    ----------
    kind : Kind
        Annotation of the settings.
    key : str
        Key, or index of a list.
    node : Node, optional
        Present value of the settings, which selects among alternatives.
    """
    free_entries = entries(kind)
    if free_entries is not None:
        return free_entries
    if is_index(key):
        return item(kind, int(key))
    for model in _likely(kind, node):
        info = by_key(model).get(key)
        if info is not None:
            return info.annotation
    return None


def item(kind: Kind, index: int) -> Kind | None:
    """Return the annotation of an item of a sequence; None for anything else."""
    for option in options(kind):
        if _origin(option) not in (tuple, list, Sequence):
            continue
        items = get_args(option)
        if len(items) == 2 and items[1] is Ellipsis:
            return items[0]
        if index < len(items):
            return items[index]
    return None


def names(kind: Kind, node: Node | None = None) -> tuple[str, ...]:
    """Return the keys of the settings of an annotation; `node` (the present value) selects among alternatives."""
    keys: dict[str, None] = {}
    for model in _likely(kind, node):
        keys |= dict.fromkeys(by_key(model))
    return tuple(keys)


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
    alternatives = models(kind)
    if len(alternatives) == 1:
        return alternatives[0]
    if node is None or not node.is_map:
        return None
    if "kind" in node.value:
        tag = node.value["kind"].value
        return next((model for model in alternatives if tag_of(model) == tag), None)
    models_with_key = Counter(key for model in alternatives for key in by_key(model))
    distinctive = {key for key in node.value if models_with_key[key] == 1}
    likely = [model for model in alternatives if distinctive & by_key(model).keys()]
    return likely[0] if len(likely) == 1 else None


def _likely(kind: Kind, node: Node | None) -> tuple[type[BaseModel], ...]:
    """Return the alternative that a node is, or all alternatives if that is open."""
    model = member(kind, node)
    return (model,) if model else models(kind)
