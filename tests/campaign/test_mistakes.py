"""Every mistake in a campaign or a card is one line that says where and what."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.sensors.family import MEASUREMENTS
from tests.campaign.mistakes import BAD
from tests.campaign.near_misses import NEAR


@pytest.mark.parametrize("what", [*BAD, *NEAR])
def test_a_mistake_is_reported_in_one_line(study, what: str) -> None:
    file, old, new, message = (BAD | NEAR)[what]
    study.edit(file, old, new)
    with pytest.raises(InputError) as caught:
        load(study.path.name)
    assert str(caught.value) == message


def test_what_may_point_either_way_keeps_its_sign(study) -> None:
    study.edit("configs/receivers/plain.yaml", "name: plain", "name: plain\nlever_b: [-1 m, 0, -2 m]\nmask: -5 deg")
    study.edit("configs/constellations/two.yaml", 'node: "60 deg"', "node: -60 deg")
    ramp = "temperature: {start: -30 s, end: 100 s, amplitude: [-1 deg/h, 0, 0]}"
    study.edit("configs/imu/good.yaml", "gyro: {", f"gyro: {{{ramp}, ")
    base = load("campaign.yaml").base
    assert base.receiver.lever_b == (-1.0, 0.0, -2.0)
    assert base.receiver.mask < 0.0
    assert base.constellation.slots[1].node < 0.0
    assert base.imu.gyro.temperature.amplitude[0] < 0.0
    assert base.trajectory.site.latitude < 0.0


def test_several_mistakes_are_reported_together_each_in_its_line(study) -> None:
    study.edit("campaign.yaml", "seed: 7", "seed: seven")
    study.edit("campaign.yaml", "imu/good", "imu/goood")
    study.edit("configs/filters/near.yaml", "range_rate", "range_rat")
    with pytest.raises(InputError) as caught:
        load("campaign.yaml")
    assert str(caught.value).splitlines() == [
        "campaign.yaml:2:7: seed: should be a valid integer, not 'seven'",
        "campaign.yaml:5:8: base.imu: no card 'imu/goood' (did you mean 'imu/good'?)",
        "configs/filters/near.yaml:3:29: base.filter.measurements.1: 'range_rat' is not one of "
        f"{', '.join(MEASUREMENTS)} (did you mean 'range_rate'?)",
    ]


def test_a_mistake_is_also_data(study) -> None:
    study.edit("campaign.yaml", "seed: 7", "seed: seven")
    with pytest.raises(InputError) as caught:
        load("campaign.yaml")
    assert caught.value.records[0]._asdict() == {
        "message": "should be a valid integer, not 'seven'",
        "path": "seed",
        "file": "campaign.yaml",
        "line": 2,
        "column": 7,
    }


def test_a_campaign_that_is_not_there_is_reported_with_the_nearest_name(study) -> None:
    with pytest.raises(InputError, match=r"^campain\.yaml: no such file \(did you mean 'campaign\.yaml'\?\)$"):
        load("campain.yaml")


def test_a_folder_is_no_campaign(study) -> None:
    with pytest.raises(InputError, match=r"^configs: is a folder, not a YAML file$"):
        load("configs")
