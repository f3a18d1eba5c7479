"""What the settings models expect at a path."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.quantities.units import Card, Length
from lvnav_trade.scenario.scenario import Scenario


class Square(Card):
    kind: Literal["square"] = "square"
    side: Length
    paint: str = ""


class Circle(Card):
    kind: Literal["circle"] = "circle"
    radius: Length
    paint: str = ""


class Sheet(Card):
    shape: Annotated[Square | Circle, Field(discriminator="kind")]
    shapes: tuple[Square, ...] = ()
    pair: tuple[int, str] = (0, "")
    match: Literal["matched"] | Circle = "matched"
    file: str = Field("", json_schema_extra={"path": True})


SHAPE = Sheet.model_fields["shape"].annotation


def node(text: str) -> tree.Node:
    return tree.parse(text, "f", Path())


def test_the_alternatives_of_an_annotation_are_its_models_and_words() -> None:
    assert fields.models(SHAPE) == (Square, Circle)
    assert fields.tags(SHAPE) == ("square", "circle")
    match = Sheet.model_fields["match"].annotation
    assert fields.models(match) == (Circle,)
    assert fields.literals(match) == ("matched",)
    assert fields.models(Sheet.model_fields["file"].annotation) == ()


@pytest.mark.parametrize(
    ("text", "meant"),
    [("{kind: circle}", Circle), ("{radius: 1 m}", Circle), ("{side: 1 m, paint: red}", Square), ("{paint: red}", None),
     ("{kind: oval}", None), ("{side: 1 m, radius: 1 m}", None), ("word", None)],
)  # fmt: skip
def test_a_mapping_means_the_alternative_of_its_kind_or_of_a_key_that_only_one_has(text: str, meant: object) -> None:
    assert fields.member(SHAPE, node(text)) is meant


def test_the_keys_known_are_those_of_the_alternative_that_is_meant() -> None:
    assert fields.names(SHAPE, node("{side: 1 m}")) == ("kind", "side", "paint")
    assert fields.names(SHAPE) == ("kind", "side", "paint", "radius")


def test_a_list_knows_its_items_and_a_pair_each_of_its_two() -> None:
    shapes, pair = (Sheet.model_fields[name].annotation for name in ("shapes", "pair"))
    assert fields.item(shapes, 7) is Square
    assert (fields.item(pair, 0), fields.item(pair, 1), fields.item(pair, 2)) == (int, str, None)
    assert fields.item(SHAPE, 0) is None


def test_a_path_is_followed_through_lists_and_alternatives() -> None:
    kind = fields.child(fields.child(Scenario, "trajectory"), "vehicle")
    stages = fields.child(kind, "stages")
    assert fields.names(fields.child(stages, "0"))[:2] == ("name", "propellant")
    assert fields.child(Scenario, "nothing") is None


def test_a_field_that_holds_a_path_is_known_as_one() -> None:
    assert fields.is_path(Sheet, "file")
    assert not fields.is_path(Sheet, "pair")
    assert not fields.is_path(Sheet, "nothing")
