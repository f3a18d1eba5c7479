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
    title: str  # subject of the settings
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
        child_kind = fields.child(settings, key)
        if child_kind is None:
            names = fields.names(settings)
            message = fields.old_key(settings, key) or f"unknown path{hint(key, names)}; known: {', '.join(names)}"
            raise InputError(f"fields: {path}: {message}")
        kind = child_kind
    models = fields.models(_item(kind))
    if not models:
        raise InputError(f"fields: {path}: has no fields of its own; it is {type_of(kind)}")
    return [_settings_entry(model, len(models) > 1) for model in models]


def _item(kind: fields.Kind) -> fields.Kind:
    """Return the annotation of the items of a list or of a mapping with free keys; any other annotation unchanged."""
    return kind if fields.models(kind) else fields.entries(kind) or fields.item(kind, 0) or kind


def _settings_entry(model: type[BaseModel], is_one_of_several: bool) -> SettingsEntry:
    """Return the description of one kind of settings."""
    tag = fields.tag_of(model)
    rows = []
    for name, info in fields.by_key(model).items():
        if name != "kind" or tag is None:
            rows.append(FieldEntry(name, type_of(_annotated(info)), _default(info), info.description or ""))
    first_paragraph = (model.__doc__ or "").partition("\n\n")[0]
    title = " ".join(first_paragraph.split())
    return SettingsEntry((tag or "") if is_one_of_several else "", title, tuple(rows))


def _annotated(info: FieldInfo) -> fields.Kind:
    return Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation


def type_of(kind: fields.Kind) -> str:
    """Describe the values that a field accepts: a quantity with its unit, words, settings, or a list."""
    return " or ".join(dict.fromkeys(map(_describe_option, fields.options(kind, keep=WithJsonSchema))))


def _describe_option(option: fields.Kind) -> str:
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
        has_fixed_length = arguments[-1] is not Ellipsis and len(arguments) > 1
        item_text = type_of(arguments[0])
        return f"list of {len(arguments)} {item_text}" if has_fixed_length else f"list of {item_text}"
    return _PLAIN.get(option, getattr(option, "__name__", str(option)))


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return fields.tag_of(type(value)) or "settings"
    if value is None:
        return "none"
    dumped = TypeAdapter(_annotated(info)).dump_python(value, mode="json")
    if isinstance(value, float) and isinstance(dumped, str):
        if not value:
            return "0"
        unit = dumped.partition(" ")[2]
        return f"{value:.6g} {unit}".removesuffix(" dimensionless")
    if isinstance(dumped, bool):
        return str(dumped).lower()
    if isinstance(dumped, list):
        return f"[{', '.join(map(str, dumped))}]"
    return str(dumped) or "none"


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
    schema = _open(definition)
    schema.pop("required", None)
    schema["properties"] = {"card": _CARD, **schema.get("properties", {})}
    return {"anyOf": [_CARD, schema], "description": definition.get("description", "")}


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
