"""What pydantic finds wrong becomes one line at the place that wrote the value."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, ValidationError, model_validator

from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.quantities.units import Card, Length


class Square(Card):
    kind: Literal["square"] = "square"
    side: Length


class Circle(Card):
    kind: Literal["circle"] = "circle"
    radius: Annotated[Length, Field(gt=0.0)]


class Sheet(Card):
    name: str = ""
    count: int = 1
    shape: Annotated[Square | Circle, Field(discriminator="kind")] = Circle(radius="1 m")  # type: ignore[arg-type]
    model: Literal["matched", "none"] | Square = "matched"
    corners: tuple[Length, Length] = (0.0, 0.0)
    words: tuple[Literal["red", "green"], ...] = ()

    @model_validator(mode="after")
    def _rule(self) -> Sheet:
        if self.name == "odd":
            raise ValueError("no sheet is called odd")
        return self


def reported(text: str) -> list[str]:
    root = tree.parse(text, "f.yaml", Path())
    try:
        Sheet.model_validate(tree.plain_data(root))
    except ValidationError as error:
        return [str(mistake) for mistake in explain(error, root, Sheet, "base")]
    return []


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("count: two", ["f.yaml:1:8: base.count: should be a valid integer, not 'two'"]),
        ("cuont: 2", ["f.yaml:1:1: base.cuont: unknown key (did you mean 'count'?)"]),
        ("shape: {kind: circle}", ["f.yaml:1:8: base.shape.radius: is missing"]),
        ("shape: {kind: circle, radius: 0 m}", ["f.yaml:1:31: base.shape.radius: should be greater than 0, not '0 m'"]),
        ("shape: {kind: circel}", ["f.yaml:1:8: base.shape: kind 'circel' is not one of square, circle"
                                   " (did you mean 'circle'?)"]),
        ("shape: {raduis: 1 m}", ["f.yaml:1:8: base.shape: needs a kind: square, circle (did you mean 'radius'?)"]),
        ("shape: 3", ["f.yaml:1:8: base.shape: should be a mapping or the name of a card"]),
        ("model: matchd", ["f.yaml:1:8: base.model: 'matchd' is not one of matched, none (did you mean 'matched'?)"]),
        ("model: {sied: 1 m}", ["f.yaml:1:8: base.model.side: is missing",
                                 "f.yaml:1:9: base.model.sied: unknown key (did you mean 'side'?)"]),
        ("corners: 1 m", ["f.yaml:1:10: base.corners: should be a list"]),
        ("corners: [1 m]", ["f.yaml:1:10: base.corners.1: is missing"]),
        ("corners: [1 m, 2]", ["f.yaml:1:16: base.corners.1: 2 has no unit; write it as a quantity in a unit of length"
                               " (m, km, cm)"]),
        ("words: [red, grean]", ["f.yaml:1:14: base.words.1: 'grean' is not one of red, green"
                                 " (did you mean 'green'?)"]),
        ("name: odd", ["f.yaml:1:1: base: no sheet is called odd"]),
        ("{count: x, name: 3}", ["f.yaml:1:18: base.name: should be a valid string, not 3",
                                 "f.yaml:1:9: base.count: should be a valid integer, not 'x'"]),
    ],
)  # fmt: skip
def test_a_mistake_is_reported_in_our_words_at_its_place(text: str, lines: list[str]) -> None:
    assert sorted(reported(text)) == sorted(lines)


def test_no_message_speaks_of_pydantic() -> None:
    texts: list[Any] = ["3", "[1]", "{a: 1}", "null", "true", "x"]
    for key in Sheet.model_fields:
        for value in texts:
            for line in reported(f"{key}: {value}"):
                assert "Input" not in line
                assert "pydantic" not in line
                assert "\n" not in line
