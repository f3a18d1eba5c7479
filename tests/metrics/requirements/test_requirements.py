"""Verdicts follow the exact bounds; failed runs fail."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.requirements.requirements import decide_fixed, errors_of, phase_of, where, with_unit
from tests import synthetic


@pytest.mark.parametrize(
    ("runs", "failures", "verdict", "more"),
    [
        (45, 0, "met", 0), (44, 0, "undecided", 1), (45, 1, "undecided", 32), (100, 20, "violated", 0),
        (0, 0, "undecided", 45), (3, 3, "violated", 0),
    ],
)  # fmt: skip
def test_verdicts_follow_the_bounds(runs, failures, verdict, more):
    assert decide_fixed(runs, failures, 0.95, 0.9) == (verdict, more)


def test_requirements_have_the_columns_that_users_rely_on(good):
    assert list(METRICS["requirements"](good).columns) == [
        "requirement", "case", "verdict", "estimate", "limit", "probability", "confidence", "runs", "failures",
        "runs_to_decide",
    ]  # fmt: skip


def test_requirements_are_checked_on_the_runs_and_failed_runs_fail(good):
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


PHASE = {"name": "x", "metric": "velocity_error_3d", "probability": 0.9, "below": "2 m/s"}


@pytest.mark.parametrize(
    ("during", "first", "last"),
    [
        ("liftoff to stage1_cutoff", 0.0, 40.0), ("stage1_cutoff to injection", 40.0, 99.5), ("flight", 0.0, 99.5),
        ("start to liftoff", -5.0, 0.0), ("start to end", -5.0, 99.5),
    ],
)  # fmt: skip
def test_a_phase_is_checked_on_the_largest_error_of_each_run_within(good, during, first, last):
    assert phase_of(good, "aaaaaaaaaaaa", during) == (first, last)
    cov = synthetic.covariance()
    runs = synthetic.block(cov, 0, 200)
    within = (cov.t >= first) & (cov.t <= last)
    expected = np.linalg.norm(runs.err[:, within, 3:6], axis=2).max(axis=1)
    expected[3] = np.inf  # the run that failed
    found = errors_of(good, "aaaaaaaaaaaa", PHASE | {"during": during})
    np.testing.assert_allclose(found.size, expected, rtol=1e-12)
    assert (found.unit, found.label_unit) == ("m/s", "m/s")
    assert where(PHASE | {"during": during}) == during


def test_the_worst_of_the_flight_is_no_better_than_any_event(good):
    flight = errors_of(good, "bbbbbbbbbbbb", PHASE | {"during": "flight"}).size
    for event in ("liftoff", "stage1_cutoff", "injection"):
        assert (flight >= errors_of(good, "bbbbbbbbbbbb", PHASE | {"at": event}).size).all()


def test_a_phase_between_unknown_events_has_no_run(good):
    assert not len(errors_of(good, "aaaaaaaaaaaa", PHASE | {"during": "kick to injection"}).size)
    assert errors_of(good, "aaaaaaaaaaaa", PHASE | {"metric": "heading_error_3d", "during": "flight"}) is None


def test_an_estimate_beyond_all_runs_is_reported_as_one():
    assert [with_unit(value, "m") for value in (0.30004, np.inf, np.nan)] == ["0.3 m", "∞ m", ""]
