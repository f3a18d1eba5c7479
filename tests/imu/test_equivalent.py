"""IMU equivalent to an array: noise of several triads or skewed axes, and their scale factor and misalignment."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.imu.array import list_triads
from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.imu.error_model import ImuCard
from tests.imu.test_array import CARD, DODECAHEDRON, cone, of_units


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_noise_of_n_like_triads_falls_with_the_root_of_n(n):
    alone = ImuCard.model_validate(CARD)
    turns = [{"orientation": [f"{20 * k} deg", f"{-35 * k} deg", f"{50 * k} deg"]} for k in range(n)]
    found = equivalent(of_units(*turns))
    for name in ("random_walk", "bias_repeatability", "bias_instability"):
        assert getattr(found.gyro, name) == pytest.approx(getattr(alone.gyro, name) / math.sqrt(n), rel=1e-12)
    assert found.accel.random_walk == pytest.approx(alone.accel.random_walk / math.sqrt(n), rel=1e-12)
    assert found.gyro.instability_time == pytest.approx(alone.gyro.instability_time, rel=1e-12)


@pytest.mark.parametrize("axes", [cone(3), cone(4), cone(5), cone(6), DODECAHEDRON], ids=len)
def test_the_noise_of_n_skewed_axes_of_isotropic_geometry_falls_with_the_root_of_n_over_three(axes):
    alone = ImuCard.model_validate(CARD)
    for units in ([{"axes": axes}], [{"axes": [axis]} for axis in axes]):  # one box, or one of its own for each axis
        card = of_units(*units)
        found = equivalent(card)
        assert found.gyro.random_walk == pytest.approx(alone.gyro.random_walk * math.sqrt(3.0 / len(axes)), rel=1e-9)
        covariance = sum(triad.gyro @ triad.gyro.T for triad in list_triads(card))
        assert covariance == pytest.approx(np.eye(3) * 3.0 / len(axes), abs=1e-9)


def test_a_scale_factor_of_skewed_axes_is_scale_factor_and_misalignment_of_the_fused_triad():
    """Three axes on a cone: M = H^-1 diag(k) H, drawn; mean squares of its diagonal and beside it."""
    card = of_units({"axes": cone(3), "gyro": {"scale_factor": "100 ppm"}})
    rows = np.array(cone(3))
    k = 1e-4 * np.random.default_rng(1).standard_normal((20000, 3))
    M = np.linalg.inv(rows) @ (k[:, :, None] * rows)
    diagonal = np.mean(np.diagonal(M, axis1=1, axis2=2) ** 2)
    beside = (np.mean(np.sum(M**2, axis=(1, 2))) - 3.0 * diagonal) / 6.0
    found = equivalent(card).gyro
    assert found.scale_factor**2 == pytest.approx(diagonal, rel=0.03)
    assert found.misalignment**2 == pytest.approx(beside, rel=0.03)
