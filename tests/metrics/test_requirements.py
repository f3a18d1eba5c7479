"""Verdicts follow the exact bounds; failed runs fail."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.requirements import judge


@pytest.mark.parametrize(
    ("runs", "failures", "verdict", "more"),
    [
        (45, 0, "met", 0), (44, 0, "undecided", 1), (45, 1, "undecided", 32), (100, 20, "violated", 0),
        (0, 0, "undecided", 45), (3, 3, "violated", 0),
    ],
)  # fmt: skip
def test_verdicts_follow_the_bounds(runs, failures, verdict, more):
    assert judge(runs, failures, 0.95, 0.9) == (verdict, more)


def test_requirements_have_the_columns_that_users_rely_on(good):
    assert list(METRICS["requirements"](good).columns) == [
        "requirement", "case", "verdict", "estimate", "limit", "probability", "confidence", "runs", "failures",
        "runs_to_decide",
    ]  # fmt: skip


def test_requirements_are_judged_on_the_runs_and_failed_runs_fail(good):
    found = METRICS["requirements"](good).set_index(["requirement", "case"])
    assert found.loc[("loose bound", "imu=fine"), "verdict"] == "met"
    assert found.loc[("loose bound", "imu=fine"), "failures"] == 1
    assert found.loc[("tight bound", "imu=coarse"), "verdict"] == "violated"
    rare = found.loc[("rare", "imu=fine")]
    assert (rare.verdict, rare.failures, rare.runs_to_decide) == ("undecided", 1, 1440 - 200)
    assert rare.limit == "1000 mrad"


def test_without_runs_a_requirement_is_undecided(alone):
    found = METRICS["requirements"](alone)
    assert set(found.verdict) == {"undecided"}
    assert list(found.runs_to_decide)[-1] == 852
