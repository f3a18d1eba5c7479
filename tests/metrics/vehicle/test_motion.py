"""Rate and acceleration in figures: how much better, as modelled or not, with the interval of so many runs."""

from __future__ import annotations

import pytest
from scipy.stats import chi2

from lvnav_trade.metrics.vehicle.motion import motion
from tests.vehicle_tables import FILTERED, RAW, RUNS, SIGMA, tables


def test_improvement_and_verdict_are_those_of_the_histories():
    found = motion(tables())
    row = found[(found.phase == "liftoff to stage1_cutoff") & (found.axis == "roll")].iloc[0]
    assert row.better_percent == pytest.approx(100.0 * (1.0 - FILTERED / RAW))
    assert row.formal_better_percent == pytest.approx(100.0 * (1.0 - SIGMA / RAW))
    assert row.over_sigma_ratio == pytest.approx(FILTERED / SIGMA)
    low = FILTERED / SIGMA / (chi2.ppf(0.975, RUNS) / RUNS) ** 0.5
    assert row.low == pytest.approx(low)
    assert row.as_modelled == ("as modelled" if row.low <= 1.0 <= row.high else "smaller")
    assert row.unit == "deg/h"
    assert row.raw == pytest.approx(RAW * 206264.8)


def test_phases_axes_and_cases_are_all_there():
    found = motion(tables())
    assert len(found) == 2 * 2 * 6
    assert set(found.metric) == {"rate_error", "acceleration_error"}
