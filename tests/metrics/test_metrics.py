"""Metrics against closed forms, and against results drawn from known Gaussians."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from lvnav_trade.metrics import CSV, METRICS
from lvnav_trade.metrics.agreement import agreement, by_case
from lvnav_trade.metrics.consistency import nees, nis
from lvnav_trade.metrics.intervals import holm, rms_interval, runs_needed, shows, success_bounds
from lvnav_trade.metrics.requirements import judge
from lvnav_trade.store import load
from tests import synthetic
from tests.synthetic import covariance


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("good"), failing=(3,)))


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """Runs drawn 1.6 times as large as linear covariance says."""
    return load(synthetic.results(tmp_path_factory.mktemp("wrong"), n_run=80, wrong=1.6))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Linear covariance without runs."""
    return load(synthetic.results(tmp_path_factory.mktemp("alone"), n_run=0))


# --- intervals --------------------------------------------------------------------------------------------------------

RUNS_TABLE = {
    # probability: {confidence: runs for 0, 1, 2, 5 failures}; exact binomial
    0.95: {0.5: (14, 34, 54, 114), 0.9: (45, 77, 105, 184), 0.95: (59, 93, 124, 208)},
    0.99: {0.5: (69, 168, 268, 567), 0.9: (230, 388, 531, 926), 0.95: (299, 473, 628, 1049)},
    0.9973: {0.5: (257, 622, 991, 2100), 0.9: (852, 1440, 1970, 3433), 0.95: (1109, 1756, 2330, 3891)},
    0.99865: {0.5: (514, 1243, 1981, 4200), 0.9: (1705, 2880, 3941, 6868), 0.95: (2218, 3513, 4662, 7785)},
}


@pytest.mark.parametrize("probability", RUNS_TABLE)
def test_runs_needed_reproduce_the_exact_binomial_table(probability):
    for confidence, expected in RUNS_TABLE[probability].items():
        found = tuple(runs_needed(failures, probability, confidence) for failures in (0, 1, 2, 5))
        assert found == expected


def test_one_run_less_than_needed_does_not_show_it():
    assert shows(852, 0, 0.9973, 0.9)
    assert not shows(851, 0, 0.9973, 0.9)


def test_lower_bound_without_failures_is_the_root_of_the_remaining_doubt():
    """P^n = 1 - C."""
    assert success_bounds(45, 0, 0.9)[0] == pytest.approx(0.1 ** (1 / 45), rel=1e-12)


def test_bound_and_needed_runs_agree_at_every_count():
    for failures in range(4):
        for runs in range(failures + 1, 250):
            assert (success_bounds(runs, failures, 0.9)[0] >= 0.95) == shows(runs, failures, 0.95, 0.9)


@pytest.mark.parametrize(
    ("runs", "failures", "verdict", "more"),
    [
        (45, 0, "met", 0), (44, 0, "undecided", 1), (45, 1, "undecided", 32), (100, 20, "violated", 0),
        (0, 0, "undecided", 45), (3, 3, "violated", 0),
    ],
)  # fmt: skip
def test_verdicts_follow_the_bounds(runs, failures, verdict, more):
    assert judge(runs, failures, 0.95, 0.9) == (verdict, more)


def test_the_rms_interval_is_the_known_one():
    """The 95 % half-width of a sigma from 1000 runs is 4.4 %, from 100 runs about 13.9 % (a mean of both sides)."""
    for runs, half in ((100, 0.139), (1000, 0.044), (10000, 0.014)):
        low, high = rms_interval(1.0, runs)
        assert (high - low) / 2 == pytest.approx(half, rel=0.04)


def test_holm_is_the_textbook_case():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])


# --- errors -----------------------------------------------------------------------------------------------------------


def test_rms_has_the_columns_that_users_rely_on(good):
    assert list(METRICS["rms"](good).columns) == [
        "case", "phase_or_event", "metric", "axis", "unit", "rms", "low", "high", "formal_sigma", "lincov_true_sigma",
    ]  # fmt: skip


def test_rms_at_an_event_is_that_of_the_good_runs(good):
    frame = METRICS["rms"](good).set_index(["case", "phase_or_event", "metric", "axis"])
    row = frame.loc[("imu=fine", "injection", "velocity_error", "3d")]
    runs = good.runs[(good.runs.case == "aaaaaaaaaaaa") & (good.runs.event == "injection") & (good.runs.failure == "")]
    assert len(runs) == 199
    assert row.rms == pytest.approx(np.sqrt((runs.velocity_3d_error_m_per_s**2).mean()), rel=1e-12)
    assert row.low < row.rms < row.high
    assert row.formal_sigma == pytest.approx(np.linalg.norm(covariance().formal[-1, 3:6]), rel=1e-12)
    assert row.lincov_true_sigma == pytest.approx(np.hypot(row.formal_sigma, 0.05 * 1.995), rel=1e-12)


def test_angles_are_told_in_the_units_of_people(good):
    frame = METRICS["rms"](good)
    row = frame[(frame.metric == "attitude_error") & (frame.axis == "roll") & (frame.phase_or_event == "liftoff")]
    assert row.unit.iloc[0] == "mrad"
    assert row.lincov_true_sigma.iloc[0] == pytest.approx(1.0)


def test_rms_over_a_phase_is_the_time_mean_of_the_square(good):
    """Sigma grows as 1 + t / 100 from lift-off: the mean square over 0 to 40 s is 3 (1.4^3 - 1) / (3 x 0.4) ..."""
    frame = METRICS["rms"](good)
    row = frame[(frame.phase_or_event == "liftoff to stage1_cutoff") & (frame.metric == "position_error")]
    expected = 3.0 * np.sqrt((1.4**3 - 1.0) / (3 * 0.4))
    assert row[row.axis == "north"].lincov_true_sigma.iloc[0] == pytest.approx(expected, rel=1e-4)


def test_the_intervals_cover_the_truth_about_95_times_in_100(good):
    """Axis errors at three events, 10 outputs, one case: 30 intervals; 24 or fewer inside has probability 0.3 %."""
    frame = METRICS["rms"](good)
    rows = frame[(frame.case == "imu=fine") & frame.phase_or_event.isin(synthetic.EVENTS) & (frame.axis != "3d")]
    assert len(rows) == 30
    inside = (rows.low <= rows.lincov_true_sigma) & (rows.lincov_true_sigma <= rows.high)
    assert inside.sum() >= 25


# --- agreement --------------------------------------------------------------------------------------------------------


def test_agreement_has_the_columns_that_users_rely_on(good):
    assert list(agreement(good).columns) == [
        "case", "event", "state", "unit", "monte_carlo", "lincov", "ratio", "low", "high", "agree",
    ]  # fmt: skip


def test_runs_drawn_from_the_covariance_agree_with_it(good):
    rows = agreement(good)
    assert len(rows) == 2 * 3 * 9
    assert set(by_case(rows).verdict) == {"agree"}


def test_runs_drawn_too_large_disagree_and_the_worst_state_is_named(wrong):
    found = by_case(agreement(wrong))
    assert set(found.verdict) == {"disagree"}
    assert (found.outside_count == 27).all()
    assert found.ratio.iloc[0] == pytest.approx(1.6, rel=0.35)
    assert found.event.iloc[0] in synthetic.EVENTS


def test_the_bounds_are_bonferronis(good):
    """27 rows, 199 runs, no mean: sqrt(chi2.ppf(0.005 / 27, 199) / 199)."""
    row = agreement(good).iloc[0]
    assert row.low == pytest.approx(np.sqrt(stats.chi2.ppf(0.01 / 27 / 2, 199) / 199), rel=1e-12)


def test_without_runs_nothing_is_claimed(alone):
    assert set(agreement(alone).agree) == {"no runs"}
    assert set(by_case(agreement(alone)).verdict) == {"no runs"}


# --- consistency and whiteness ----------------------------------------------------------------------------------------


def test_a_matched_filter_is_inside_its_bounds(good):
    """99 epochs of ANIS in 95 % bounds: fewer than 87 inside has probability 0.1 %."""
    found = METRICS["consistency"](good).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANIS"), "inside_ratio"] >= 87 / 99
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(
        found.loc[("imu=fine", "ANEES"), "expected_ratio"], rel=0.01
    )


def test_an_optimistic_filter_is_outside_its_bounds(wrong):
    found = METRICS["consistency"](wrong).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANEES"), "inside_ratio"] == 0.0
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(1.6**2 + 0.0285, rel=0.03)


def test_bounds_of_anees_are_chi_square_with_all_runs(good):
    row = nees(good).iloc[0]
    assert row.low_ratio == pytest.approx(stats.chi2.ppf(0.025, 1990) / 1990, rel=1e-12)


def test_anis_is_bounded_by_the_rows_that_there_were(good):
    row = nis(good).iloc[0]
    assert row.row_count == 199 * 16
    assert row.high_ratio == pytest.approx(stats.chi2.ppf(0.975, 199 * 16) / (199 * 16), rel=1e-12)


def test_white_innovations_pass_and_channels_have_names(good):
    found = METRICS["whiteness"](good)
    assert found.white.all()
    assert found.channel.iloc[0] == "G01 range"
    assert found.channel.nunique() == 16


# --- requirements, references, ranking --------------------------------------------------------------------------------


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


def test_references_are_held_against_their_band_in_their_own_unit(good):
    found = METRICS["references"](good)
    assert list(found.columns) == [
        "source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band_low", "band_high", "in_band",
        "remark",
    ]  # fmt: skip
    rms = METRICS["rms"](good).set_index(["case", "phase_or_event", "metric", "axis"]).rms
    assert found.ours.iloc[0] == pytest.approx(100 * rms.loc[("imu=fine", "injection", "velocity_error", "3d")])
    assert found.in_band.tolist() == [False, False]
    assert found.case.tolist() == ["imu=fine", "imu=coarse"]


def test_references_fall_back_on_linear_covariance_and_say_so(alone):
    assert set(METRICS["references"](alone).remark) == {"drawn; linear covariance", "linear covariance"}


def test_the_better_case_ranks_first(good):
    found = METRICS["ranking"](good)
    assert list(found.case) == ["imu=fine", "imu=coarse"]
    assert (found.velocity_low < found.velocity).all()


def test_satellites_vanish_during_the_outage(good):
    found = METRICS["in_view"](good)
    assert set(found.tracked_count[found.t_s.between(60, 74.5)]) == {0}
    assert set(found.above_count) == {8}


def test_growth_over_an_outage_is_end_over_before(alone):
    found = METRICS["outages"](alone).iloc[0]
    assert found.growth_ratio == pytest.approx(1.75 / 1.60)
    assert (found.t_start_s, found.t_end_s) == (60.0, 75.0)


def test_the_budget_names_the_largest_source_first(good):
    found = METRICS["budget"](good)
    assert found.source.iloc[0] == "gyro bias"
    assert found.share_ratio.iloc[0] == pytest.approx(0.75)


@pytest.mark.parametrize("name", METRICS)
@pytest.mark.parametrize("which", ["good", "alone"])
def test_every_metric_gives_a_tidy_frame(name, which, request):
    frame = METRICS[name](request.getfixturevalue(which))
    assert isinstance(frame, pd.DataFrame)
    assert frame.columns.is_unique
    assert list(frame.index) == list(range(len(frame))) or name not in CSV
    assert "case" in frame.columns
