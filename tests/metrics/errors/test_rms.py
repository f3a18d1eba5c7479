"""Errors by phase and event against whole-sample values, and their order."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from tests import synthetic
from tests.synthetic import covariance


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
