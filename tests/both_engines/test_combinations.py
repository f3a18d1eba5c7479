"""Measurements and policies combine: the covering design, its refusals, and cases in which both engines agree."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.scenario.rules import REFUSALS
from tests.both_engines.combinations import evaluate, false_alarms, scenario_of
from tests.both_engines.covering import DIMENSIONS, covering, kernels_of, refusal
from tests.both_engines.short_flights import flight
from tests.building import prepare_hop

FIRST = {name: next(iter(levels)) for name, levels in DIMENSIONS.items()}
SAMPLE = [
    {"measurements": "solution, attitude", "states": "unmodelled", "fault": "gyro bias step"},
    {"measurements": "ranges, altitude", "states": "considered", "vehicle": "spinning"},
    {"measurements": "pseudorange", "states": "scale factors", "vehicle": "oscillating"},
    {
        "measurements": "zero velocity and rotation, position, azimuth",
        "vehicle": "oscillating",
        "fault": "gyro bias step",
    },
    {"measurements": "attitude", "states": "neglected", "fault": "noise"},
    {"measurements": "ranges", "units": "two", "states": "scale factors", "vehicle": "spinning"},
]


def test_every_pair_of_levels_stands_in_a_case_that_runs_or_is_refused_wherever_it_stands():
    cases = covering()
    run = [case for case in cases if not refusal(case)]
    for a, b in itertools.combinations(DIMENSIONS, 2):
        for x, y in itertools.product(DIMENSIONS[a], DIMENSIONS[b]):
            if not any(case[a] == x and case[b] == y for case in run):
                assert any(case[a] == x and case[b] == y and refusal(case) for case in cases), (a, x, b, y)
    n_case, n_kernel = len(cases), len({kernels_of(case) for case in run})
    assert 40 <= n_case <= 270
    assert n_kernel <= 65  # each takes half a minute to compile


def test_what_the_table_refuses_is_what_a_scenario_refuses():
    for case in covering():
        reason = refusal(case)
        if reason:
            with pytest.raises(ValidationError) as caught:
                scenario_of(case)
            assert reason in str(caught.value)
        else:
            scenario_of(case)


def test_refusals_are_few_and_each_gives_a_reason():
    assert len(REFUSALS) <= 15
    assert len({one.reason for one in REFUSALS}) == len(REFUSALS)
    assert all(len(one.reason) > 30 and "not with" not in one.reason for one in REFUSALS)


@pytest.mark.parametrize("levels", SAMPLE, ids=lambda levels: ", ".join(levels.values()))
def test_both_engines_agree(levels):
    verdict = evaluate(FIRST | levels)
    assert verdict.agrees, verdict


def test_a_false_alarm_is_a_decision_that_linear_covariance_does_not_make():
    expected = np.array([[0.0, 20.0, 1.0, 5.0]])
    late = [3.0, 25.0, 1.0, 5.0]  # the same decision, later
    of_another_satellite = [4.0, 20.0, 1.0, 6.0]
    of_another_kind = [7.0, 45.0, 3.0, 5.0]
    decisions = np.array([late, of_another_satellite, of_another_kind, of_another_kind])
    assert false_alarms(decisions, expected) == [4, 7]
    assert false_alarms(np.zeros((0, 4)), expected) == []


@pytest.mark.parametrize("levels", [{"receiver": "point"}, {"receiver": "filtered"}, {"latency": "extrapolated"}])
def test_a_sensor_keeps_its_variance_beside_a_solution_with_a_covariance(levels):
    scenario, kind, _ = scenario_of(FIRST | {"measurements": "solution, attitude"} | levels)
    prepared_case = prepare_hop(scenario, flight(kind))
    variance = prepared_case.signals.variance[:, : prepared_case.channels.n_channel]
    assert variance.shape == (prepared_case.t_epoch.size, 9)
    assert variance[:, 6:] == pytest.approx(5e-3**2)
    assert np.all(variance[:, :6] > 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(covering())))
def test_every_case_agrees_or_is_refused(number):
    verdict = evaluate(covering()[number])
    assert verdict.refused or verdict.agrees, verdict
