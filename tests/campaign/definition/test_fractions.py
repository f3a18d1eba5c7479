"""Every fraction that a campaign can state is a plain number or a percentage; the fields are found in the schema."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from typing import Annotated, Any

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError, WithJsonSchema
from pydantic.fields import FieldInfo

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.campaign.search.point import number_at
from lvnav_trade.quantities.units import Share


def models(kind: Any, seen: set[Any]) -> Iterator[type[BaseModel]]:
    """Yield every class of settings below an annotation."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind not in seen:
            seen.add(kind)
            yield kind
            for info in kind.model_fields.values():
                yield from models(info.annotation, seen)
        return
    for part in typing.get_args(kind):
        yield from models(part, seen)


def bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the least and the largest value of a field, where it states them."""
    low, high = None, None
    for item in info.metadata:
        low = next((getattr(item, key) for key in ("gt", "ge") if getattr(item, key, None) is not None), low)
        high = next((getattr(item, key) for key in ("lt", "le") if getattr(item, key, None) is not None), high)
    return low, high


def numbers() -> dict[str, FieldInfo]:
    """Return the fields of numbers between 0 and 1, quantities of another dimension apart."""
    found = {}
    for model in models(Campaign, set()):
        for name, info in model.model_fields.items():
            low, high = bounds(info)
            described = [str(one.json_schema) for one in info.metadata if isinstance(one, WithJsonSchema)]
            number = "float" in str(info.annotation) and all("fraction" in one for one in described)
            if number and low is not None and high is not None and 0.0 <= low < high <= 1.0:
                found[f"{model.__name__}.{name}"] = info
    return found


FOUND = numbers()


def test_the_schema_has_the_fractions_that_are_known() -> None:
    known = {
        "Requirement.probability", "Requirement.confidence", "CorridorCard.probability", "Compare.confidence",
        "ProtectionCard.integrity_risk", "ProtectionCard.false_alarm",
        "IntegrityCard.false_alarm", "ParityCard.false_alarm", "SwayMode.damping", "Solve.margin",
    }  # fmt: skip
    assert known <= set(FOUND)


@pytest.mark.parametrize("name", sorted(FOUND))
def test_a_fraction_is_a_number_or_a_percentage(name: str) -> None:
    info = FOUND[name]
    low, high = bounds(info)
    field: TypeAdapter[Any] = TypeAdapter(Annotated[info.annotation, *info.metadata])
    tenths = 10.0 * (float(low or 0.0) + 0.6789 * (float(high or 1.0) - float(low or 0.0)))
    text = f"{10.0 * tenths:.4f}"
    value = pytest.approx(float(f"{text}e-2"), rel=1e-15)
    assert field.validate_python(f"{text} %") == field.validate_python(f"{text} percent") == value
    assert field.validate_python(f"{float(text) * 1e4!r} ppm") == value
    for wrong in (f"{text}%", f"{text} deg", "101 %", "-1 %", "\u0661 %", "1_0 %"):
        with pytest.raises(ValidationError):
            field.validate_python(wrong)


def test_a_percentage_is_the_same_number_to_the_last_bit() -> None:
    field = TypeAdapter(Share)
    assert field.validate_python(0.9973) == 0.9973
    for text, value in (("99.73", 0.9973), ("99.9999", 0.999999), ("0.1", 0.001), ("1e-5", 1e-7), ("68.27", 0.6827)):
        assert field.validate_python(f"{text} %") == value


def test_percentages_of_a_campaign_are_the_numbers_that_they_mean(study) -> None:
    study.append(
        "requirements: [{name: a, metric: velocity_error_3d, probability: 99.73 %, confidence: 90 %, below: 1 m/s}]\n"
        "compare: {confidence: 95 %}\n"
    )
    campaign = load(study.path)
    assert (campaign.requirements[0].probability, campaign.requirements[0].confidence) == (0.9973, 0.9)
    assert "probability: 0.9973\n" in resolved_text(campaign)
    assert load(study.path, ["requirements.0.probability=68.27 %"]).requirements[0].probability == 0.6827


def test_a_fraction_that_is_searched_over_in_percent_is_shown_in_percent(study) -> None:
    scenario = load(study.path).base
    share = scenario.model_copy(update={"frame": 0.25})  # any plain number
    assert number_at(share, "frame", "%") == pytest.approx(25.0)
    assert number_at(share, "frame", "") == 0.25
