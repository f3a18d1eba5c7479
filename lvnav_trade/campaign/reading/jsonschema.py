"""The JSON Schema of campaign files, so that editors complete and check them."""

from __future__ import annotations

from typing import Any

from lvnav_trade.campaign.definition.schema import Campaign

# What a campaign is made of is written out; anything else may be a card.
_WRITTEN_OUT = ("MonteCarlo", "Axis", "Published", "Ordering", "Innovations", "Covariance", "Keep", "Report", "Compare")
_CARD = {"type": "string", "description": "name or path of a card, such as imu/tactical_fog"}


def json_schema() -> dict[str, Any]:
    """Return the schema of a campaign as the user writes it: any settings may be a card, or a card with overrides.

    It accepts every campaign that `load` accepts; rules between fields are left to `lvnav-trade check`.
    """
    schema = Campaign.model_json_schema()
    definitions = schema["$defs"]
    for name, definition in list(definitions.items()):
        definitions[name] = _settings(definition) if name not in _WRITTEN_OUT else _open(definition)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **_open(schema), "title": "lvnav-trade campaign"}


def _settings(definition: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of settings that may also be the name of a card, or a card of which some fields are changed."""
    whole = _open(definition)
    whole.pop("required", None)
    properties = {"card": _CARD, **whole.get("properties", {})}
    return {"anyOf": [_CARD, {**whole, "properties": properties}], "description": definition.get("description", "")}


def _open(node: Any) -> Any:
    """Return the schema with alternatives that exclude nothing: without required keys several may fit."""
    if isinstance(node, list):
        return [_open(item) for item in node]
    if not isinstance(node, dict):
        return node
    changed = {key: _open(value) for key, value in node.items() if key != "discriminator"}
    if "oneOf" in changed:
        changed["anyOf"] = changed.pop("oneOf")
    return changed
