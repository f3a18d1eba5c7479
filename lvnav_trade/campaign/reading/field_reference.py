"""Reference of the settings: description of the fields at a path, JSON Schema for editors."""

from typing import Annotated, Any, NamedTuple, cast, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, WithJsonSchema
from pydantic.fields import FieldInfo

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.assignments import full_path
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError

_QUANTITY = "quantity with a unit: "
_PLAIN = {str: "text", int: "whole number", float: "number", bool: "true or false", Any: "any value"}
# Parts of a campaign that cannot be a card; all other settings can.
_WRITTEN_OUT = (
    "MonteCarlo",
    "Axis",
    "Published",
    "Ordering",
    "Innovations",
    "Statement",
    "Term",
    "Covariance",
    "Keep",
    "Report",
    "Compare",
    "Solve",
    "Vary",
    "Indices",
    "Tune",
    "Variable",
)
_CARD = {"type": "string", "description": "name or path of a card, such as imu/tactical_fog"}


class FieldEntry(NamedTuple):
    """Description of a field."""

    field: str  # key in the file
    type: str  # accepted values, in words
    default: str  # default value; "required" if there is none
    meaning: str


class SettingsEntry(NamedTuple):
    """Description of one kind of settings."""

    kind: str  # value of `kind`; empty if there is only one kind
    title: str  # what the settings describe
    rows: tuple[FieldEntry, ...]  # one per field


def reference(path: str = "") -> list[SettingsEntry]:
    """Return the description of the fields at a path of a campaign, one part for every kind of settings.

    Parameters
    ----------
    path : str
        Dotted path; ``base.`` may be omitted. The whole campaign if empty.

    Raises
    ------
    InputError
        A step of the path is unknown.
    """
    kind: fields.Kind = Campaign
    for key in full_path(path, "fields") if path else ():
        settings = kind if fields.entries(kind) is not None else _item(kind)
        known, below = fields.names(settings), fields.child(settings, key)
        if below is None:
            old = fields.old_key(settings, key)
            raise InputError(f"fields: {path}: {old or f'unknown path{hint(key, known)}; known: ' + ', '.join(known)}")
        kind = below
    models = fields.models(_item(kind))
    if not models:
        raise InputError(f"fields: {path}: has no fields of its own; it is {type_of(kind)}")
    return [_part(model, len(models) > 1) for model in models]


def _item(kind: fields.Kind) -> fields.Kind:
    """Return the annotation of the items of a list or of a mapping with free keys; any other annotation unchanged."""
    return kind if fields.models(kind) else fields.entries(kind) or fields.item(kind, 0) or kind


def _part(model: type[BaseModel], is_one_of_several: bool) -> SettingsEntry:
    tag = fields.tag_of(model)
    rows = (
        FieldEntry(name, type_of(_annotated(info)), _default(info), info.description or "")
        for name, info in fields.by_key(model).items()
        if name != "kind" or tag is None
    )
    title = " ".join((model.__doc__ or "").partition("\n\n")[0].split())
    return SettingsEntry((tag or "") if is_one_of_several else "", title, tuple(rows))


def _annotated(info: FieldInfo) -> fields.Kind:
    return Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation


def type_of(kind: fields.Kind) -> str:
    """Describe the values that a field accepts: a quantity with its unit, words, settings, or a list."""
    return " or ".join(dict.fromkeys(map(_type_of_option, fields.options(kind, keep=WithJsonSchema))))


def _type_of_option(option: fields.Kind) -> str:
    if isinstance(option, WithJsonSchema):  # a quantity
        return str((option.json_schema or {}).get("description", "")).removeprefix(_QUANTITY)
    if fields.literals(option):
        return ", ".join(map(str, fields.literals(option)))
    if option is type(None):
        return "none"
    if fields.models(option):
        return "settings"
    arguments, origin = get_args(option), cast(Any, get_origin(option))
    if origin is dict:
        return f"{type_of(arguments[1])} by name"
    if arguments:
        fixed = arguments[-1] is not Ellipsis
        return f"list of {f'{len(arguments)} ' if fixed and len(arguments) > 1 else ''}{type_of(arguments[0])}"
    return _PLAIN.get(option, getattr(option, "__name__", str(option)))


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return fields.tag_of(type(value)) or "settings"
    if value is None:
        return "none"
    shown = TypeAdapter(_annotated(info)).dump_python(value, mode="json")
    if isinstance(value, float) and isinstance(shown, str):
        return f"{value:.6g} {shown.partition(' ')[2]}".removesuffix(" dimensionless") if value else "0"
    if isinstance(shown, bool):
        return str(shown).lower()
    return f"[{', '.join(map(str, shown))}]" if isinstance(shown, list) else str(shown) or "none"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of campaign files, in which settings may be a card or a card with overrides.

    It accepts every campaign that `load` accepts. It does not contain the rules between fields, which `lvnav-trade
    check` verifies.
    """
    schema = Campaign.model_json_schema()
    definitions = schema["$defs"]
    for name, definition in list(definitions.items()):
        definitions[name] = _settings(definition) if name not in _WRITTEN_OUT else _open(definition)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_open(schema), "title": "lvnav-trade campaign"}


def _settings(definition: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of settings that may also be the name of a card, or a card with some fields overridden."""
    whole = _open(definition)
    whole.pop("required", None)
    properties = {"card": _CARD, **whole.get("properties", {})}
    return {"anyOf": [_CARD, {**whole, "properties": properties}], "description": definition.get("description", "")}


def _open(node: Any) -> Any:
    """Return the schema with `anyOf` for `oneOf`: without required keys several alternatives may fit."""
    if isinstance(node, list):
        return [_open(item) for item in node]
    if not isinstance(node, dict):
        return node
    changed = {key: _open(value) for key, value in node.items() if key != "discriminator"}
    if "oneOf" in changed:
        changed["anyOf"] = changed.pop("oneOf")
    return changed
