"""What a filter assumes of its devices: units, and what is the same on every axis."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.filter.assumed import ImuModel


def test_a_filter_model_is_read_in_the_datasheets_units():
    model = ImuModel(
        gyro_random_walk="0.03 deg/sqrt(h)", accel_random_walk="50 ug/sqrt(Hz)", gyro_bias="1 deg/h", accel_bias="2 mg"
    )
    assert model.gyro_random_walk == pytest.approx(math.radians(0.03) / 60.0, rel=1e-12)
    assert model.accel_random_walk == pytest.approx(50e-6 * 9.80665, rel=1e-12)
    assert model.gyro_bias == pytest.approx(math.radians(1.0) / 3600.0, rel=1e-12)
    assert model.gyro_bias_time is None
