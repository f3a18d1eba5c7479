"""The JSON Schema accepts what the loader accepts."""

from __future__ import annotations

from typing import Any

import pytest

from lvnav_trade.campaign.reading.field_reference import json_schema
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.syntax import tree

_TYPES = {"string": str, "number": int | float, "integer": int, "boolean": bool, "array": list, "object": dict}


def fits(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """Judge a value by the part of JSON Schema that says which keys and which kinds of value there may be."""
    if "$ref" in schema:
        return fits(value, root["$defs"][schema["$ref"].rpartition("/")[2]], root)
    if "anyOf" in schema:
        return any(fits(value, option, root) for option in schema["anyOf"])
    if "enum" in schema or "const" in schema:
        return value in schema.get("enum", [schema.get("const")])
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(value is None if kind == "null" else isinstance(value, _TYPES[kind]) for kind in kinds):
        return False
    if isinstance(value, list):
        return all(fits(item, schema.get("items", {}), root) for item in value)
    if isinstance(value, dict) and "properties" in schema:
        known = schema["properties"]
        return set(schema.get("required", ())) <= set(value) <= set(known) and all(
            fits(child, known[key], root) for key, child in value.items()
        )
    return True


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("imu: imu/good", "imu: imu/poor"),
        ("imu: imu/good", "imu: {card: imu/good, gyro: {random_walk: 1 deg/sqrt(h)}}"),
        ("constellations/two", "{card: constellations/two, inclination: 60 deg}"),
        ("filters/near", "{card: filters/near, imu: matched, gate: 5}"),
        ("trajectories/climb", "{card: trajectories/climb, vehicle: {card: vehicles/small, payload: 1 t}}"),
    ],
)
def test_the_schema_accepts_a_campaign_that_loads(study, old: str, new: str) -> None:
    axis = "filter, cards: [filters/near]" if "imu/good, " in new else "imu, cards: [imu/good, imu/poor]"
    study.append(f"axes: [{{path: {axis}}}]\nmonte_carlo: {{runs: 5}}\n")
    study.edit("campaign.yaml", old, new)
    load(study.path)
    schema = json_schema()
    assert fits(tree.plain_data(tree.read(study.path)), schema, schema)


def test_the_schema_accepts_a_resolved_campaign(study) -> None:
    study.append("requirements: [{name: a, metric: position_error_3d, probability: 0.5, below: 1 m}]\n")
    study.write("frozen.yaml", resolved_text(load(study.path)))
    schema = json_schema()
    assert fits(tree.plain_data(tree.read(study.folder / "frozen.yaml")), schema, schema)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("seed: 7", "sead: 7"),
        ("seed: 7", "seed: seven"),
        ("seed: 7", "seed: 7\ndesign: gird"),
        ("imu/good", "{card: imu/good, giro: {}}"),
        ("imu/good", "3"),
    ],
)
def test_the_schema_refuses_what_does_not_load(study, old: str, new: str) -> None:
    study.edit("campaign.yaml", old, new)
    schema = json_schema()
    assert not fits(tree.plain_data(tree.read(study.path)), schema, schema)
