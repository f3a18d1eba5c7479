"""How large a contradiction within a user's file may be for an inertial unit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.contradiction import (
    PRECISION,
    Residual,
    error_growth,
    require_consistent,
    residual_limit,
)

IMU = ImuCard.model_validate(
    {
        "name": "unit",
        "source": "test",
        "gyro": {"random_walk": "0.1 deg/sqrt(h)", "bias_repeatability": "3 deg/h", "bias_instability": "4 deg/h"},
        "accel": {"random_walk": "0.2 mg/sqrt(Hz)", "bias_repeatability": "1 mg"},
    }
)


def test_growth_is_that_of_many_integrated_noises_and_biases():
    # 4000 draws, 100 s at 10 Hz: the sampling error of a sigma is 1.1 %
    rng, n, dt, steps = np.random.default_rng(3), 4000, 0.1, 1000
    walk, bias = 0.2e-3 * 9.80665, 1e-3 * 9.80665
    a = rng.normal(0.0, walk / math.sqrt(dt), (n, steps)) + rng.normal(0.0, bias, (n, 1))
    v = np.cumsum(a, axis=1) * dt
    assert np.std(v[:, -1]) == pytest.approx(error_growth(IMU, "velocity", 100.0), rel=0.04)
    assert np.std(np.sum(v, axis=1) * dt) == pytest.approx(error_growth(IMU, "position", 100.0), rel=0.04)


def test_growth_of_each_kind_is_the_closed_form():
    assert error_growth(IMU, "attitude", 3600.0) == pytest.approx(math.radians(math.hypot(0.1, 5.0)))  # after an hour
    bias, walk = 1e-3 * 9.80665, 0.2e-3 * 9.80665
    assert error_growth(IMU, "velocity", 100.0) == pytest.approx(math.hypot(100.0 * bias, 10.0 * walk))
    expected = math.hypot(5000.0 * bias, walk * math.sqrt(1e6 / 3.0))
    assert error_growth(IMU, "position", 100.0) == pytest.approx(expected)


def test_the_limit_is_a_tenth_of_the_growth_over_the_stretch_and_what_rounding_makes():
    one = Residual("position", 20.0, 120.0, 50.0, 1.0, 0.01)
    assert residual_limit(one, IMU) == pytest.approx(0.1 * error_growth(IMU, "position", 100.0) + 0.05)
    short = one._replace(end=20.5)  # a stretch of half a second counts as ten
    assert residual_limit(short, IMU) == pytest.approx(0.1 * error_growth(IMU, "position", 10.0) + 0.05)


def test_the_worst_point_beyond_its_limit_is_named_with_place_and_size():
    good = Residual("velocity", 0.0, 100.0, 30.0, 0.09, 0.0)
    allowed = residual_limit(good, IMU)
    require_consistent([good._replace(size=0.999 * allowed)], IMU, "mine.csv")
    bad = [good._replace(size=1.001 * allowed), Residual("position", 100.0, 200.0, 150.25, 60.0, 0.0)]
    with pytest.raises(InputError, match=r"mine.csv: its velocity, .* by 60 m at 150.25 s .*allowed are 4\.9"):
        require_consistent(bad, IMU, "mine.csv")
    with pytest.raises(InputError, match=r"velocity part by 0\.0982 m/s at 30 s"):
        require_consistent(bad[:1], IMU, "mine.csv")


IDEAL = ImuCard.model_validate(
    {
        "name": "ideal",
        "source": "test",
        "gyro": {"random_walk": 0, "bias_repeatability": 0},
        "accel": {"random_walk": 0, "bias_repeatability": 0},
    }
)


@pytest.mark.parametrize("what", ["position", "velocity", "attitude"])
def test_with_an_ideal_unit_rounding_is_no_contradiction(what):
    one = Residual(what, 0.0, 100.0, 30.0, 0.99 * PRECISION[what], 0.0)
    require_consistent([one], IDEAL, "mine.csv")
    with pytest.raises(InputError, match=r"allowed are .* of what 'ideal' drifts from 0 to 100 s, and rounding"):
        require_consistent([one._replace(size=1.01 * PRECISION[what])], IDEAL, "mine.csv")


def test_a_file_without_residuals_passes():
    require_consistent([], IMU, "mine.csv")
