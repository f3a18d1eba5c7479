"""Cards become whole settings: overrides on top, kinds inferred, paths found from the file that names them."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.gnss.constellation import AlmanacConstellation
from lvnav_trade.quantities.errors import InputError

DEG_PER_HOUR = math.radians(1.0) / 3600.0


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


def test_matched_is_a_word_and_no_card(study) -> None:
    study.write("configs/matched.yaml", "name: trap\n")
    study.edit(
        "configs/filters/near.yaml",
        "measurements: [pseudorange, range_rate]",
        "measurements: [pseudorange, range_rate]\nimu: matched",
    )
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


def test_files_in_a_list_are_found_and_the_one_that_is_not_is_reported_by_its_place(study) -> None:
    study.write("one.rnx", "one\n")
    study.write("two.rnx", "two\n")
    study.edit("campaign.yaml", "constellations/two", "{rinex: [one.rnx, two.rnx]}")
    constellation = load(study.path).base.constellation
    assert constellation.kind == "rinex"
    assert constellation.rinex == tuple(str(study.folder.resolve() / name) for name in ("one.rnx", "two.rnx"))
    study.edit("campaign.yaml", "two.rnx", "three.rnx")
    with pytest.raises(InputError, match=r"base\.constellation\.rinex\.1: no such file: 'three\.rnx'$"):
        load(study.path)


def test_parts_of_a_constellation_may_be_cards_with_fields_changed(study) -> None:
    study.edit("campaign.yaml", "constellations/two",
               "{parts: [constellations/two, {card: constellations/galileo_24, time_offset: 2 m}]}")  # fmt: skip
    constellation = load(study.path).base.constellation
    assert [part.kind for part in constellation.parts] == ["nominal", "nominal"]
    assert constellation.parts[1].time_offset == 2.0
    assert constellation.parts[1].system == "Galileo"


def test_settings_in_a_list_may_be_cards_too(study) -> None:
    study.write("configs/faults/short.yaml", "kind: satellite_outage\nstart: 100 s\nduration: 5 s\n")
    study.edit(
        "campaign.yaml", "  imu: imu/good", "  imu: imu/good\n  faults: [faults/short, {card: faults/short, keep: 2}]"
    )
    faults = load(study.path).base.faults
    assert [(fault.duration, fault.keep) for fault in faults] == [(5.0, 0), (5.0, 2)]


def test_an_override_may_itself_name_a_card(study) -> None:
    study.write("configs/vehicles/heavy.yaml", "card: vehicles/small\nname: heavy\npayload: 500 kg\n")
    text = "{card: trajectories/climb, vehicle: {card: vehicles/heavy, max_load: 5 g}}"
    study.edit("campaign.yaml", "trajectories/climb", text)
    vehicle = load(study.path).base.trajectory.vehicle
    assert (vehicle.name, vehicle.payload) == ("heavy", 500.0)
    assert vehicle.max_load == pytest.approx(5 * 9.80665)


def test_every_mistake_is_collected_and_expansion_goes_on(study) -> None:
    study.edit("campaign.yaml", "imu/good", "imu/goood")
    study.edit("campaign.yaml", "filters/near", "filters/nera")
    with pytest.raises(InputError) as caught:
        load(study.path.name)
    assert [record.path for record in caught.value.records] == ["base.imu", "base.filter"]


def test_a_card_that_is_named_by_a_number_is_refused(study) -> None:
    study.edit("campaign.yaml", "imu/good", "{card: 3}")
    with pytest.raises(InputError, match=r"^campaign\.yaml:5:15: base\.imu: a card is named by a word such as"):
        load(study.path.name)


def test_a_folder_in_place_of_a_file_is_reported_as_one(study) -> None:
    study.edit("campaign.yaml", "constellations/two", "{almanac: configs}")
    with pytest.raises(InputError, match=r"base\.constellation\.almanac: is a folder, not a file: 'configs'$"):
        load(study.path.name)


FILTERED = "{kind: filtered, range_sigma: 2 m, rate_sigma: 0.1 m/s, jerk: 1 m/s^3, clock_noise: 1 m/s^2}"


def test_an_override_of_another_kind_replaces_the_cards_settings(study) -> None:
    study.edit("campaign.yaml", "receivers/plain", f"{{card: receivers/plain, solution: {FILTERED}}}")
    study.edit("configs/filters/near.yaml", "[pseudorange, range_rate]", "[position, velocity]")
    solution = load(study.path).base.receiver.solution
    assert solution.kind == "filtered"
    assert solution.range_sigma == 2.0


def test_an_override_of_the_same_kind_keeps_the_cards_other_fields(study) -> None:
    study.edit("campaign.yaml", "receivers/plain", "{card: receivers/plain, solution: {kind: direct, bias_time: 9 s}}")
    solution = load(study.path).base.receiver.solution
    assert (solution.position_sigma, solution.bias_time) == (3.0, 9.0)


def test_an_override_of_another_kind_leaves_nothing_of_a_card_so_the_card_is_refused(study) -> None:
    study.edit("campaign.yaml", "constellations/two", "{card: constellations/two, kind: almanac, almanac: x}")
    with pytest.raises(InputError, match=r"constellation\.kind: the card 'constellations/two' is of another kind"):
        load(study.path)


def test_a_setting_of_another_kind_over_a_card_names_both_kinds(study) -> None:
    study.edit("campaign.yaml", "constellations/two", "{card: constellations/two, almanac: x}")
    with pytest.raises(
        InputError,
        match=r"constellation\.almanac: the card 'constellations/two' is of kind nominal, which has no almanac; name a "
        "card of kind almanac",
    ):
        load(study.path)


def test_a_card_named_by_an_override_keeps_nothing_of_the_card_it_replaces(study) -> None:
    text = (study.folder / "configs/vehicles/small.yaml").read_text()
    study.write("configs/vehicles/plain.yaml", text.replace("name: small", "name: plain"))
    study.edit(
        "configs/vehicles/small.yaml", "name: small", "name: small\nfairing: {mass: 100 kg, after_ignition: 9 s}"
    )
    study.edit("campaign.yaml", "trajectories/climb", "{card: trajectories/climb, vehicle: vehicles/plain}")
    vehicle = load(study.path).base.trajectory.vehicle
    assert (vehicle.name, vehicle.fairing) == ("plain", None)
