"""Errors by phase and event against whole-sample values, and their order."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.rms import control_variates, controlled_rms, paired_levels
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.synthetic import covariance

N_RUN = 200
M, N = 12, 120
TRUTH = np.random.default_rng(0).standard_normal((M, 3)) * np.linspace(2.0, 0.1, M)[:, None]


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
    assert row.formal_sigma == pytest.approx(np.linalg.norm(covariance().formal_sigma[-1, 3:6]), rel=1e-12)
    assert row.lincov_true_sigma == pytest.approx(np.hypot(row.formal_sigma, 0.05 * 1.995), rel=1e-12)


def test_angles_are_reported_in_the_units_of_people(good):
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


def test_the_better_case_ranks_first(good):
    found = METRICS["ranking"](good)
    assert list(found.case) == ["imu=fine", "imu=coarse"]
    assert (found.velocity_low < found.velocity).all()


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("coverage"), n_run=N_RUN))


def test_the_difference_is_that_of_the_errors_run_by_run(tables):
    frame = paired_levels(tables, "imu")
    assert set(frame.quantity) == {"attitude", "velocity", "position"}
    assert set(frame.levels) == {"fine and coarse"}
    row = frame[(frame.quantity == "velocity")].iloc[-1]
    runs, columns = tables.runs[tables.runs.event == row.event], []
    columns = [name for name in runs.columns if name.startswith("velocity_") and "_error_" in name and "3d" not in name]
    first, second = (runs[runs.case == case].sort_values("run_number")[columns].to_numpy() for case in tables.labels)
    factor = tables.display_units["velocity", "3d"][1]
    assert row.difference_rms == pytest.approx(factor * np.sqrt(np.mean(np.sum((second - first) ** 2, axis=1))))
    assert row.difference_ratio == pytest.approx(row.difference_rms / min(row.first_rms, row.second_rms))


def test_an_axis_that_no_case_has_gives_no_rows(tables):
    assert paired_levels(tables, "filter").empty


def flights(rng, bend=0.0, noise=0.5, n=N):
    """Return errors that follow the draws linearly, bent by a square, with noise; and the draws."""
    draws = rng.standard_normal((n, M))
    error = draws @ TRUTH + noise * rng.standard_normal((n, 3))
    return error + bend * (draws[:, :3] ** 2), draws


def mean_square(bend=0.0, noise=0.5):
    """Return E |error|^2 in closed form: E u^4 = 3, E u^3 = 0."""
    return float((TRUTH**2).sum() + 3 * noise**2 + 9.0 * bend**2)


@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_the_mean_square_is_unbiased_whether_or_not_the_error_is_linear(bend):
    rng = np.random.default_rng(1)
    trials = 1500
    found = np.array([controlled_rms(*flights(rng, bend)).rms ** 2 for _ in range(trials)])
    assert abs(found.mean() - mean_square(bend)) < 3.5 * found.std() / np.sqrt(trials)
    assert found.std() / np.sqrt(trials) < 0.005 * mean_square(bend)


def test_fitting_on_the_same_runs_would_be_biased():
    """The reason for folds: a slope that knows its own draws takes off part of the noise."""
    rng = np.random.default_rng(2)
    found = []
    for _ in range(1000):
        error, draws = flights(rng, noise=5.0, n=40)
        slope = np.linalg.lstsq(draws, error, rcond=None)[0]
        control = ((draws @ slope) ** 2).sum(axis=1) - (slope**2).sum()
        found.append((error**2).sum(axis=1).mean() - control.mean())
    found = np.array(found)
    assert abs(found.mean() - mean_square(noise=5.0)) > 5.0 * found.std() / np.sqrt(len(found))


@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_the_interval_holds_as_often_as_it_says(bend):
    rng = np.random.default_rng(3)
    trials = 1500
    truth = np.sqrt(mean_square(bend))
    inside = [(one := controlled_rms(*flights(rng, bend))).low <= truth <= one.high for _ in range(trials)]
    assert 0.92 < np.mean(inside) < 0.975  # 95 %; the standard deviation of 1500 trials is 0.6 %


def test_effective_runs_are_those_by_which_the_variance_falls():
    rng = np.random.default_rng(4)
    pairs = [flights(rng) for _ in range(1500)]
    plain = np.var([(error**2).sum(axis=1).mean() for error, _ in pairs])
    reduced = [controlled_rms(*pair) for pair in pairs]
    gain = plain / np.var([one.rms**2 for one in reduced])
    assert gain > 5.0
    assert np.median([one.effective_runs for one in reduced]) / N == pytest.approx(gain, rel=0.2)


def test_draws_that_explain_nothing_cost_little():
    rng = np.random.default_rng(5)
    found = [controlled_rms(rng.standard_normal((N, 3)), rng.standard_normal((N, M))) for _ in range(300)]
    assert np.mean([one.effective_runs for one in found]) > 0.9 * N
    assert np.mean([one.explained_share for one in found]) < 0.15


def test_results_give_the_plain_and_the_controlled_error_side_by_side(good):
    found = control_variates(good).set_index(["case", "metric"])
    row = found.loc[("imu=fine", "velocity_error_3d")]
    assert (row.runs, row.unit, row.event) == (199, "m/s", "injection")
    assert row.controlled_low < row.controlled_rms < row.controlled_high
    assert row.controlled_high - row.controlled_low < 0.7 * (row.high - row.low)
    assert row.controlled_low < row.lincov < row.controlled_high
    assert row.effective_runs > 2 * row.runs
    assert 0.7 < row.known_share_ratio < 1.0


def test_without_runs_there_is_nothing_to_control(alone):
    assert control_variates(alone).empty
