"""Axes become cases: designs, labels."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.definition import axes as definition
from lvnav_trade.campaign.definition.axes import Scenarios, cases, combinations, level_label, levels, with_value
from lvnav_trade.campaign.definition.case_digest import case_id
from lvnav_trade.campaign.definition.schema import Axis
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario

CAMPAIGNS = Path(__file__).parents[3] / "campaigns"
TWO = "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, values: [4, 5]}\n"


def labels(study, design: str) -> list[str]:
    study.append(f"{TWO}design: {design}\n")
    return [case.label for case in cases(load(study.path))]


def test_no_axis_is_one_case(study) -> None:
    assert [(case.label, case.axes) for case in cases(load(study.path))] == [("base", {})]


def test_a_grid_crosses_all_levels_with_the_last_axis_fastest(study) -> None:
    assert labels(study, "grid") == ["imu=good, gate=4", "imu=good, gate=5", "imu=poor, gate=4", "imu=poor, gate=5"]


def test_an_axis_may_reach_into_a_section_that_the_base_leaves_out() -> None:
    assert with_value({"filter": {"envelope": None}}, ["filter", "envelope", "burn"], 1) == {
        "filter": {"envelope": {"burn": 1}}
    }


def test_a_zip_pairs_levels(study) -> None:
    assert labels(study, "zip") == ["imu=good, gate=4", "imu=poor, gate=5"]


def test_one_at_a_time_varies_each_axis_around_the_base_and_asks_nothing_twice(study) -> None:
    # imu=good is the base itself, so it is not a case of its own.
    assert labels(study, "one_at_a_time") == ["base", "imu=poor", "gate=4", "gate=5"]


def test_an_axis_that_is_crossed_has_its_levels_in_every_case_of_one_at_a_time(study) -> None:
    crossed = "  - {path: initial.tilt, values: [0.1 deg, 0.2 deg], crossed: true}\n"
    study.append(f"{TWO}{crossed}design: one_at_a_time\n")
    found = cases(load(study.path))
    others = ["base", "poor", "4", "5"]
    assert [case.label.replace("base, ", "") for case in found] == [
        f"{other}tilt={tilt} deg" for other in ("", "imu=poor, ", "gate=4, ", "gate=5, ") for tilt in (0.1, 0.2)
    ]
    assert len(found) == 2 * len(others)


def test_crossing_is_of_one_at_a_time(study) -> None:
    study.append("axes:\n  - {path: initial.tilt, values: [0.1 deg, 0.2 deg], crossed: true}\n")
    with pytest.raises(InputError, match="crossed has no effect"):
        load(study.path)


def test_the_names_of_axes_are_computed_once_for_all_cases(monkeypatch) -> None:
    """A design space has up to 100 000 cases."""
    calls = []

    def counted(axes):
        calls.append(axes)
        return names_of(axes)

    names_of = definition.axis_names
    monkeypatch.setattr(definition, "axis_names", counted)
    axes = [Axis(path=path, values=("1 deg/h", "2 deg/h")) for path in ("imu.gyro.bias", "imu.gyro.in_run")]
    assert len(combinations("grid", axes)) == 4
    assert len(calls) == 1


def test_a_design_without_axes_has_one_case() -> None:
    assert list(levels("grid", [])) == [()]


def test_the_axes_of_a_case_name_its_levels(study) -> None:
    study.append(TWO)
    assert cases(load(study.path))[0].axes == {"imu": "good", "gate": "4"}


def test_two_axes_of_the_same_last_word_are_known_by_their_paths(study) -> None:
    study.append(
        "axes:\n  - {path: imu.gyro.bias_repeatability, values: [1 deg/h]}\n"
        "  - {path: imu.accel.bias_repeatability, values: [1 mg]}\n"
    )
    names = list(cases(load(study.path))[0].axes)
    assert names == ["imu.gyro.bias_repeatability", "imu.accel.bias_repeatability"]


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        (["0.5 deg/h", "4.763157895 deg/h"], ["0.5 deg/h", "4.76316 deg/h"]),
        ([1.23456789e-9, 2], ["1.23457e-09", "2"]),
        (["1.00000001 m", "1.00000002 m"], ["1.00000001 m", "1.00000002 m"]),  # they would be the same
        (["20241221 cards", 12345678], ["20241221 cards", "12345678"]),
    ],
)
def test_long_numbers_are_rounded_in_labels_where_levels_stay_apart(values, shown) -> None:
    axis = Axis(path="imu", values=values)
    assert [level_label(axis, k) for k in range(len(values))] == shown


def test_labels_of_the_user_are_kept(study) -> None:
    study.append("axes: [{path: imu, cards: [imu/good, imu/poor], labels: [A, B]}]\n")
    assert [case.label for case in cases(load(study.path))] == ["imu=A", "imu=B"]


def test_a_digest_is_twelve_hexadecimal_digits_that_stand_for_the_numbers(study) -> None:
    first = cases(load(study.path))[0].id
    assert len(first) == 12
    assert int(first, 16) >= 0
    study.edit("configs/imu/good.yaml", '"1 deg/h"', '"3600 deg/h/h*s"')  # the same number in another spelling
    assert cases(load(study.path))[0].id == first
    study.edit("campaign.yaml", "name: study", "name: other")  # a name is no number
    assert cases(load(study.path))[0].id == first


@pytest.mark.parametrize(
    "assignment", ["seed=8", "imu.rate=400 Hz", "filter.gate=5", "frame=ecef", "initial.tilt=0.2 deg"]
)
def test_a_digest_changes_with_what_the_numbers_depend_on(study, assignment: str) -> None:
    assert cases(load(study.path, [assignment]))[0].id != cases(load(study.path))[0].id


def test_a_digest_does_not_depend_on_runs_or_requirements(study) -> None:
    first = cases(load(study.path))[0].id
    study.append(
        "monte_carlo: {runs: 99}\nrequirements: [{name: a, metric: position_error_3d, probability: 0.5, below: 1 m}]\n"
    )
    assert cases(load(study.path))[0].id == first


def test_a_file_counts_by_its_content_and_not_by_its_path(study) -> None:
    study.write("one.alm", "almanac\n")
    study.write("two.alm", "almanac\n")
    ids = [cases(load(study.path, [f"constellation.almanac={name}.alm"]))[0].id for name in ("one", "two")]
    assert ids[0] == ids[1]
    study.write("two.alm", "another almanac\n")
    assert cases(load(study.path, ["constellation.almanac=two.alm"]))[0].id != ids[0]


def test_every_file_of_a_list_and_of_a_part_counts_by_its_content(study) -> None:
    def digest():
        return cases(load(study.path))[0].id

    for name in ("one.rnx", "two.rnx"):
        study.write(name, f"{name}\n")
    study.edit("campaign.yaml", "constellations/two", "{parts: [constellations/two, {rinex: [one.rnx, two.rnx]}]}")
    first = digest()
    assert digest() == first
    study.write("two.rnx", "another\n")
    assert digest() != first


def test_an_axis_reaches_into_a_list(study) -> None:
    study.edit(
        "campaign.yaml",
        "  imu: imu/good",
        "  imu: imu/good\n  faults: [{start: 100 s, duration: 30 s, kind: satellite_outage}]",
    )
    study.path.write_text(study.path.read_text() + "axes: [{path: faults.0.keep, values: [1, 2, 3]}]\n")
    assert [case.scenario.faults[0].keep for case in cases(load(study.path))] == [1, 2, 3]


def test_an_axis_over_an_item_that_is_not_there_is_refused(study) -> None:
    study.append("axes: [{path: faults.0.keep, values: [1, 2, 3]}]\n")
    with pytest.raises(InputError, match=r"'faults\.0\.keep' is not a field of the base"):
        load(study.path)


def test_cases_share_the_cards_that_no_axis_varies(study):
    study.append(
        "axes:\n  - {path: receiver.mask, values: [5 deg, 6 deg]}\n  - {path: initial.tilt, values: [1 mrad, 2 mrad]}\n"
    )
    found = cases(load("campaign.yaml"))
    assert len({id(case.scenario.imu) for case in found}) == 1
    assert len({id(case.scenario.receiver) for case in found}) == 2
    assert len({id(case.scenario.initial) for case in found}) == 2
    for case in found:
        alone = Scenario.model_validate(case.scenario.model_dump(mode="json"))
        assert case.id == case_id(alone, load("campaign.yaml").seed, load("campaign.yaml").keep.history)


def test_a_case_that_is_refused_names_the_field_though_cards_are_shared():
    scenarios = Scenarios(["receiver"])
    with pytest.raises(ValidationError, match="mask"):
        scenarios.validate((0,), {"receiver": {"mask": "steep"}})


def _validations(monkeypatch) -> list[object]:
    """Return a list that grows with every validation of a scenario."""
    made, validate = [], Scenario.model_validate
    monkeypatch.setattr(Scenario, "model_validate", lambda data: made.append(data) or validate(data))
    return made


@pytest.mark.parametrize("name", ["demo.yaml", "conae/antenna_failure.yaml", "world/vehicles.yaml", "dlr/ekf_ukf.yaml"])
def test_a_case_is_validated_once(monkeypatch, name) -> None:
    made = _validations(monkeypatch)
    assert len(cases(load(CAMPAIGNS / name))) >= len(made) > 0


def test_a_level_that_a_later_axis_changes_is_validated_alone_too(study, monkeypatch) -> None:
    study.append("axes:\n  - {path: filter, cards: [filters/tight]}\n  - {path: filter.gate, values: [4, 5]}\n")
    made = _validations(monkeypatch)
    campaign = load(study.path)
    assert len(cases(campaign)) == 2
    assert len(made) == 3
    assert campaign.axes[0].values[0]["gate"] not in (4, 5)


@pytest.mark.parametrize("name", ["demo.yaml", "conae/settings.yaml", "trade/find_imu.yaml", "gains/polar.yaml"])
def test_cases_of_reading_are_those_of_the_resolved_campaign(name) -> None:
    campaign = load(CAMPAIGNS / name)
    again = campaign.model_copy()  # of which no scenario is known
    assert cases(campaign) == cases(again)
    assert [case.id for case in cases(campaign)] == [case.id for case in cases(again)]


def test_levels_of_a_zip_need_not_work_alone(study) -> None:
    study.append(
        "axes:\n  - {path: filter.measurements, values: [[pseudorange], [position, velocity]]}\n"
        "  - {path: filter.init, values: [from_card, from_gnss]}\ndesign: zip\n"
    )
    assert len(cases(load(study.path))) == 2
