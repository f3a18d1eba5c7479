"""Excess path and bending between points within the air: the flat closed form, and rays through the whole air."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from lvnav_trade.kernels.media.refractivity import EARTH_RADIUS, exponential_refractivity, ray, sample_atmosphere
from lvnav_trade.kernels.media.sight import along_line

N, H = 315e-6, 7350.0


@pytest.mark.parametrize("height", [500.0, 3e3, 12e3, 40e3])
@pytest.mark.parametrize("degrees", [30.0, 60.0, 85.0])
def test_steep_lines_meet_the_closed_form_of_a_flat_exponential_atmosphere(height, degrees):
    e = np.radians(degrees)
    found = along_line(exponential_refractivity, 0.0, e, height / np.sin(e))
    share = 1.0 - np.exp(-height / H)
    # the Earth's curvature lifts the end of the line by (R cos e)^2 / 2 r
    bent = 2.0 * height / (EARTH_RADIUS * np.tan(e) ** 2) + 2e-4
    assert found.excess == pytest.approx(N * H * share / np.sin(e), rel=bent)
    assert found.bending == pytest.approx(N / np.tan(e) * (1.0 - H / height * share), rel=bent + 1e-3)


STEPS = [(3.0, 0.06), (5.0, 0.03), (10.0, 0.01), (30.0, 0.003), (80.0, 0.003)]


@pytest.mark.parametrize(("degrees", "tolerance"), STEPS)
def test_lines_to_far_beyond_the_air_meet_traced_rays(degrees, tolerance):
    profile, e, far = sample_atmosphere(partial(exponential_refractivity)), np.radians(degrees), EARTH_RADIUS + 20e6
    traced = ray(profile, 0.0, e, far)
    rise = EARTH_RADIUS * np.sin(e)
    found = along_line(exponential_refractivity, 0.0, e, np.sqrt(far**2 - EARTH_RADIUS**2 + rise**2) - rise)
    assert found.excess == pytest.approx(float(traced.delay), rel=tolerance)
    assert found.bending == pytest.approx(float(traced.apparent_elevation) - e, rel=tolerance)


def test_above_the_air_there_is_none_and_shapes_broadcast():
    found = along_line(exponential_refractivity, [0.0, 119e3], [[0.1], [1.0]], 500e3)
    assert found.excess.shape == found.bending.shape == (2, 2)
    assert np.all(found.excess[:, 1] < 1e-5)
    assert np.all(found.excess[0] > found.excess[1])
