"""Picking series, events and phases."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.basics.select import errors_at, final_event, phases, split_metric


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
    assert [phase.name for phase in found] == [
        "flight", "start to liftoff", "liftoff to stage1_cutoff", "stage1_cutoff to injection", "liftoff",
        "stage1_cutoff", "injection",
    ]  # fmt: skip
    assert (found[0].start, found[0].end) == (0.0, 99.5)


def test_injection_is_the_final_event(good):
    assert final_event(good, "bbbbbbbbbbbb") == "injection"


def test_the_errors_of_runs_are_sizes_in_si_and_a_failed_run_is_infinite(good):
    found = errors_at(good, "aaaaaaaaaaaa", "injection", "velocity_error_north")
    runs = good.runs[(good.runs.case == "aaaaaaaaaaaa") & (good.runs.event == "injection")]
    expected = runs.velocity_north_error_m_per_s.abs().to_numpy().copy()
    expected[3] = np.inf  # run 3 fails
    np.testing.assert_array_equal(found.size, expected)
    assert found[1:] == ("m/s", "m/s", 1.0)


def test_an_error_that_the_results_do_not_hold_is_none(good):
    assert errors_at(good, "aaaaaaaaaaaa", "injection", "gyro_bias_error_x") is None
