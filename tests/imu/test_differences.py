"""What two units of a set differ by, axis by axis, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.imu.differences import relative_errors
from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.kernels.transition import GYRO
from tests.building import loaded, with_units


def test_what_the_axes_of_two_like_mounted_units_differ_in_is_of_each_axis_of_the_fused_triad():
    """Of equal weights the fused variance is a quarter of the sum, that of the difference the sum; they correlate by
    (s1^2 - s2^2) / (s1^2 + s2^2).
    """
    one, two = np.array([1.0, 1.0, 5.0]), np.array([5.0, 1.0, 1.0])
    units = [{"gyro": {"bias_repeatability": [f"{s} deg/h" for s in sigma], "bias_instability": "0 deg/h"}}
             for sigma in (one, two)]  # fmt: skip
    imu = with_units(loaded("base.imu=imu/tactical_fog_matched"), units, weights="equal").imu
    deg_h = np.radians(1.0) / 3600.0
    assert equivalent(imu).gyro.bias_repeatability == pytest.approx(np.hypot(one, two) / 2.0 * deg_h, rel=1e-12)
    found = relative_errors(imu, GYRO, 0, 1)
    assert found.bias == pytest.approx(np.hypot(one, two) * deg_h, rel=1e-12)
    assert found.correlation == pytest.approx((one**2 - two**2) / (one**2 + two**2), abs=1e-12)
    assert isinstance(equivalent(imu).accel.bias_repeatability, float)
