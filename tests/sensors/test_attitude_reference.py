"""The attitude reference: what it measures of a true attitude, and the innovation that a filter makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.kernels.strapdown import N_NAV, Q
from lvnav_trade.sensors.attitude_reference import AttitudeReferenceCard, fill, measure
from lvnav_trade.sensors.jacobian_row import H_ATT, N_ENTRY

TRUE = np.array([0.8, 0.1, -0.5, 0.3]) / np.linalg.norm([0.8, 0.1, -0.5, 0.3])


def observed(errors):
    out = np.zeros(4)
    measure(out, TRUE, *errors)
    return out


def rows(measured, estimate):
    """Jacobian rows (3, 10) and innovations (3,) of a measured attitude at an estimated one."""
    H, z, nav = np.full((4, N_ENTRY), np.nan), np.full(4, np.nan), np.zeros(N_NAV)
    nav[Q : Q + 4] = estimate
    fill(H, z, 1, measured, nav)
    assert np.isnan(H[0]).all()
    assert np.isnan(z[0])
    return H[1:], z[1:]


def test_without_noise_the_truth_is_measured_and_its_innovation_is_zero():
    measured = observed((0.0, 0.0, 0.0))
    np.testing.assert_allclose(measured, TRUE, rtol=1e-15)
    np.testing.assert_allclose(rows(measured, TRUE)[1], 0.0, atol=1e-16)


def test_the_innovation_is_the_error_truth_minus_estimate_plus_the_noise():
    error, noise = np.array([2e-4, -3e-4, 1e-4]), 1e-4 * np.array([0.5, -1.0, 0.25])
    estimate = multiply(*from_rotation(*(-error)), *TRUE)
    _, z = rows(observed(noise), estimate)
    np.testing.assert_allclose(z, error + noise, atol=1e-7)


def test_the_row_is_one_in_the_column_of_its_axis():
    # central difference of the innovation with respect to the error of the estimate, frame i
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-5
        (H, high), (_, low) = (rows(TRUE, multiply(*from_rotation(*(-s * step)), *TRUE)) for s in (1.0, -1.0))
        np.testing.assert_allclose((high - low) / 2e-5, H[:, H_ATT + axis], atol=1e-9)
        assert H[axis, H_ATT + axis] == 1.0
        assert np.count_nonzero(H) == 3


def test_the_sigma_is_read_with_its_unit():
    assert AttitudeReferenceCard(name="a", source="b", sigma="1 deg").sigma == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize("sigma", ["0 deg", "-1 deg", "1 m", 1.0])
def test_no_noise_or_no_angle_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma"):
        AttitudeReferenceCard(name="a", source="b", sigma=sigma)
