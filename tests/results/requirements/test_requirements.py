"""Verdicts follow the exact bounds; failed runs fail."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.requirements import (
    boundaries,
    decide,
    decide_fixed,
    error_spending,
    errors_of,
    further_runs,
    unselected_cases,
    with_unit,
)
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import is_demonstrated, runs_needed
from tests import synthetic

ASKED = [(0.9, 0.9), (0.95, 0.9), (0.99, 0.95), (0.9973, 0.9)]
LOOKS = 100


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
        "requirement", "case", "verdict", "estimate", "limit", "unit", "probability", "confidence", "runs",
        "failures", "runs_to_decide", "by",
    ]  # fmt: skip


def test_requirements_are_checked_on_the_runs_and_failed_runs_fail(good):
    found = METRICS["requirements"](good).set_index(["requirement", "case"])
    assert found.loc[("loose bound", "imu=fine"), "verdict"] == "met"
    assert found.loc[("loose bound", "imu=fine"), "failures"] == 1
    assert found.loc[("tight bound", "imu=coarse"), "verdict"] == "violated"
    rare = found.loc[("rare", "imu=fine")]
    assert (rare.verdict, rare.failures, rare.runs_to_decide) == ("undecided", 1, 1440 - 200)
    assert (rare.limit, rare.unit) == (1000.0, "mrad")


def test_without_runs_the_verdict_is_that_of_linear_covariance_and_says_so(alone):
    found = METRICS["requirements"](alone).set_index(["requirement", "case"])
    expected = METRICS["expected_verdicts"](alone).set_index(["requirement", "case"])
    assert set(found.by) == {"LinCov"}
    assert {"met", "violated"} == set(found.verdict)
    assert found[["verdict", "estimate", "limit", "unit"]].equals(expected[["verdict", "estimate", "limit", "unit"]])
    assert list(found.runs_to_decide)[-1] == 852  # that would demonstrate it


def test_what_a_campaign_does_not_select_is_decided_by_linear_covariance_where_its_runs_are_too_few(good):
    chosen = good.with_frames()
    card = {**good.campaign["monte_carlo"], "selected": {"imu": "coarse"}}
    chosen.__dict__["campaign"] = {**good.campaign, "monte_carlo": card}
    before, after = (METRICS["requirements"](one).set_index(["requirement", "case"]) for one in (good, chosen))
    assert unselected_cases(chosen) == ["imu=fine"]
    assert unselected_cases(good) == []
    rare = after.loc[("rare", "imu=fine")]
    assert (rare.verdict, rare.by) == ("met", "LinCov")
    margins = METRICS["margins"](chosen).set_index(["requirement", "case"])
    assert margins.loc[("rare", "imu=fine"), ["verdict", "by"]].tolist() == ["met", "LinCov"]
    others = [key for key in after.index if key != ("rare", "imu=fine")]
    assert after.loc[others].equals(before.loc[others])
    assert before.loc[("rare", "imu=fine"), "verdict"] == "undecided"


PHASE = {"name": "x", "metric": "velocity_error_3d", "probability": 0.9, "below": "2 m/s"}


@pytest.mark.parametrize(
    ("during", "first", "last"),
    [
        ("liftoff to stage1_cutoff", 0.0, 40.0), ("stage1_cutoff to injection", 40.0, 99.5), ("flight", 0.0, 99.5),
        ("start to liftoff", -5.0, 0.0), ("start to end", -5.0, 99.5),
    ],
)  # fmt: skip
def test_a_phase_is_checked_on_the_largest_error_of_each_run_within(good, during, first, last):
    assert CaseTables(good, "aaaaaaaaaaaa").phase(during) == (first, last)
    cov = synthetic.covariance()
    runs = synthetic.block(cov, 0, 200)
    within = (cov.t >= first) & (cov.t <= last)
    expected = np.linalg.norm(runs.err[:, within, 3:6], axis=2).max(axis=1)
    expected[3] = np.inf  # the run that failed
    found = errors_of(good, "aaaaaaaaaaaa", PHASE | {"during": during})
    np.testing.assert_allclose(found.magnitude, expected, rtol=1e-12)
    assert (found.unit, found.label_unit) == ("m/s", "m/s")
    assert event_or_phase(PHASE | {"during": during}) == during


def test_the_worst_of_the_flight_is_no_better_than_any_event(good):
    flight = errors_of(good, "bbbbbbbbbbbb", PHASE | {"during": "flight"}).magnitude
    for event in ("liftoff", "stage1_cutoff", "injection"):
        assert (flight >= errors_of(good, "bbbbbbbbbbbb", PHASE | {"at": event}).magnitude).all()


def test_a_phase_between_unknown_events_has_no_run(good):
    assert not len(errors_of(good, "aaaaaaaaaaaa", PHASE | {"during": "kick to injection"}).magnitude)
    assert errors_of(good, "aaaaaaaaaaaa", PHASE | {"metric": "heading_error_3d", "during": "flight"}) is None


def test_an_estimate_beyond_all_runs_is_reported_as_one():
    assert [with_unit(value, "m") for value in (0.30004, np.inf, np.nan)] == ["0.3 m", "∞ m", ""]


def histories(truth, trials, looks=LOOKS, block=40, seed=1):
    return np.cumsum(np.random.default_rng(seed).binomial(block, 1.0 - truth, (trials, looks)), axis=1)


@pytest.mark.parametrize(("probability", "confidence"), ASKED)
def test_at_the_edge_the_wrong_verdict_is_as_rare_as_asked_however_often_one_looks(probability, confidence):
    trials = 10_000
    low, high = boundaries(probability, confidence, 40, LOOKS)
    failures = histories(probability, trials)
    rare = 1.0 - confidence + 3.0 * np.sqrt(confidence * (1.0 - confidence) / trials)
    met, violated = (failures <= low).any(axis=1), (failures >= high).any(axis=1)
    assert met.mean() < rare
    assert violated.mean() < rare
    assert met.mean() > 0.7 * (1.0 - confidence)  # and little of it is left unused


@pytest.mark.parametrize(("probability", "confidence"), ASKED[:3])
def test_a_look_as_if_it_were_the_only_one_would_be_wrong_more_often(probability, confidence):
    """The reason for boundaries of their own: Clopper and Pearson after every block."""
    runs = 40 * np.arange(1, 41)
    most = stats.binom.ppf(1.0 - confidence, runs, 1.0 - probability)
    most -= stats.binom.cdf(most, runs, 1.0 - probability) > 1.0 - confidence
    assert most[9] < 0 or is_demonstrated(400, int(most[9]), probability, confidence)
    failures = histories(probability, 2000, 40)
    assert (failures <= most).any(axis=1).mean() > 1.5 * (1.0 - confidence)


def test_the_probability_of_ever_crossing_is_that_of_the_exact_recursion():
    """Three looks by enumeration of all paths of block sums."""
    probability, confidence, block = 0.8, 0.9, 8
    low, high = boundaries(probability, confidence, block, 3)
    one = stats.binom.pmf(np.arange(block + 1), block, 1.0 - probability)
    a, b, c = np.meshgrid(*[np.arange(block + 1)] * 3, indexing="ij")
    weight = one[a] * one[b] * one[c]
    sums = np.stack([a, a + b, a + b + c])
    for crossed, sign in ((low, -1), (high, 1)):
        edge = np.array(crossed)[:, None, None, None]
        ever = (sums <= edge) if sign < 0 else (sums >= edge)
        used = float(weight[ever.any(axis=0)].sum())
        assert used <= error_spending(3 * block, probability, confidence) + 1e-12
        nearer = (
            (sums <= edge + (np.arange(3) == 2)[:, None, None, None])
            if sign < 0
            else (sums >= edge - (np.arange(3) == 2)[:, None, None, None])
        )
        assert float(weight[nearer.any(axis=0)].sum()) > error_spending(3 * block, probability, confidence)


@pytest.mark.parametrize(("truth", "verdict"), [(0.999, "met"), (0.9, "violated")])
def test_what_is_clear_is_decided_early_and_rightly(truth, verdict):
    found = [decide(list(path), 0.95, 0.9, 40) for path in histories(truth, 2000, 20)]
    assert np.mean([decided == verdict for decided, _ in found]) > 0.98
    assert np.mean([runs for _, runs in found]) < 200


def test_the_price_of_looking_early_is_about_a_quarter_more_runs_where_none_fails():
    verdict, runs = decide([0] * 200, 0.9973, 0.9, 40)
    assert verdict == "met"
    assert runs_needed(0, 0.9973, 0.9) < runs < 1.3 * runs_needed(0, 0.9973, 0.9)


def test_a_verdict_does_not_depend_on_how_far_one_looks_afterwards():
    path = [0, 0, 1, 30, 60]
    assert decide(path[:3], 0.95, 0.9, 40) == decide(path, 0.95, 0.9, 40) == ("met", 80)
    before = boundaries(0.97, 0.9, 40, 10)
    boundaries(0.97, 0.9, 40, 60)
    assert boundaries(0.97, 0.9, 40, 10) == before


def test_further_runs_are_those_after_which_all_good_runs_decide():
    path = [2, 3, 4]
    more = further_runs(path, 0.95, 0.9, 40)
    assert decide([*path, *[4] * (more // 40)], 0.95, 0.9, 40) == ("met", 120 + more)
    assert decide([*path, *[4] * (more // 40 - 1)], 0.95, 0.9, 40)[0] == "undecided"
    assert further_runs([], 0.95, 0.9, 40) == decide([0] * 10, 0.95, 0.9, 40)[1]


def test_nothing_is_decided_before_the_first_look():
    assert decide([], 0.95, 0.9, 40) == ("undecided", 0)


def test_all_of_the_error_is_spent_in_the_end_and_never_more():
    used = [error_spending(n, 0.95, 0.9) for n in (0, 45, 450, 10**9)]
    assert used[0] == 0.0
    assert used[1] == pytest.approx(0.05)
    assert used == sorted(used)
    assert used[-1] == pytest.approx(0.1)
    assert used[-1] < 0.1
