"""The scenario's sensors in a campaign: entries by names of the user's own, as cards, overrides, axes and --set."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.field_reference import json_schema, reference
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.sensors.family import SENSORS

LISTED = "filter.measurements=[position, velocity, altitude]"


def with_sensors(study, sensors: str, axes: str = "") -> None:
    study.edit("campaign.yaml", "  imu: imu/good", f"  imu: imu/good\n  sensors: {sensors}")
    study.edit("campaign.yaml", "seed: 7", f"seed: 7\n{axes}")


def test_an_entry_is_a_card_by_name_or_with_changes_or_written_out(study) -> None:
    with_sensors(study, "{radar: altimeters/radar_004, spare: null}")
    assert load("campaign.yaml", [LISTED]).base.sensors["radar"].highest == 5000.0
    study.edit("campaign.yaml", "altimeters/radar_004", "{card: altimeters/radar_004, sigma: 3 m, until: 400 s}")
    card = load("campaign.yaml", [LISTED]).base.sensors["radar"]
    assert (card.sigma, card.bias, card.until) == (3.0, 2.0, "400 s")
    study.edit("campaign.yaml", "{card: altimeters/radar_004, sigma: 3 m, until: 400 s}",
               "{kind: altimeter, name: a, source: b, sigma: 1 m, highest: 9 km}")  # fmt: skip
    assert load("campaign.yaml", [LISTED]).base.sensors["radar"].kind == "altimeter"


def test_an_assignment_opens_the_card_of_an_entry(study) -> None:
    with_sensors(study, "{radar: altimeters/radar_004}")
    base = load("campaign.yaml", [LISTED, "sensors.radar.sigma=4 m", "sensors.radar.from=100 s"]).base
    assert (base.sensors["radar"].sigma, base.sensors["radar"].from_) == (4.0, "100 s")
    assert load("campaign.yaml", ["sensors.radar=null"]).base.sensors == {"radar": None}
    with pytest.raises(InputError, match=r"--set: base.sensors.radar.sigmma: unknown path \(did you mean 'sigma'"):
        load("campaign.yaml", [LISTED, "sensors.radar.sigmma=4 m"])


def test_a_sensor_may_be_added_by_an_assignment(study) -> None:
    found = load("campaign.yaml", [LISTED, "sensors.low=altimeters/radar_004"]).base
    assert found.sensors["low"].sigma == 1.0


def test_an_axis_goes_along_a_field_of_a_sensor(study) -> None:
    with_sensors(study, "{radar: altimeters/radar_004}", "axes:\n  - {path: sensors.radar.sigma, values: [1 m, 5 m]}\n")
    campaign = load("campaign.yaml", [LISTED])
    found = cases(campaign)
    assert [case.scenario.sensors["radar"].sigma for case in found] == [1.0, 5.0]
    assert [case.label for case in found] == ["sigma=1 m", "sigma=5 m"]


def test_an_axis_goes_with_and_without_a_sensor_that_the_base_leaves_out(study) -> None:
    study.edit(
        "campaign.yaml", "seed: 7", "seed: 7\naxes:\n  - {path: sensors.radar, values: [null, altimeters/radar_004]}"
    )
    campaign = load("campaign.yaml", [LISTED])
    found = cases(campaign)
    assert [case.scenario.sensors["radar"] is None for case in found] == [True, False]
    assert found[0].label == "radar=none"
    study.write("again.yaml", resolved_text(campaign))
    assert [case.id for case in cases(load("again.yaml"))] == [case.id for case in found]


def test_an_axis_goes_along_cards_of_a_sensor(study) -> None:
    with_sensors(study, "{radar: altimeters/radar_004}",
                 "axes:\n  - {path: sensors.radar, cards: [altimeters/radar_004, altimeters/other]}\n")  # fmt: skip
    study.write(
        "configs/altimeters/other.yaml", "name: other\nsource: test\nkind: altimeter\nsigma: 9 m\nhighest: 1 km\n"
    )
    found = cases(load("campaign.yaml", [LISTED]))
    assert [case.axes["radar"] for case in found] == ["radar_004", "other"]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("altimeter", "'altimeter': replaced by sensors"),
        ("attitude_reference.sigma", "'attitude_reference.sigma': replaced by sensors"),
        ("filter.kind", "'filter.kind': replaced by measurements"),
    ],
)
def test_an_axis_along_a_key_of_earlier_versions_says_the_new_one(study, path: str, message: str) -> None:
    with pytest.raises(InputError, match="replaced by"):
        load("campaign.yaml", [f"{path}=1"])
    study.edit("campaign.yaml", "seed: 7", f"seed: 7\naxes:\n  - {{path: {path}, values: [1, 2]}}")
    with pytest.raises(InputError, match=message):
        load("campaign.yaml")


def test_fields_and_schema_know_the_entries() -> None:
    assert {part.kind for part in reference("sensors")} == {card.model_fields["kind"].default for card in SENSORS}
    assert [part.kind for part in reference("sensors.any")] == [part.kind for part in reference("sensors")]
    assert "from" in {row.field for row in reference("sensors")[0].rows}
    known = json_schema()["$defs"]["AltimeterCard"]["anyOf"][1]["properties"]
    assert {"card", "from", "sigma"} <= set(known)
    assert "from_" not in known
