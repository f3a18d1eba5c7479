"""What a campaign can say is reported field by field, for people."""

from __future__ import annotations

from typing import Annotated

import pytest
from pydantic import BaseModel

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.field_reference import reference, type_text
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.units import Length, TimeConstant
from lvnav_trade.sensors.family import MEASUREMENTS


def row(path: str, name: str) -> tuple[str, ...]:
    (part,) = reference(path)
    return tuple(next(one for one in part.rows if one.field == name))[1:]


def test_a_field_has_its_units_its_default_and_its_meaning() -> None:
    units = "frequency (Hz)"
    assert row("filter", "covariance_rate") == (units, "10 Hz", "")
    assert row("base.imu.gyro", "bandwidth") == (f"{units} or none", "none", "first-order bandwidth; none: ideal")
    assert row("filter", "measurements")[:2] == (f"list of {', '.join(MEASUREMENTS)}", "required")
    assert row("filter.logic", "restart_after")[1] == "[data_loss, residual, covariance]"
    checks = "checksum, hardware, time_sync, fresh"
    assert row("filter.logic", "check_flags")[:2] == (f"list of {checks}", f"[{checks}]")
    assert row("filter", "backup")[:2] == ("true or false", "false")
    assert row("", "axes")[:2] == ("list of settings", "[]")


def test_settings_of_several_kinds_are_reported_kind_by_kind_without_the_kind_itself() -> None:
    parts = {part.kind: part for part in reference("faults")}
    assert parts["clock_jump"].title == "Single jump of the receiver clock, in metres of range."
    assert [one.field for one in parts["clock_jump"].rows][-2:] == ["start", "size"]
    assert parts["clock_jump"].rows[0].field == "from"


def test_a_type_is_said_in_words() -> None:
    assert type_text(tuple[Length, Length, Length]) == "list of 3 length (m, km, cm)"
    assert type_text(Annotated[TimeConstant, 3] | None) == "time (s, ms, min) or none"
    assert type_text(dict[str, Length]) == "length (m, km, cm) by name"


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("filtre", "fields: filtre: unknown path (did you mean 'filter'?)"),
        (
            "filter.logics",
            "fields: filter.logics: unknown path (did you mean 'logic'?); known: name, source, assumed",
        ),
        ("filter.kind", "fields: filter.kind: replaced by measurements"),
        ("altimeter", "fields: altimeter: replaced by sensors"),
        ("filter.gate", "fields: filter.gate: has no fields of its own; it is number or none"),
    ],
)
def test_a_path_that_leads_nowhere_is_reported(path: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        reference(path)
    assert str(caught.value).startswith(message)


def test_every_settings_of_a_campaign_can_be_asked_for() -> None:
    seen: set[type[BaseModel]] = set()

    def walk(path: str, kind: object) -> None:
        for model in fields.models(kind) or fields.models(fields.item(kind, 0)):
            if model not in seen:
                seen.add(model)
                reported = reference(path)
                assert all(one.type and one.default for part in reported for one in part.rows), path
                for name, info in model.model_fields.items():
                    walk(f"{path}.{name}".strip("."), info.annotation)

    walk("", Campaign)
    assert len(seen) > 80
