"""Errors of states, against the runs themselves."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate, evaluate_single
from lvnav_trade.results.metric import NOT_IN_FLIGHT
from lvnav_trade.results.registry import find
from tests import synthetic

CASE, FAILED = "aaaaaaaaaaaa", 3
PHASE = "liftoff to injection"


@pytest.fixture(scope="module")
def drawn():
    """Errors (n_run, n_hist, n_out) of the good runs of the first case, and the times."""
    block = synthetic.block(synthetic.covariance(1.0), 0, 200)
    return np.delete(block.err, FAILED, axis=0), block.t


def test_a_phase_is_the_mean_over_runs_and_time(good, drawn):
    err, t = drawn
    within = (t >= 0.0) & (t <= 99.5)
    square = (err[:, within, 3] ** 2).mean(axis=0)
    begun = t[within] < 50.0  # until then the run that fails counts too
    sound = synthetic.block(synthetic.covariance(1.0), FAILED, 1).err[0, within, 3] ** 2
    square[begun] = ((199 * square + sound) / 200)[begun]
    area = (0.5 * (square[1:] + square[:-1]) * np.diff(t[within])).sum() / 99.5
    found = evaluate_single(good, CASE, {"metric": "velocity_error_north", "during": PHASE}, "cm/s")
    assert found.value == pytest.approx(100 * np.sqrt(area), rel=1e-9)
    assert len(found.runs) == 200  # each by itself, a failed one infinite
    assert np.isinf(found.runs[-1])
    own = np.sqrt(np.trapezoid(err[:, within, 3] ** 2, t[within], axis=1) / 99.5)
    np.testing.assert_allclose(np.sort(found.runs)[:-1], np.sort(100 * own), rtol=1e-9)


def test_the_worst_is_the_median_over_runs_of_each_runs_largest(good, drawn):
    err, t = drawn
    within = (t >= 0.0) & (t <= 99.5)
    largest = np.append(np.sqrt((err[:, within, 6:9] ** 2).sum(axis=2)).max(axis=1), np.inf)
    found = evaluate_single(good, CASE, {"metric": "position_error_3d", "during": PHASE, "statistic": "worst"}, "m")
    assert found.value == pytest.approx(np.median(largest), rel=1e-12)


def test_a_mean_has_its_sign_and_is_over_runs_and_time(good, drawn):
    err, t = drawn
    within = (t >= 50.0) & (t <= 60.0)  # after the run that fails
    stated = {"metric": "velocity_error_north", "statistic": "mean"}
    during = stated | {"during": "stage1_cutoff + 10 s to stage1_cutoff + 20 s"}
    expected = np.trapezoid(err[:, within, 3].mean(axis=0), t[within]) / 10.0
    found = evaluate(good, CASE, during, "cm/s")
    assert found.monte_carlo == pytest.approx(100 * expected, rel=1e-9)
    assert found.true == pytest.approx(0.0, abs=1e-12)  # linear covariance of what is drawn without a mean
    assert np.isnan(found.formal)
    assert not len(found.runs)
    assert evaluate_single(good, CASE, during, "cm/s").value == pytest.approx(100 * expected, rel=1e-9)
    at_end = evaluate(good, CASE, stated | {"at": "injection"}, "m/s")
    assert at_end.monte_carlo == pytest.approx(err[:, np.searchsorted(t, 99.5), 3].mean(), rel=1e-9)
    assert at_end.runs[np.isfinite(at_end.runs)].mean() == pytest.approx(at_end.monte_carlo, rel=1e-9)
    assert np.isinf(at_end.runs).sum() == 1


def test_a_window_that_begins_after_an_event_is_read_off_the_history(good, drawn):
    err, t = drawn
    within = (t >= 50.0) & (t <= 60.0)
    square = (err[:, within, 8] ** 2).mean(axis=0)
    stated = {"metric": "position_error_down", "during": "stage1_cutoff + 10 s to stage1_cutoff + 20 s"}
    found = evaluate_single(good, CASE, stated, "m")
    assert found.value == pytest.approx(np.sqrt(np.trapezoid(square, t[within]) / 10.0), rel=1e-9)
    assert not len(found.runs)
    assert np.isnan(evaluate_single(good, CASE, stated | {"statistic": "worst"}, "m").value)


def test_sigmas_of_the_filter_and_of_linear_covariance_are_those_of_the_gaussians(good, alone):
    stated = {"metric": "velocity_error_down", "at": "injection"}
    sigma = 0.2 * 1.995
    for results in (good, alone):
        for statistic in ("formal", "lincov"):
            found = evaluate_single(results, CASE, stated | {"statistic": statistic}, "m/s")
            assert found.value == pytest.approx(sigma, rel=1e-9)
    assert evaluate_single(alone, CASE, stated, "m/s").remark == "linear covariance"


def test_an_attitude_beyond_five_degrees_has_no_linear_covariance_beside_it(good):
    stated = {"metric": "attitude_error_roll", "at": "injection", "statistic": "lincov", "value": 48.8}
    found = evaluate_single(good, CASE, stated, "deg")
    assert np.isnan(found.value)
    assert found.remark == "not applicable: an attitude error of 49 deg (one sigma) is beyond the linear form (5 deg)"
    assert evaluate_single(good, CASE, stated | {"value": 4.9}, "deg").value > 0.0
    assert evaluate_single(good, CASE, stated | {"statistic": "formal"}, "deg").value > 0.0


@pytest.mark.parametrize(
    ("stated", "unit", "why"),
    [
        ({"metric": "gyro_bias_error_x"}, "deg/h", "not among our results"),
        ({"metric": "velocity_error_3d"}, "m", "unit m does not fit"),
        ({"metric": "velocity_error_3d", "at": "touchdown"}, "m/s", "not in our flight"),
    ],
)
def test_what_these_results_lack_is_said(good, stated, unit, why):
    found = evaluate_single(good, CASE, stated, unit)
    assert np.isnan(found.value)
    assert found.remark == why


def test_a_mean_of_a_quantity_that_is_not_there_says_so(good):
    found = evaluate(good, CASE, {"metric": "gyro_bias_error_x", "statistic": "mean"}, "-")
    assert found.remark == "not among our results"
    assert evaluate(good, CASE, {"metric": "velocity_error_x", "at": "touchdown"}, "-").remark != NOT_IN_FLIGHT


def test_every_axis_of_a_known_quantity_is_found_and_no_other_name():
    found = find("gyro_bias_error_y")
    assert (found.quantity, found.axis, found.unit, found.is_signed) == ("gyro_bias", "y", "rad/s", True)
    assert not find("velocity_error_3d").is_signed
    assert find("gyro_biass_error_y") is None
    assert find("velocity error x") is None
