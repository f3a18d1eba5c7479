"""Picking series, events and phases."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics.select import final_event, phases, split_metric


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
