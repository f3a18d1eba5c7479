"""Nested choice, exclusion and constraints."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError
from tests.campaign.reading.test_spaced import labels, loaded

NESTED = (
    "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, values: [4, 5], when: {imu: poor}}\n"
)


def test_a_nested_axis_is_varied_where_its_condition_holds(study) -> None:
    assert labels(study, NESTED) == ["imu=good", "imu=poor, gate=4", "imu=poor, gate=5"]


def test_combinations_are_left_out_by_level_and_by_constraint(study) -> None:
    text = "axes:\n  - {path: imu, cards: [imu/good, imu/poor]}\n  - {path: filter.gate, range: [3, 6, 1]}\n"
    more = "exclude: [{imu: poor, gate: ['3', '4']}]\nconstraints: ['2 * gate < 11']\n"
    assert labels(study, text + more) == [
        "imu=good, gate=3",
        "imu=good, gate=4",
        "imu=good, gate=5",
        "imu=poor, gate=5",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("axes: [{path: filter.gate, values: [4, 5], when: {imu: good}}]", "axes.0.when: no axis 'imu'"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nexclude: [{gate: '6'}]", "no level '6' of the axis gate"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nexclude: [{gate: ['4', '5']}]", "leaves everything out"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nconstraints: [gate < 9]", "leaves nothing out"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nconstraints: [gate]", "should compare two expressions"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nconstraints: ['abs(gate, gate) < 9']",
         "constraints.0: should call abs with one value, as in abs(a)"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nconstraints: [max < gate]",
         "constraints.0: should call max with its values, as in max(a, b)"),
        (f"axes: [{{path: filter.gate, values: [4, 5]}}]\nconstraints: [gate < {'9' * 400}]",
         "constraints.0: should have numbers below 1e308"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nconstraints: [gat < 9]", "constraints.0: no axis 'gat'"),
        ("axes: [{path: imu, cards: [imu/good, imu/poor]}]\nconstraints: [imu < 9]", "the axis 'imu' has no numbers"),
        (NESTED.replace("imu: poor", "imu: [good, poor]"), "axes.1.when: no effect: every case has these levels"),
        ("axes: [{path: filter.gate, values: [4, 5]}]\nexclude: [{}]", "exclude.0: names no axis"),
    ],
)  # fmt: skip
def test_what_leaves_nothing_out_or_names_nothing_is_refused_at_its_place(study, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        loaded(study, f"{text}\n")
    assert message in str(caught.value)
    assert all(record.line > 0 for record in caught.value.records)


AXES = "axes: [{path: imu, cards: [imu/good, imu/poor]}]\n"


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("{runs: 80, selected: {imu: best}}", "monte_carlo.selected: no level 'best' of the axis imu"),
        ("{runs: 80, selected: {filter: best}}", "monte_carlo.selected: no axis 'filter'"),
        ("{runs: 80, other_runs: 8}", "other_runs has no effect: no cases are selected"),
        (
            "{runs: 80, selected: {imu: good}, other_runs: 81}",
            "other_runs: 81 are more than the 80 of the selected cases",
        ),
        ("{runs: 80, selected: {imu: good}, stop: decided}", "stop and selected both determine the number of runs"),
    ],
)
def test_a_selection_of_cases_names_some_of_them(study, card, message) -> None:
    with pytest.raises(InputError, match=message):
        load(study.append(f"{AXES}monte_carlo: {card}\n"))


def test_a_selection_of_all_cases_has_no_effect(study) -> None:
    with pytest.raises(InputError, match=r"monte_carlo\.selected: no effect: every case has these levels"):
        load(study.append("axes: [{path: imu, cards: [imu/good]}]\nmonte_carlo: {runs: 8, selected: {imu: good}}\n"))
