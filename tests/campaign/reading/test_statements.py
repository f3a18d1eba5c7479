# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""What a statement names is there: cases, axes, levels, axes of a frame; its unit is one of its metric."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.checks import named_cases, unknown_case
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study import load_study
from lvnav_trade.errors import InputError

AXES = "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, values: [4, 5]}\n"
PUBLISHED = "references:\n  - {source: x, case: {imu: good}, metric: velocity_error_3d, value: 1, unit: m/s}\n"
ORDER = (
    "orderings:\n  - {source: x, metric: velocity_error_3d, cases: [{imu: good, gate: '4'}, {imu: poor, gate: '4'}]}\n"
)
WHITE = "innovations:\n  - {source: x, case: {imu: good}}\n"
RATIO = (
    "statements:\n  - {source: x, id: one, value: a / b, at_most: 2, along: gate, case: {gate: '4'}, terms: {"
    "a: {case: {imu: good}, metric: velocity_error_3d}, b: {case: {imu: poor}, metric: velocity_error_3d}}}\n"
)


def reported(study, text: str) -> str:
    study.append(AXES + text)
    with pytest.raises(InputError) as caught:
        load(study.path)
    return str(caught.value)


def test_statements_on_cases_that_are_there_are_read(study) -> None:
    study.append(AXES + PUBLISHED + ORDER + WHITE + RATIO)
    found = load(study.path)
    counts = (found.references, found.orderings, found.innovations, found.statements)
    assert [*map(len, counts)] == [1, 1, 1, 1]
    assert found.statements[0].case_of("b") == {"gate": "4", "imu": "poor"}
    fewer = load(study.path, ["axes.0.cards=[imu/good]"])
    assert fewer.statements == ()


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
        (ORDER.replace("imu: poor", "imu: pear"), "orderings.0.cases.1: no level 'pear' of the axis imu"),
        (ORDER.replace("poor, gate: '4'}]", "poor}]"), "orderings.0.cases.1: 2 cases have these levels; name one"),
        (WHITE.replace("good", "goood"), "innovations.0.case: no level 'goood'"),
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
        (RATIO.replace("imu: good", "imu: goood"), "statements.0.terms.a.case: no level 'goood' of the axis imu"),
        (RATIO.replace(", case: {gate: '4'}", "").replace("imu: good}", "imu: good, gate: '4'}"),
         "statements.0.terms.b.case: 2 cases have these levels; name one"),
        (RATIO.replace("along: gate", "along: gates"), "statements.0.along: no axis 'gates' (did you mean 'gate'?)"),
        (RATIO.replace("3d}}", "3d, minus: {imu: pur}}}"), "statements.0.terms.b.minus: no level 'pur' of the axis imu"),
        (RATIO.replace("3d}}", "3d, minus: {}, statistic: worst, during: flight}}"), "minus is of an error at an event"),
        (RATIO.replace("3d}}", "3d, over: gaet}}"), "statements.0.terms.b.over: no axis 'gaet' (did you mean 'gate'?)"),
        (RATIO.replace("3d}}", "3d, elevation: [1 deg, 2 deg]}}"), "elevation and altitude choose signals (troposphere,"),
        (RATIO + RATIO.partition("\n")[2], "statements.1.id: 'one' stands twice"),
        (RATIO.replace("velocity_error_3d}}", "velocity_error_x}}"), "statements.0.terms.b.metric: 'velocity_error_x': no such axis"),
        (RATIO.replace("velocity_error_3d}}", "velocity_nees}}"), "velocity_nees is a mean over a phase; give during"),
        (RATIO.replace("a / b", "a / c"), "value: 'a / c' and the terms do not have the same names (b, c)"),
        (RATIO.replace("a / b", "a ** b"), "should be made of terms, numbers, + - * /"),
        (RATIO.replace("at_most: 2, ", ""), "there is no bound; give at_least, at_most, of_runs, or the probability of a NEES"),
        (RATIO.replace("at_most: 2", "at_most: 2, at_least: 3"), "at_least 3 is above at_most 2"),
        (RATIO.replace("at_most: 2", "probability: 0.99"), "probability is the bound of a single NEES"),
        (RATIO.replace("at_most: 2", "at_most: 2, unit: m"), "'1 m' has the wrong unit; expected speed"),
        (RATIO.replace("3d}}", "3d, statistic: lincov}}"), "statistic lincov is a column of every statement; leave it out"),
        (RATIO.replace("at_most: 2", "at_most: 2, of_runs: 0.95"), "of_runs sets both bounds; leave out at_least, at_most"),
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
        "    figures: [{plot: envelope, case: {imu: pur}}, {plot: bound, statement: one}]\n    kml: {gate: '7'}\n",
    )
    with pytest.raises(InputError) as caught:
        load_study(study.folder)
    records = {record.path: record for record in caught.value.records}
    figures = ["campaigns.0.figures.0.case", "campaigns.0.figures.1.statement"]
    assert sorted(records) == [*figures, "campaigns.0.kml", "campaigns.0.paired"]
    assert all(record.file == "study.yaml" and record.line for record in records.values())
