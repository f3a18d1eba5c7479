"""The attitude reference: what it measures of a true attitude, and the innovation that a filter makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import from_rotation, multiply
from lvnav_trade.observables.attitude import AttitudeReferenceCard, innovation, observe

TRUE = np.array([0.8, 0.1, -0.5, 0.3]) / np.linalg.norm([0.8, 0.1, -0.5, 0.3])


def test_without_noise_the_truth_is_measured_and_its_innovation_is_zero():
    measured = observe(*TRUE, 0.0, 1.0, -2.0, 0.5)
    np.testing.assert_allclose(measured, TRUE, rtol=1e-15)
    np.testing.assert_allclose(innovation(*measured, *TRUE), 0.0, atol=1e-16)


def test_the_innovation_is_the_error_truth_minus_estimate_plus_the_noise():
    error, noise = np.array([2e-4, -3e-4, 1e-4]), np.array([0.5, -1.0, 0.25])
    estimate = multiply(*from_rotation(*(-error)), *TRUE)
    z = innovation(*observe(*TRUE, 1e-4, *noise), *estimate)
    np.testing.assert_allclose(z, error + 1e-4 * noise, atol=1e-7)


def test_the_row_is_one_in_the_column_of_its_axis():
    # central difference of the innovation with respect to the error of the estimate, frame i
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-5
        high, low = (innovation(*TRUE, *multiply(*from_rotation(*(-s * step)), *TRUE)) for s in (1.0, -1.0))
        derivative = (np.array(high) - np.array(low)) / 2e-5
        assert derivative == pytest.approx(np.eye(3)[axis], abs=1e-9)


def test_the_sigma_is_read_with_its_unit():
    assert AttitudeReferenceCard(name="a", source="b", sigma="1 deg").sigma == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize("sigma", ["0 deg", "-1 deg", "1 m", 1.0])
def test_no_noise_or_no_angle_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma"):
        AttitudeReferenceCard(name="a", source="b", sigma=sigma)
