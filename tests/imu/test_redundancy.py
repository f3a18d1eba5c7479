"""The middle one of several readings, and sets of units that cannot be tested against each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.imu.redundancy import median_model
from tests.imu.test_array import of_units


@pytest.mark.parametrize(("n", "variance"), [(3, 0.448671), (4, 0.298246), (5, 0.286834)])
def test_the_middle_of_like_readings_has_the_published_variance(n, variance):
    """Variance of the median of n standard normal numbers (Teichroew, Ann. Math. Stat. 27, 1956)."""
    found = median_model(np.zeros(n), np.ones(n), np.full(n, 1e-6))
    assert found.gains == pytest.approx(np.full(n, 1.0 / n), abs=1e-6)
    assert found.white_variance == pytest.approx(variance, rel=0.01)
    assert found.mean == pytest.approx(0.0, abs=1e-9)


def test_the_middle_beside_a_reading_far_off_is_the_larger_of_the_others():
    """E max = 1 / sqrt(pi), Var max = 1 - 1 / pi of two standard normal numbers."""
    found = median_model(np.array([0.0, 0.0, 50.0]), np.ones(3), np.full(3, 1e-6))
    assert found.gains == pytest.approx([0.5, 0.5, 0.0], abs=1e-6)
    assert found.mean == pytest.approx(1.0 / math.sqrt(math.pi), abs=1e-6)
    assert found.white_variance == pytest.approx(1.0 - 1.0 / math.pi, rel=0.02)


@pytest.mark.parametrize("size", [0.1, 1.0, 5.0])
def test_what_lasts_of_the_middle_is_its_mean_over_the_noise(size):
    """Against 200,000 draws: covariance of two samples with the same lasting errors, and the variance of one."""
    rng, mean, white = np.random.default_rng(4), np.array([0.0, 0.3, 1.0]), np.array([1.0, 0.7, 1.2])
    held = mean + size * rng.standard_normal((200_000, 3))
    a, b = (np.median(held + white * rng.standard_normal(held.shape), axis=1) for _ in range(2))
    found = median_model(mean, white, np.full(3, size))
    assert found.mean == pytest.approx(a.mean(), abs=0.01 * (1.0 + size))
    assert found.constant_variance == pytest.approx(np.cov(a, b)[0, 1], rel=0.05, abs=0.005)
    assert found.constant_variance + found.white_variance == pytest.approx(np.var(a), rel=0.03)


@pytest.mark.parametrize(
    ("units", "fields", "part"),
    [
        (
            [{}, {}],
            {"parity": {}},
            "none can be isolated; give a third unit, or skewed axes, or after_detection: report",
        ),
        ([{}], {"parity": {"after_detection": "report"}}, "no failure can be detected"),
        ([{}, {}], {"selection": "mid_value"}, "takes three units"),
        ([{}, {}, {"axes": [[1, 0, 0]]}], {"selection": "mid_value"}, "units.2 senses along 1 of 3"),
        ([{}, {}, {}], {"selection": "mid_value", "weights": "equal"}, "weights: equal"),
        ([{}, {}, {}], {"parity": {"window": "1 ms"}}, "less than a sample"),
        (
            [{}, {}, {"gyro": {"bias_repeatability": "1 deg/h"}}],
            {"parity": {}, "weights": "equal"},
            "random_walk: is zero",
        ),
        ([{}, {}], {"selection": "prime"}, "state either hand_over"),
        ([{}], {"selection": "prime", "hand_over": "20 s"}, "no unit to hand over to"),
        ([{}, {"axes": [[1, 0, 0]]}], {"selection": "prime", "hand_over": "20 s"}, "units.1 senses along 1 of 3"),
        ([{}, {}], {"selection": "prime", "hand_over": "20 s", "weights": "equal"}, "so there are no weights"),
        ([{}, {}], {"hand_over": "20 s"}, "hand_over: a hand-over from a prime unit"),
        ([{}, {}], {"parity": {"after_detection": "hand_over"}}, "after_detection: a hand-over from a prime unit"),
        (
            [{}, {}],
            {"selection": "prime", "hand_over": "20 s", "parity": {"after_detection": "hand_over"}},
            "state either hand_over",
        ),
        ([{}, {}], {"selection": "prime", "hand_over": "20"}, "is not a time"),
    ],
)
def test_a_set_that_cannot_be_tested_or_selected_from_is_refused(units, fields, part):
    with pytest.raises(ValidationError, match=part):
        of_units(*units, **fields)
