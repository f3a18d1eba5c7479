"""Picking series, events, instants and phases."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.results.evaluate import errors_at
from lvnav_trade.results.evaluation.rms import rms
from lvnav_trade.results.statistics.select import (
    cache_result,
    cases_of,
    final_event,
    instant,
    phase,
    phases,
    time_mean,
    with_display_units,
)
from lvnav_trade.results.tables.read import load


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("velocity_error_3d", ("velocity", "3d")),
        ("position_error_north", ("position", "north")),
        ("gyro_bias_error", ("gyro_bias", "3d")),
    ],
)
def test_a_metrics_name_is_taken_apart(name, parts):
    assert split_metric(name) == parts


def test_phases_lie_between_consecutive_events(good):
    found = phases(good, "aaaaaaaaaaaa")
    assert [name for name, _, _ in found] == [
        "flight", "start to liftoff", "liftoff to stage1_cutoff", "stage1_cutoff to injection", "liftoff",
        "stage1_cutoff", "injection",
    ]  # fmt: skip
    assert found[0] == ("flight", 0.0, 99.5)


def test_injection_is_the_final_event(good):
    assert final_event(good, "bbbbbbbbbbbb") == "injection"


def test_the_errors_of_runs_are_sizes_in_si_and_a_failed_run_is_infinite(good):
    found = errors_at(good, "aaaaaaaaaaaa", "injection", "velocity_error_north")
    runs = good.runs[(good.runs.case == "aaaaaaaaaaaa") & (good.runs.event == "injection")]
    expected = runs.velocity_north_error_m_per_s.abs().to_numpy().copy()
    expected[3] = np.inf  # run 3 fails
    np.testing.assert_array_equal(found.magnitude, expected)
    assert found[1:] == ("m/s", "m/s", 1.0)


def test_an_error_that_the_results_do_not_hold_is_none(good):
    assert errors_at(good, "aaaaaaaaaaaa", "injection", "gyro_bias_error_x") is None


CASE = "aaaaaaaaaaaa"


@pytest.mark.parametrize(
    ("text", "t"),
    [("liftoff", 0.0), ("stage1_cutoff + 20 s", 60.0), ("injection - 0.5 min", 69.5), ("start", -5.0), ("end", 99.5)],
)
def test_an_instant_counts_from_an_event(good, text, t):
    assert instant(good, CASE, text) == pytest.approx(t)


def test_what_the_flight_does_not_have_is_no_number(good):
    assert np.isnan(instant(good, CASE, "touchdown"))
    assert np.isnan(phase(good, CASE, "liftoff to touchdown")[1])


def test_a_phase_has_two_ends_and_the_flight_begins_at_lift_off(good):
    assert phase(good, CASE, "liftoff to stage1_cutoff + 30 s") == (0.0, 70.0)
    assert phase(good, CASE, "flight") == (0.0, 99.5)


def test_the_mean_over_time_gives_uneven_steps_their_weight():
    assert time_mean(np.array([0.0, 1.0, 10.0]), np.array([2.0, 2.0, 2.0])) == 2.0
    assert time_mean(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.0, 3.0])) == pytest.approx(1.0)
    assert time_mean(np.array([4.0]), np.array([7.0])) == 7.0


def counted():
    calls = []

    @cache_result
    def metric(results, case="all"):
        calls.append(case)
        return pd.DataFrame({"case": [case]})

    return metric, calls


def test_tables_are_asked_once_for_each_question_and_tables_read_again_anew(good):
    metric, calls = counted()
    tables = load(good.folder)
    for case in ("all", "a", "a", "all"):
        assert metric(tables, case).case.tolist() == [case]
    assert calls == ["all", "a"]
    metric(load(good.folder), "a")
    assert calls == ["all", "a", "a"]


def test_a_caller_that_changes_its_frame_changes_nobody_elses(good):
    metric, _ = counted()
    tables = load(good.folder)
    frame = metric(tables)
    frame["case"] = "other"
    assert metric(tables).case.tolist() == ["all"]


def test_units_for_people_may_be_others_and_the_numbers_follow(good):
    other = with_display_units(good, {"attitude": "deg", "gyro_scale_factor": "%"})
    assert other.display_units["attitude", "3d"] == ("deg", pytest.approx(np.degrees(1.0)))
    assert other.display_units["velocity", "3d"] == good.display_units["velocity", "3d"]
    assert good.display_units["attitude", "3d"][0] == "mrad"
    both = [rms(one).set_index(["case", "phase_or_event", "metric", "axis"]) for one in (good, other)]
    key = (good.labels["aaaaaaaaaaaa"], "injection", "attitude_error", "3d")
    assert both[1].rms[key] == pytest.approx(np.degrees(1e-3 * both[0].rms[key]))
    assert both[1].unit[key] == "deg"
    assert with_display_units(good, {}) is good


def test_cases_are_found_by_the_levels_of_their_axes(good):
    assert cases_of(good, {"imu": "coarse"}) == ["bbbbbbbbbbbb"]
    assert len(cases_of(good, {})) == 2
    assert cases_of(good, {"imu": "none"}) == []
