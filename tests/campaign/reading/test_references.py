# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""What a published number names is there: cases, axes, levels, axes of a frame; its unit is one of its metric."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.checks import named_cases, unknown_case
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study_card import load_study
from lvnav_trade.quantities.errors import InputError

AXES = "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, values: [4, 5]}\n"
PUBLISHED = "references:\n  - {source: x, case: {imu: good}, metric: velocity_error_3d, value: 1, unit: m/s}\n"


def reported(study, text: str) -> str:
    study.append(AXES + text)
    with pytest.raises(InputError) as caught:
        load(study.path)
    return str(caught.value)


def test_numbers_of_cases_that_are_there_are_read(study) -> None:
    study.append(AXES + PUBLISHED)
    assert load(study.path).references[0].case == {"imu": "good"}
    assert load(study.path, ["axes.0.cards=[imu/poor]"]).references == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PUBLISHED.replace("good", "god"), "references.0.case: no level 'god' of the axis imu (did you mean 'good'?)"),
        (PUBLISHED.replace("imu: good", "imus: good"), "references.0.case: no axis 'imus' (did you mean 'imu'?)"),
        (PUBLISHED.replace("imu: good", "design: grid"), "references.0.case: no axis 'design' (known: imu, gate)"),
        (PUBLISHED.replace("case: {", "against: {imu: bad}, case: {").replace("m/s", "'%'"),
         "references.0.against: no level 'bad' of the axis imu (known: good, poor)"),
        (PUBLISHED.replace("case: {", "against: {imu: poor}, case: {").replace("m/s", "'%'"),
         "references.0.against: 2 cases have these levels; name one"),
        (PUBLISHED.replace("_3d", "_x"), "references.0.metric: 'velocity_error_x': no such axis; velocity has north, east, down"),
        (PUBLISHED.replace("velocity_error_3d", "speed_error_3d"), "'speed_error_3d' is not a metric"),
        (PUBLISHED.replace("m/s", "kg"), "'1 kg' has the wrong unit; expected speed (m/s, km/s)"),
        (PUBLISHED.replace("velocity_error_3d", "satellites_tracked"), "unit: 'm/s' does not fit satellites_tracked; expected '-'"),
        (PUBLISHED.replace("value: 1", "value: .nan"), "references.0.value: should be a finite number"),
        (PUBLISHED.replace("value: 1", "value: .inf"), "references.0.value: should be a finite number"),
        (PUBLISHED.replace("value: 1", "value: 1e300"), "references.0.value: 1e+300 is too large"),
        (PUBLISHED.replace("value: 1", "value: true"), "references.0.value: should be a number, not true"),
        (PUBLISHED.replace("value: 1", "value: 1, than: position_error_3d").replace("m/s", "'%'"),
         "than: position_error_3d is in m, velocity_error_3d in m/s"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_reported(study, text: str, message: str) -> None:
    assert message in reported(study, text)


def test_a_pair_of_a_zip_that_is_no_case_is_reported(study) -> None:
    text = PUBLISHED.replace("imu: good", "imu: good, gate: '5'")
    assert "references.0.case: no case has these levels together" in reported(study, f"design: zip\n{text}")


def test_the_bases_own_value_is_no_case_beside_the_base(study) -> None:
    study.append(f"{AXES}design: one_at_a_time\n")
    cases = named_cases(load(study.path))
    assert [case["imu"] for case in cases] == ["base", "poor", "base", "base"]
    assert "no level 'good'" in unknown_case({"imu": "good"}, cases)
    assert unknown_case({"imu": "poor"}, cases, single=True) == ""


def test_a_study_is_reported_the_cases_and_axes_that_its_campaigns_do_not_have(study) -> None:
    study.append(AXES)
    study.write(
        "study.yaml",
        "title: x\ndescription: x\ncampaigns:\n  - campaign: campaign\n    paired: imuu\n"
        "    figures: [{plot: envelope, case: {imu: pur}}, {plot: envelopes}]\n    kml: {gate: '7'}\n",
    )
    with pytest.raises(InputError) as caught:
        load_study(study.folder)
    records = {record.path: record for record in caught.value.records}
    figures = ["campaigns.0.figures.0.case", "campaigns.0.figures.1.plot"]
    assert sorted(records) == [*figures, "campaigns.0.kml", "campaigns.0.paired"]
    assert all(record.file == "study.yaml" and record.line for record in records.values())
