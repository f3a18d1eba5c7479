"""No label says what its case does not have: axes that replace others, levels and labels that are equal."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError

START = '{tilt: "9 deg", heading: "1 deg", position: "1 m", velocity: "1 m/s"}'
TILT = '  - {path: initial.tilt, values: ["0.1 deg", "0.2 deg"]}\n'
WHOLE = f"  - {{path: initial, values: [{START}], labels: [far]}}\n"


def reported(study, text: str) -> str:
    study.append(text)
    with pytest.raises(InputError) as caught:
        load(study.path)
    return str(caught.value)


def test_a_field_under_a_later_axis_is_refused(study) -> None:
    assert reported(study, f"axes:\n{TILT}{WHOLE}") == (
        "campaign.yaml:11:12: axes.0.path: 'initial.tilt': the later axis 'initial' replaces it; put that axis first"
    )


@pytest.mark.parametrize("path", ["filter.corrections.troposphere", "base.filter.corrections.troposphere"])
def test_a_field_deep_under_a_later_axis_is_refused_however_the_path_is_written(study, path: str) -> None:
    axes = f"axes:\n  - {{path: {path}, values: [{{kind: none}}]}}\n  - {{path: filter, cards: [filters/near]}}\n"
    assert f"{path!r}: the later axis 'filter' replaces it" in reported(study, axes)


def test_a_field_after_its_settings_is_varied_in_them_and_has_what_its_label_says(study) -> None:
    study.append(f"axes:\n{WHOLE}{TILT}")
    found = {case.axes["tilt"]: case.scenario.initial for case in cases(load(study.path))}
    assert {label: round(math.degrees(one.tilt), 9) for label, one in found.items()} == {"0.1 deg": 0.1, "0.2 deg": 0.2}
    assert {one.velocity for one in found.values()} == {1.0}


def test_where_one_axis_is_varied_at_a_time_a_field_and_its_settings_do_not_meet(study) -> None:
    study.append(f"axes:\n{TILT}{WHOLE}design: one_at_a_time\n")
    assert [case.label for case in cases(load(study.path))] == ["base", "tilt=0.2 deg", "initial=far"]


@pytest.mark.parametrize("design", ["grid", "zip", "one_at_a_time"])
def test_the_same_field_twice_is_refused(study, design: str) -> None:
    axes = "axes:\n  - {path: filter.gate, values: [4]}\n  - {path: base.filter.gate, values: [5]}\n"
    wanted = "'filter.gate': the later axis 'base.filter.gate' varies the same field"
    assert wanted in reported(study, f"{axes}design: {design}\n")


@pytest.mark.parametrize(
    "axis",
    [
        "{path: filter.gate, values: [4, 4]}",
        "{path: filter.gate, values: [4, 4.0]}",
        "{path: imu, cards: [imu/good, imu/good]}",
        "{path: imu, cards: [imu/good, good], labels: [one, two]}",
        "{path: initial.tilt, values: [0.1 deg, 0.10 deg]}",
    ],
)
def test_the_same_level_twice_is_refused(study, axis: str) -> None:
    study.write("good.yaml", (study.folder / "configs/imu/good.yaml").read_text())
    assert "the same as level 0 of the axis" in reported(study, f"axes: [{axis}]\n")


def test_a_zip_may_repeat_a_level_but_not_a_pair(study) -> None:
    imu = "  - {path: imu, cards: [imu/good, imu/good], labels: [a, b]}\n"
    study.append(f"axes:\n{imu}  - {{path: filter.gate, values: [4, 5]}}\ndesign: zip\n")
    assert len(cases(load(study.path))) == 2
    same = f"axes:\n{imu}  - {{path: filter.gate, values: [4, 4], labels: [c, d]}}\ndesign: zip\n"
    assert "level 1 of every axis is the same as level 0" in reported(study, same)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ('["a", ""]', "'' is no label"),
        ('["a", "b\\e[2J"]', r"'b\x1b[2J' has the hidden character U+001B; remove it"),
        (f'["a", "{"b" * 300}"]', "is no label: 1 to 200 printable characters"),
    ],
)
def test_a_label_that_cannot_be_read_is_refused(study, labels: str, message: str) -> None:
    assert message in reported(study, f"axes: [{{path: filter.gate, values: [4, 5], labels: {labels}}}]\n")


def test_the_label_of_the_base_is_the_bases_own(study) -> None:
    axes = "axes: [{path: filter.gate, values: [4, 5], labels: [base, wide]}]\n"
    assert "'base' is the label of the base" in reported(study, f"{axes}design: one_at_a_time\n")


def test_two_cases_of_the_same_label_are_refused(study) -> None:
    axes = (
        "axes:\n  - {path: filter.gate, values: [4, 5], labels: [x, 'x, rate=y']}\n"
        "  - {path: imu.rate, values: [100 Hz, 200 Hz], labels: [y, 'y, rate=y']}\n"
    )
    assert "two cases have the label 'gate=x, rate=y, rate=y'" in reported(study, axes)


def test_more_cases_than_are_computed_are_refused_before_any_is_built(study) -> None:
    paths = ("filter.gate", "initial.tilt", "initial.heading", "initial.position", "initial.velocity")
    levels = ", ".join(map(str, range(1, 61)))
    axes = "".join(f"  - {{path: {path}, values: [{levels}]}}\n" for path in paths)
    assert "axes: 777600000 cases; at most 100000 are computed" in reported(study, f"axes:\n{axes}")


def test_more_axes_than_are_varied_are_refused(study) -> None:
    axes = "  - {path: filter.gate, values: [4]}\n" * 30
    assert "axes: 30 axes; at most 20 are varied" in reported(study, f"axes:\n{axes}")


def test_an_axis_into_a_list_that_another_level_does_not_have_is_reported(study) -> None:
    fault = "{kind: satellite_outage, start: 100 s, duration: 30 s}"
    axes = (
        f"axes:\n  - {{path: faults, values: [[], [{fault}]], labels: [none, one]}}\n"
        "  - {path: faults.0.keep, values: [1, 2]}\n"
    )
    study.append(axes)
    study.edit("campaign.yaml", "imu: imu/good", f"imu: imu/good\n  faults: [{fault}]")
    with pytest.raises(InputError, match="'0' is not an item of a list of 0"):
        load(study.path)


def test_levels_of_a_zip_that_are_equal_share_a_label_and_others_do_not(study) -> None:
    axes = (
        "axes:\n  - {path: imu, cards: [imu/good, imu/good, imu/poor]}\n"
        "  - {path: filter.gate, values: [4, 5, 4], labels: [narrow, wide, narrow]}\ndesign: zip\n"
    )
    study.append(axes)
    assert [case.label for case in cases(load(study.path))] == [
        "imu=good, gate=narrow", "imu=good, gate=wide", "imu=poor, gate=narrow"
    ]  # fmt: skip


def test_levels_of_a_zip_that_differ_need_labels_of_their_own(study) -> None:
    axes = "axes:\n  - {path: filter.gate, values: [4, 5], labels: [same, same]}\ndesign: zip\n"
    assert "axes.0.values: two levels have the same label; give labels" in reported(study, axes)
