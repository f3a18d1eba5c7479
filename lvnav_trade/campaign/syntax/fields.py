"""Annotations of the settings models at a path: cards, alternatives, literals, file paths."""

import types
from collections import Counter
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lvnav_trade.campaign.syntax.tree import Node, is_index

Annotation = Any  # a type annotation


def options(annotation: Annotation, metadata_type: type | None = None) -> tuple[Annotation, ...]:
    """Return the alternatives of an annotation, without metadata and unions.

    Metadata of the class `metadata_type` replaces the annotation that it belongs to.
    """
    origin = _origin(annotation)
    if origin is Annotated:
        inner, *metadata = get_args(annotation)
        for data in metadata:
            if metadata_type and isinstance(data, metadata_type):
                return (data,)
        return options(inner, metadata_type)
    if origin in (Union, types.UnionType):
        alternatives: list[Annotation] = []
        for alternative in get_args(annotation):
            alternatives += options(alternative, metadata_type)
        return tuple(alternatives)
    return (annotation,)


def _origin(annotation: Annotation) -> Any:
    return get_origin(annotation)


def models(annotation: Annotation) -> tuple[type[BaseModel], ...]:
    """Return the settings models among the alternatives of an annotation."""
    return tuple(option for option in options(annotation) if isinstance(option, type) and issubclass(option, BaseModel))


def literals(annotation: Annotation) -> tuple[Any, ...]:
    """Return the literal words among the alternatives."""
    words: list[Any] = []
    for option in options(annotation):
        if _origin(option) is Literal:
            words += get_args(option)
    return tuple(words)


def fields_by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a model by the keys that a user writes."""
    return {info.alias or name: info for name, info in model.model_fields.items()}


def entries(annotation: Annotation) -> Annotation | None:
    """Return the annotation of the values of a mapping with free keys; None for anything else."""
    for option in options(annotation):
        if _origin(option) is dict:
            _, values = get_args(option)
            return values
    return None


def old_key_message(annotation: Annotation, key: str) -> str:
    """Return the message on the replacement of a key of earlier versions; empty for any other key."""
    for model in models(annotation):
        replacements = getattr(model, "OLD_KEYS", {})
        if key in replacements:
            return str(replacements[key])
    return ""


@cache
def is_path(model: type[BaseModel], key: str) -> bool:
    """Whether a field is a file path, relative to the file that names it."""
    field = fields_by_key(model).get(key)
    extra = field.json_schema_extra if field else None
    return isinstance(extra, dict) and bool(extra.get("path"))


def child(annotation: Annotation, key: str, node: Node | None = None) -> Annotation | None:
    """Return the annotation of a field; None if there is no such field.

    Parameters
    ----------
    annotation : Annotation
        Annotation of the settings.
    key : str
        Key, or index of a list.
    node : Node, optional
        Present value of the settings, which selects among alternatives.
    """
    free_entries = entries(annotation)
    if free_entries is not None:
        return free_entries
    if is_index(key):
        return item(annotation, int(key))
    for model in _likely_models(annotation, node):
        info = fields_by_key(model).get(key)
        if info is not None:
            return info.annotation
    return None


def item(annotation: Annotation, index: int) -> Annotation | None:
    """Return the annotation of an item of a sequence; None for anything else."""
    for option in options(annotation):
        if _origin(option) not in (tuple, list, Sequence):
            continue
        items = get_args(option)
        if len(items) == 2 and items[1] is Ellipsis:
            return items[0]
        if index < len(items):
            return items[index]
    return None


def names(annotation: Annotation, node: Node | None = None) -> tuple[str, ...]:
    """Return the keys of the settings of an annotation; `node` (the present value) selects among alternatives."""
    keys: dict[str, None] = {}
    for model in _likely_models(annotation, node):
        keys |= dict.fromkeys(fields_by_key(model))
    return tuple(keys)


def model_tag(model: type[BaseModel]) -> str | None:
    """Return the value of a model's field `kind`; None if it has no such field or several values."""
    field = model.model_fields.get("kind")
    words = literals(field.annotation) if field else ()
    return str(words[0]) if len(words) == 1 else None


def tags(annotation: Annotation) -> tuple[str, ...]:
    """Return the values of `kind` of all alternatives."""
    return tuple(tag for tag in map(model_tag, models(annotation)) if tag)


def member(annotation: Annotation, node: Node | None) -> type[BaseModel] | None:
    """Return the alternative of a mapping: by its `kind`, or else by a key that only one alternative has."""
    alternatives = models(annotation)
    if len(alternatives) == 1:
        return alternatives[0]
    if node is None or not node.is_map:
        return None
    if "kind" in node.value:
        tag = node.value["kind"].value
        return next((model for model in alternatives if model_tag(model) == tag), None)
    models_with_key = Counter(key for model in alternatives for key in fields_by_key(model))
    distinctive_keys = {key for key in node.value if models_with_key[key] == 1}
    likely_models = [model for model in alternatives if distinctive_keys & fields_by_key(model).keys()]
    return likely_models[0] if len(likely_models) == 1 else None


def _likely_models(annotation: Annotation, node: Node | None) -> tuple[type[BaseModel], ...]:
    """Return the alternative that a node is, or all alternatives if that is open."""
    model = member(annotation, node)
    return (model,) if model else models(annotation)
