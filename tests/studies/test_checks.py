# ruff: noqa: E501 - a message stands in one line, as the user sees it
"""What a statement names is there: cases, axes, levels, axes of a frame; its unit is one of its metric."""

from __future__ import annotations

import pytest

from lvnav_studies.checks import faults, faults_in_flight
from lvnav_studies.claims import Claims
from lvnav_trade.api.input import read_input
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError, refuse_all

AXES = "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, values: [4, 5]}\n"
ORDER = (
    "orderings:\n  - {source: x, metric: velocity_error_3d, cases: [{imu: good, gate: '4'}, {imu: poor, gate: '4'}]}\n"
)
WHITE = "innovations:\n  - {source: x, case: {imu: good}}\n"
RATIO = (
    "statements:\n  - {source: x, id: one, value: a / b, at_most: 2, along: gate, case: {gate: '4'}, terms: {"
    "a: {case: {imu: good}, metric: velocity_error_3d}, b: {case: {imu: poor}, metric: velocity_error_3d}}}\n"
)


def read(study, text: str):
    study.append(AXES)
    file = read_input(study.write("statements.yaml", text), Claims)
    refuse_all([file.mistake(path, message) for path, message in faults(file.content, load(study.path))])
    return file.content


def test_statements_on_cases_that_are_there_are_read(study) -> None:
    found = read(study, ORDER + WHITE + RATIO)
    assert [*map(len, (found.orderings, found.innovations, found.statements))] == [1, 1, 1]
    assert found.statements[0].case_of("b") == {"gate": "4", "imu": "poor"}
    assert list(faults_in_flight(found, {"a": {"injection": 1.0}})) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ORDER.replace("imu: poor", "imu: pear"), "orderings.0.cases.1: no level 'pear' of the axis imu"),
        (ORDER.replace("poor, gate: '4'}]", "poor}]"), "orderings.0.cases.1: 2 cases have these levels; name one"),
        (WHITE.replace("good", "goood"), "innovations.0.case: no level 'goood'"),
        (RATIO.replace("imu: good", "imu: goood"), "statements.0.terms.a.case: no level 'goood' of the axis imu"),
        (RATIO.replace(", case: {gate: '4'}", "").replace("imu: good}", "imu: good, gate: '4'}"),
         "statements.0.terms.b.case: 2 cases have these levels; name one"),
        (RATIO.replace("along: gate", "along: gates"), "statements.0.along: no axis 'gates' (did you mean 'gate'?)"),
        (RATIO.replace("3d}}", "3d, minus: {imu: pur}}}"), "statements.0.terms.b.minus: no level 'pur' of the axis imu"),
        (RATIO.replace("3d}}", "3d, minus: {}, statistic: worst, during: flight}}"), "minus needs an error at an event"),
        (RATIO.replace("3d}}", "3d, over: gaet}}"), "statements.0.terms.b.over: no axis 'gaet' (did you mean 'gate'?)"),
        (RATIO.replace("3d}}", "3d, elevation: [1 deg, 2 deg]}}"), "they need a metric of signals (troposphere,"),
        (RATIO.replace("3d}}", "3d, elements: osculating}}"), "need the error of an element of the orbit (semi_major"),
        (RATIO.replace("velocity_error_3d}}", "perigee_error, reference_epoch: 0 s}}"), "is the epoch of the estimated elements"),
        (RATIO.replace("velocity_error_3d}}", "perigee_error, epoch: 60}}"), "terms.b.epoch"),
        (RATIO + RATIO.partition("\n")[2], "statements.1.id: 'one' is used twice"),
        (RATIO.replace("velocity_error_3d}}", "velocity_error_x}}"), "statements.0.terms.b.metric: 'velocity_error_x': no such axis"),
        (RATIO.replace("velocity_error_3d}}", "velocity_nees}}"), "velocity_nees is a mean over a phase; give during"),
        (RATIO.replace("a / b", "a / c"), "value: 'a / c' and the terms do not have the same names (b, c)"),
        (RATIO.replace("a / b", "'abs(a, b)'"), "statements.0.value: should call abs with one value, as in abs(a)"),
        (RATIO.replace("a / b", "sqrt - a + b"), "statements.0.value: should call sqrt with one value, as in sqrt(a)"),
        (RATIO.replace("a / b", f"a + b + {'9' * 400}"), "statements.0.value: should have numbers below 1e308, not '999"),
        (RATIO.replace("a / b", "a ** b"), "should be made of terms, numbers, + - * /"),
        (RATIO.replace("at_most: 2, ", ""), "there is no bound; give at_least, at_most, of_runs, or the probability of a NEES"),
        (RATIO.replace("at_most: 2", "at_most: 2, at_least: 3"), "at_least 3 is above at_most 2"),
        (RATIO.replace("at_most: 2", "probability: 0.99"), "probability is the bound of a single NEES"),
        (RATIO.replace("at_most: 2", "at_most: 2, unit: m"), "'1 m' has the wrong unit; expected speed"),
        (RATIO.replace("3d}}", "3d, statistic: lincov}}"), "statistic lincov is a column of every statement; leave it out"),
        (RATIO.replace("at_most: 2", "at_most: 2, of_runs: 0.95"), "of_runs sets both bounds; leave out at_least, at_most"),
        (ORDER.replace("cases:", "pool: imu, cases:"), "orderings.0.pool: imu is pooled, and the case names one of its levels; choose one"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_reported_at_its_place(study, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(study, text)
    assert message in str(caught.value)
    assert "statements.yaml:" in str(caught.value)
