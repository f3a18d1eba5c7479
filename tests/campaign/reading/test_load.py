"""A campaign file becomes a whole campaign: cards, overrides, defaults, and back to the same file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError

DEG_PER_HOUR = math.radians(1.0) / 3600.0


def test_a_card_becomes_settings_in_si(study) -> None:
    campaign = load(study.path)
    assert campaign.base.imu.name == "good"
    assert campaign.base.imu.gyro.bias_repeatability == pytest.approx(DEG_PER_HOUR, rel=1e-15)
    assert campaign.base.trajectory.vehicle.payload == 300.0


def test_the_users_card_hides_the_tools_card_of_the_same_name(study) -> None:
    study.write("configs/imu/tactical_fog.yaml", (study.folder / "configs/imu/poor.yaml").read_text())
    study.edit("campaign.yaml", "imu/good", "imu/tactical_fog")
    assert load(study.path).base.imu.name == "poor"


def test_a_card_of_the_tool_is_found_without_a_file_of_the_user(study) -> None:
    study.edit("campaign.yaml", "imu/good", "imu/tactical_fog")
    assert load(study.path).base.imu.name.startswith("Tactical FOG")


def test_the_first_level_of_an_axis_stands_in_for_what_the_base_leaves_out(study) -> None:
    study.append("axes: [{path: imu, cards: [imu/poor, imu/good]}]\n")
    study.edit("campaign.yaml", "  imu: imu/good\n", "")
    assert load(study.path).base.imu.name == "poor"


AXES = """\
axes:
  - {path: imu, cards: [imu/good, imu/poor]}
  - {path: filter.gate, values: [5, null]}
monte_carlo: {runs: 20}
requirements:
  - {name: v, metric: velocity_error_3d, probability: 0.95, below: 0.3 m/s}
  - {name: a, metric: attitude_error_roll, at: stage1_cutoff, probability: 0.5, below: 1 mrad}
references:
  - {source: paper, case: {imu: good}, metric: velocity_error_3d, value: 0.1, unit: m/s}
"""


def test_a_resolved_campaign_reads_back_to_the_same_campaign(study) -> None:
    study.append(AXES)
    campaign = load(study.path)
    elsewhere = study.write("elsewhere/frozen.yaml", resolved_text(campaign))
    again = load(elsewhere)
    assert again == campaign
    assert resolved_text(again) == resolved_text(campaign)
    assert [case.id for case in cases(again)] == [case.id for case in cases(campaign)]


def test_a_resolved_campaign_needs_no_card(study) -> None:
    study.append(AXES)
    text = resolved_text(load(study.path))
    for file in study.folder.rglob("configs/*/*.yaml"):
        file.unlink()
    study.write("campaign.yaml", text)
    assert load(study.path).base.imu.name == "good"


def test_every_default_is_filled_in_when_a_campaign_is_resolved(study) -> None:
    text = resolved_text(load(study.path))
    for key in ("covariance_rate: 10.0 Hz", "gravity: j4", "history: 1.0 s", "design: grid", "kick_angle:"):
        assert key in text


def test_every_wrong_unit_of_a_campaign_and_its_cards_is_reported_at_once(study) -> None:
    study.append(
        "  faults:\n"
        "    - {kind: satellite_outage, start: 'stage1_cutoff + 20 deg', duration: 3 m}\n"
        "    - {kind: satellite_outage, from: 5 furlongs, until: injection + 5 s}\n"
        "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: initial.tilt, values: [1 kg, 2 lb]}\n"
        "requirements: [{name: a, metric: velocity_error_3d, probability: 99 deg, below: 1 deg}]\n"
        "references:\n  - {source: x, metric: velocity_error_3d, value: [], unit: kg}\n"
    )
    for name in ("good", "poor"):
        card = study.path.parent / f"configs/imu/{name}.yaml"
        card.write_text(card.read_text().replace("deg/sqrt(h)", "deg/rt-q"))
    with pytest.raises(InputError) as caught:
        load(study.path)
    found = sorted((record.path, Path(record.file).stem) for record in caught.value.records)
    assert found == [
        ("base.faults.0.duration", "campaign"),
        ("base.faults.0.start", "campaign"),
        ("base.faults.1.from", "campaign"),
        ("base.imu.gyro.random_walk", "good"),
        ("base.imu.gyro.random_walk", "poor"),
        ("base.initial.tilt", "campaign"),
        ("base.initial.tilt", "campaign"),
        ("references.0.unit", "campaign"),
        ("references.0.value", "campaign"),
        ("requirements.0.below", "campaign"),
        ("requirements.0.probability", "campaign"),
    ]
