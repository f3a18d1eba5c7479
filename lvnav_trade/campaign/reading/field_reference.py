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
_TYPE_NAMES = {str: "text", int: "whole number", float: "number", bool: "true or false", Any: "any value"}
# Parts of a campaign that cannot be a card; all other settings can.
_INLINE_MODELS = (
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
    annotation: fields.Annotation = Campaign
    for key in full_path(path, "fields") if path else ():
        settings = annotation if fields.entries(annotation) is not None else _item(annotation)
        child_annotation = fields.child(settings, key)
        if child_annotation is None:
            names = fields.names(settings)
            message = fields.old_key_message(settings, key)
            if not message:
                message = f"unknown path{hint(key, names)}; known: {', '.join(names)}"
            raise InputError(f"fields: {path}: {message}")
        annotation = child_annotation
    models = fields.models(_item(annotation))
    if not models:
        raise InputError(f"fields: {path}: has no fields of its own; it is {type_text(annotation)}")
    return [_settings_entry(model, len(models) > 1) for model in models]


def _item(annotation: fields.Annotation) -> fields.Annotation:
    """Return the annotation of the items of a list or of a mapping with free keys; any other annotation unchanged."""
    if fields.models(annotation):
        return annotation
    return fields.entries(annotation) or fields.item(annotation, 0) or annotation


def _settings_entry(model: type[BaseModel], is_one_of_several: bool) -> SettingsEntry:
    """Return the description of one kind of settings."""
    tag = fields.model_tag(model)
    rows = []
    for name, info in fields.fields_by_key(model).items():
        if name != "kind" or tag is None:
            accepted_values = type_text(_full_annotation(info))
            rows.append(FieldEntry(name, accepted_values, _default_text(info), info.description or ""))
    first_paragraph = (model.__doc__ or "").partition("\n\n")[0]
    title = " ".join(first_paragraph.split())
    return SettingsEntry((tag or "") if is_one_of_several else "", title, tuple(rows))


def _full_annotation(info: FieldInfo) -> fields.Annotation:
    return Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation


def type_text(annotation: fields.Annotation) -> str:
    """Describe the values that a field accepts: a quantity with its unit, words, settings, or a list."""
    return " or ".join(dict.fromkeys(map(_describe_option, fields.options(annotation, metadata_type=WithJsonSchema))))


def _describe_option(option: fields.Annotation) -> str:
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
        return f"{type_text(arguments[1])} by name"
    if arguments:
        has_fixed_length = arguments[-1] is not Ellipsis and len(arguments) > 1
        item_text = type_text(arguments[0])
        return f"list of {len(arguments)} {item_text}" if has_fixed_length else f"list of {item_text}"
    return _TYPE_NAMES.get(option, getattr(option, "__name__", str(option)))


def _default_text(info: FieldInfo) -> str:
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return fields.model_tag(type(value)) or "settings"
    if value is None:
        return "none"
    plain_value = TypeAdapter(_full_annotation(info)).dump_python(value, mode="json")
    if isinstance(value, float) and isinstance(plain_value, str):
        if not value:
            return "0"
        unit = plain_value.partition(" ")[2]
        return f"{value:.6g} {unit}".removesuffix(" dimensionless")
    if isinstance(plain_value, bool):
        return str(plain_value).lower()
    if isinstance(plain_value, list):
        return f"[{', '.join(map(str, plain_value))}]"
    return str(plain_value) or "none"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of campaign files, in which settings may be a card or a card with overrides.

    It accepts every campaign that `load` accepts. It does not contain the rules between fields, which `lvnav-trade
    check` verifies.
    """
    schema = Campaign.model_json_schema()
    definitions = schema["$defs"]
    for name, definition in list(definitions.items()):
        definitions[name] = _settings_schema(definition) if name not in _INLINE_MODELS else _open_schema(definition)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **_open_schema(schema),
        "title": "lvnav-trade campaign",
    }


def _settings_schema(definition: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of settings that may also be the name of a card, or a card with some fields overridden."""
    schema = _open_schema(definition)
    schema.pop("required", None)
    schema["properties"] = {"card": _CARD, **schema.get("properties", {})}
    return {"anyOf": [_CARD, schema], "description": definition.get("description", "")}


def _open_schema(node: Any) -> Any:
    """Return the schema with `anyOf` for `oneOf`: without required keys several alternatives may fit."""
    if isinstance(node, list):
        return [_open_schema(item) for item in node]
    if not isinstance(node, dict):
        return node
    schema = {key: _open_schema(value) for key, value in node.items() if key != "discriminator"}
    if "oneOf" in schema:
        schema["anyOf"] = schema.pop("oneOf")
    return schema
