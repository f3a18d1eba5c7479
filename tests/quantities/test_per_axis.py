"""Values of a triad's axes: read, written, and as one."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from lvnav_trade.imu.error_model import GyroCard
from lvnav_trade.quantities.per_axis import axes, each_axis, rms, squares


def test_three_equal_ones_are_one_and_two_are_a_mistake():
    alike = GyroCard(scale_factor=["1 ppm", "1 ppm", "1 ppm"])
    assert alike == GyroCard(scale_factor="1 ppm")
    listed = GyroCard(scale_factor=["1 ppm", "2 ppm", 0])
    assert GyroCard.model_validate(listed.model_dump(mode="json")) == listed
    with pytest.raises(ValidationError, match="three, of x, y and z"):
        GyroCard(scale_factor=["1 ppm", "2 ppm"])
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        GyroCard(scale_factor=["1 ppm", "-2 ppm", 0])


def test_one_value_is_that_of_every_axis_and_its_own_root_mean_square() -> None:
    assert axes(0.1) == (0.1, 0.1, 0.1)
    assert (rms(0.1), rms((3.0, 0.0, 0.0))) == (0.1, pytest.approx(math.sqrt(3.0)))
    assert each_axis(math.hypot, 3.0, 4.0) == 5.0
    assert each_axis(math.hypot, 3.0, (4.0, 0.0, 0.0)) == (5.0, 3.0, 3.0)
    assert squares((1.0, 2.0, 3.0)) == (1.0, 4.0, 9.0)
