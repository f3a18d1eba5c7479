"""Rate and acceleration by phase, and reductions of nozzle movement by paired runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.results.evaluation.motion_estimates import (
    motion_statistics,
    nozzle_travel,
    rate_and_acceleration,
    rate_filter_benefit,
    reduction,
)
from tests.vehicle_tables import FILTERED, LESS, RAW, RUNS, SIGMA, tables


def test_improvement_and_verdict_are_those_of_the_histories():
    found = rate_and_acceleration(tables())
    row = found[(found.phase == "liftoff to stage1_cutoff") & (found.axis == "roll")].iloc[0]
    assert row.reduction_percent == pytest.approx(100.0 * (1.0 - FILTERED / RAW))
    assert row.formal_reduction_percent == pytest.approx(100.0 * (1.0 - SIGMA / RAW))
    assert row.over_sigma_ratio == pytest.approx(FILTERED / SIGMA)
    low = FILTERED / SIGMA / (chi2.ppf(0.975, RUNS) / RUNS) ** 0.5
    assert row.low == pytest.approx(low)
    assert row.verdict == ("as modelled" if row.low <= 1.0 <= row.high else "smaller")
    assert row.unit == "deg/h"
    assert row.raw == pytest.approx(RAW * 206264.8)


def test_phases_axes_and_cases_are_all_there():
    found = rate_and_acceleration(tables())
    assert len(found) == 2 * 2 * 6
    assert set(found.metric) == {"rate_error", "acceleration_error"}


def test_what_differs_from_run_to_run_alike_cancels():
    base = np.array([[1.0, 10.0], [5.0, 20.0], [25.0, 40.0]])
    found = reduction(base, base * [0.3, 0.5])
    for value in found:
        np.testing.assert_allclose(value, [0.7, 0.5], rtol=1e-12)


def test_the_interval_covers_the_truth_as_often_as_it_says():
    rng = np.random.Generator(np.random.PCG64(2))
    n = 2000
    covered = 0
    for _ in range(n):
        wind = np.exp(rng.normal(0.0, 1.0, (20, 1)))
        _, low, high = reduction(wind, 0.4 * wind * np.exp(rng.normal(0.0, 0.1, (20, 1))))
        covered += int(low[0] <= 0.6 <= high[0])
    # exact for logarithms that are normal: 95 % within 3 standard deviations of a count
    assert covered / n == pytest.approx(0.95, abs=3.0 * np.sqrt(0.95 * 0.05 / n))


def test_one_run_or_runs_without_a_partner_are_refused():
    for base, lower in ((1, 1), (3, 2)):
        with pytest.raises(ValueError, match="two or more of each"):
            reduction(np.ones((base, 2)), np.ones((lower, 2)))


def test_movement_of_all_runs_is_reduced_burn_by_burn():
    found = nozzle_travel(tables())
    pitch = found[(found.axis == "pitch") & (found.burn == "flight")].iloc[0]
    assert pitch.runs == RUNS
    assert pitch.reduction_percent == pytest.approx(100.0 * LESS)
    assert (pitch.low_percent, pitch.high_percent) == pytest.approx((100.0 * LESS, 100.0 * LESS))  # every run alike
    assert pitch.raw_deg == pytest.approx(np.degrees(1.95))
    assert set(found.burn) == {"flight", "burn 1"}


def test_the_motion_in_envelopes_is_in_percent_and_units_for_people():
    row = motion_statistics(tables()).iloc[0]
    assert row.angular_acceleration_inside_percent == pytest.approx(99.0)
    assert row.rate_error_deg_per_h == pytest.approx(20.6264806)


def test_what_the_filtered_rate_is_worth_stands_beside_the_most_there_is_to_gain():
    row = rate_filter_benefit(tables()).set_index("axis").loc["yaw"].iloc[0]
    assert row.reduction_percent == pytest.approx(50.0 * LESS)
    assert row.possible_percent == pytest.approx(90.0)  # the true rate moves the nozzle by a tenth
    assert row.true_error_mrad == pytest.approx(1.0)
