"""A campaign file becomes a whole campaign: cards, overrides, defaults, and back to the same file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lvnav_trade.campaign import tree
from lvnav_trade.campaign.axes import cases
from lvnav_trade.campaign.load import load, resolved
from lvnav_trade.errors import InputError
from lvnav_trade.world.constellation import AlmanacConstellation

DEG_PER_HOUR = math.radians(1.0) / 3600.0


def test_a_card_becomes_settings_in_si(study) -> None:
    campaign = load(study.path)
    assert campaign.base.imu.name == "good"
    assert campaign.base.imu.gyro.bias_repeatability == pytest.approx(DEG_PER_HOUR, rel=1e-15)
    assert campaign.base.trajectory.vehicle.payload == 300.0


def test_an_override_changes_one_field_of_a_card_and_keeps_the_others(study) -> None:
    study.edit("campaign.yaml", "imu: imu/good", "imu: {card: imu/good, gyro: {bias_repeatability: 2 deg/h}}")
    imu = load(study.path).base.imu
    assert imu.gyro.bias_repeatability == pytest.approx(2 * DEG_PER_HOUR, rel=1e-15)
    assert imu.gyro.random_walk == pytest.approx(math.radians(0.03) / 60.0, rel=1e-15)
    assert imu.accel.bias_repeatability == pytest.approx(2e-3 * 9.80665, rel=1e-15)


def test_an_override_reaches_into_a_card_that_a_card_names(study) -> None:
    study.edit("campaign.yaml", "trajectories/climb", "{card: trajectories/climb, vehicle: {payload: 0.4 t}}")
    vehicle = load(study.path).base.trajectory.vehicle
    assert vehicle.payload == 400.0
    assert vehicle.name == "small"


def test_a_card_can_build_on_another_card(study) -> None:
    study.write("configs/imu/better.yaml", "card: imu/good\nname: better\naccel: {bias_repeatability: 1 mg}\n")
    study.edit("campaign.yaml", "imu/good", "imu/better")
    imu = load(study.path).base.imu
    assert imu.name == "better"
    assert imu.accel.bias_repeatability == pytest.approx(9.80665e-3, rel=1e-15)
    assert imu.gyro.bias_repeatability > 0


def test_a_card_can_be_a_path_beside_the_campaign(study) -> None:
    study.write("mine.yaml", (study.folder / "configs/imu/poor.yaml").read_text())
    for name in ("mine", "mine.yaml", "./mine", str(study.folder / "mine.yaml")):
        study.append("")
        study.edit("campaign.yaml", "imu/good", name)
        assert load(study.path).base.imu.name == "poor"


def test_the_users_card_hides_the_tools_card_of_the_same_name(study) -> None:
    study.write("configs/imu/tactical_fog.yaml", (study.folder / "configs/imu/poor.yaml").read_text())
    study.edit("campaign.yaml", "imu/good", "imu/tactical_fog")
    assert load(study.path).base.imu.name == "poor"


def test_a_card_of_the_tool_is_found_without_a_file_of_the_user(study) -> None:
    study.edit("campaign.yaml", "imu/good", "imu/tactical_fog")
    assert load(study.path).base.imu.name.startswith("Tactical grade")


def test_matched_is_a_word_and_no_card(study) -> None:
    study.write("configs/matched.yaml", "name: trap\n")
    study.edit("configs/filters/near.yaml", "kind: tight", "kind: tight\nimu: matched")
    assert load(study.path).base.filter.imu == "matched"


def test_a_file_is_found_from_the_file_that_names_it(study) -> None:
    study.write("configs/constellations/real.alm", "almanac\n")
    study.write("configs/constellations/real.yaml", "kind: almanac\nalmanac: real.alm\n")
    study.edit("campaign.yaml", "constellations/two", "constellations/real")
    constellation = load(study.path).base.constellation
    assert isinstance(constellation, AlmanacConstellation)
    assert constellation.almanac == str(study.folder.resolve() / "configs/constellations/real.alm")


def test_the_kind_is_inferred_from_a_key_that_only_one_kind_has(study) -> None:
    study.write("real.alm", "almanac\n")
    study.edit("campaign.yaml", "constellations/two", "{almanac: real.alm}")
    assert load(study.path).base.constellation.kind == "almanac"


def test_the_first_level_of_an_axis_stands_in_for_what_the_base_leaves_out(study) -> None:
    study.append("axes: [{path: imu, cards: [imu/poor, imu/good]}]\n")
    study.edit("campaign.yaml", "  imu: imu/good\n", "")
    assert load(study.path).base.imu.name == "poor"


def test_numbers_and_words_are_read_without_surprises() -> None:
    node = tree.parse("[1e-3, no, on, 12:30, 010, 0x10, 2017-08-24, '1', true, null]", "f", Path())
    assert tree.plain(node) == [1e-3, "no", "on", "12:30", 10, 16, "2017-08-24", "1", True, None]


def test_a_tree_that_is_dumped_reads_back_to_the_same() -> None:
    data = {"a": "1e-3", "b": ["no", "null", "true", "0x10", "x: y", "# no", "", "tab\tand\nline"], "c": None, "d": {}}
    numbers = {"e": [1e-3, 5e-324, 1e300, 0.1 + 0.2, -0.0, 2**62], "f": [True, False]}
    text = tree.dump({**data, **numbers})
    assert tree.plain(tree.parse(text, "f", Path())) == {**data, **numbers}


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
    elsewhere = study.write("elsewhere/frozen.yaml", resolved(campaign))
    again = load(elsewhere)
    assert again == campaign
    assert resolved(again) == resolved(campaign)
    assert [case.id for case in cases(again)] == [case.id for case in cases(campaign)]


def test_a_resolved_campaign_needs_no_card(study) -> None:
    study.append(AXES)
    text = resolved(load(study.path))
    for file in study.folder.rglob("configs/*/*.yaml"):
        file.unlink()
    study.write("campaign.yaml", text)
    assert load(study.path).base.imu.name == "good"


def test_every_default_is_filled_in_when_a_campaign_is_resolved(study) -> None:
    text = resolved(load(study.path))
    for key in ("covariance_rate: 10.0 Hz", "gravity: j4", "history: 1.0 s", "design: grid", "kick_angle:"):
        assert key in text


@pytest.mark.parametrize(
    ("assignment", "get", "value"),
    [
        ("seed=8", lambda c: c.seed, 8),
        ("monte_carlo.runs=500", lambda c: c.monte_carlo.runs, 500),
        ("imu=imu/poor", lambda c: c.base.imu.name, "poor"),
        ("base.imu=imu/poor", lambda c: c.base.imu.name, "poor"),
        ("imu.rate=400 Hz", lambda c: c.base.imu.rate, 400.0),
        ("filter.gate=5", lambda c: c.base.filter.gate, 5.0),
        ("filter.kind=loose", lambda c: c.base.filter.kind, "loose"),
        ("trajectory.vehicle.payload=0.4 t", lambda c: c.base.trajectory.vehicle.payload, 400.0),
        ("trajectory.vehicle.stages.0.dry=4 t", lambda c: c.base.trajectory.vehicle.stages[0].dry, 4000.0),
        ("base.constellation={almanac: my.alm}", lambda c: Path(c.base.constellation.almanac).name, "my.alm"),
        ("constellation.almanac=my.alm", lambda c: Path(c.base.constellation.almanac).name, "my.alm"),
        ("initial.tilt=1 mrad", lambda c: c.base.initial.tilt, 1e-3),
        ("faults=[{start: 100 s, duration: 30 s}]", lambda c: c.base.faults[0].duration, 30.0),
        ("design=zip", lambda c: c.design, "zip"),
    ],
)
def test_set_changes_one_thing(study, assignment: str, get, value: object) -> None:
    study.write("my.alm", "almanac\n")
    assert get(load(study.path, [assignment])) == value


def test_set_reaches_an_axis_by_its_index(study) -> None:
    study.append(AXES)
    campaign = load(study.path, ["axes.0.cards=[imu/poor]", "axes.1.values.0=7"])
    assert [case.label for case in cases(campaign)] == ["imu=poor, gate=7", "imu=poor, gate=none"]


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("seed", "--set 'seed': should be path=value, such as monte_carlo.runs=500"),
        ("=8", "--set '=8': should be path=value, such as monte_carlo.runs=500"),
        ("seed=", "--set: seed: has no value after '='"),
        ("sead=8", "--set: sead: unknown path (did you mean 'seed'?)"),
        ("imu.gyroo.random_walk=1", "--set: base.imu.gyroo: unknown path (did you mean 'gyro'?)"),
        ("filter.gatt=5", "--set: base.filter.gatt: unknown path (did you mean 'gate'?)"),
        ("filter.gate=-5", "--set: base.filter.gate: should be greater than 0, not -5"),
        ("imu.rate=400 Hzz",
         "--set: base.imu.rate: '400 Hzz' has no unit that is known ('Hzz'); expected frequency (Hz)"
         " (did you mean 'Hz'?)"),
        ("faults.0.keep=1", "--set: base.faults: '0' is not an item of a list of 0 (0 is the first)"),
        ("seed=[1", "--set: seed: '[1': is not YAML: expected ',' or ']', but got '<stream end>'"),
        ("constellation.almanac=my.alm", "--set: base.constellation.almanac: no such file: 'my.alm'"),
    ],
)  # fmt: skip
def test_a_bad_assignment_is_told_in_one_line(study, assignment: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(study.path, [assignment])
    assert str(caught.value) == message


def test_what_an_axis_varies_cannot_be_set(study) -> None:
    study.append(AXES)
    with pytest.raises(InputError, match=r"^--set: base\.imu\.rate: is varied by axis 0 \(imu\); set axes\.0 instead$"):
        load(study.path, ["imu.rate=400 Hz"])
