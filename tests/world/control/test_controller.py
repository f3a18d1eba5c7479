"""Gains by closed form, readings of a gyro's noise, and what the cards refuse."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from lvnav_trade.world.control.controller import ControllerCard, FeedbackCard, design, rate_noise
from lvnav_trade.world.sensors.imu import ImuCard
from tests.world.flights import _load


def test_designed_gains_place_the_poles_of_the_closed_loop():
    # angle'' = mu angle - k (g angle + d angle'): s^2 + k d s + k g - mu has the wanted frequency and damping.
    gains = design(2.5, 0.7, effectiveness=8.0, instability=1.5)
    assert 8.0 * gains.attitude - 1.5 == pytest.approx(2.5**2)
    assert 8.0 * gains.rate == pytest.approx(2.0 * 0.7 * 2.5)


def test_noise_per_sample_is_density_by_root_of_rate_and_the_publication_multiplies_by_the_rate():
    # 0.72 deg/h/sqrt(Hz) at 200 Hz: 10.2 deg/h by the datasheet, 144 deg/h in the publication's percentages.
    unit = ImuCard.model_validate(_load("imu/kvh1750_003"))
    hour = math.radians(1.0) / 3600.0
    assert rate_noise(unit, "published") == pytest.approx(144.0 * hour, rel=1e-12)
    assert rate_noise(unit, "datasheet") == pytest.approx(10.1823 * hour, rel=1e-5)
    assert rate_noise(unit, "none") == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gains": []}, "at least 1"),
        ({"gains": [{"attitude": -1.0, "rate": "0.1 s"}]}, "greater than or equal to 0"),
        ({"gains": [{"attitude": 1.0, "rate": "-0.1 s"}]}, "greater than or equal to 0"),
        ({"turns": [{"start": "liftoff", "axis": "roll", "angle": "1 deg", "duration": "3 s"}]}, "pitch"),
        ({"turns": [{"start": "liftoff", "axis": "yaw", "angle": "1 deg", "duration": "0 s"}]}, "greater than 0"),
        ({"guidance": {"period": "0 s"}}, "greater than 0"),
    ],
)
def test_a_controller_that_cannot_be_is_reported_where(changes, message):
    with pytest.raises(ValidationError, match=message):
        ControllerCard.model_validate({**_load("controllers/three_motor"), **changes})


def test_feedback_is_one_of_the_named_kinds():
    with pytest.raises(ValidationError, match="'true', 'raw' or 'filtered'"):
        FeedbackCard.model_validate({"rate": "smooth"})
