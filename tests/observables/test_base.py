"""The antenna and the line of sight."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.strapdown import N_NAV, Q, R, V
from lvnav_trade.observables.base import antenna, line_of_sight


def test_an_antenna_ahead_of_a_body_that_yaws_is_ahead_and_swings_to_the_right():
    # identity attitude: body axes are those of frame i; 2 m ahead, yaw of 0.1 rad/s about z: y is to the right
    nav, out = np.zeros(N_NAV), np.zeros(21)
    nav[Q], nav[V : V + 3], nav[R : R + 3] = 1.0, (10.0, 20.0, 30.0), (100.0, 200.0, 300.0)
    antenna(out, nav, np.array([0.0, 0.0, 0.1]), np.array([2.0, 0.0, 0.0]), 1.0)
    np.testing.assert_allclose(out[:3], [102.0, 200.0, 300.0], rtol=1e-15)
    np.testing.assert_allclose(out[3:6], [10.0, 20.2, 30.0], rtol=1e-15)
    np.testing.assert_allclose(out[6:12], [2.0, 0.0, 0.0, 0.0, 0.2, 0.0], rtol=1e-15)


def test_an_antenna_at_the_unit_moves_with_it():
    nav, out = np.arange(1.0, 11.0), np.zeros(21)
    nav[Q : Q + 4] /= np.linalg.norm(nav[Q : Q + 4])
    antenna(out, nav, np.array([1.0, 2.0, 3.0]), np.zeros(3), 1.0)
    np.testing.assert_array_equal(out[:6], nav[[R, R + 1, R + 2, V, V + 1, V + 2]])
    np.testing.assert_array_equal(out[6:], 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_antennas_velocity_moves_with_what_the_body_rate_is_known_by(sign):
    """A rate counts as it is; of a gyro bias that is larger, the rate is smaller."""
    nav, lever = np.array([0.7, -0.1, 0.5, 0.5, 10.0, 20.0, 30.0, 1.0, 2.0, 3.0]), np.array([1.0, -2.0, 0.5])
    nav[Q : Q + 4] /= np.linalg.norm(nav[Q : Q + 4])
    rate, at, before, after = np.array([0.1, 0.2, -0.3]), np.zeros(21), np.zeros(21), np.zeros(21)
    antenna(at, nav, rate, lever, sign)
    for axis in range(3):
        step = 0.5 * sign * np.eye(3)[axis]
        antenna(before, nav, rate - step, lever, sign)
        antenna(after, nav, rate + step, lever, sign)
        np.testing.assert_allclose(at[12:21].reshape(3, 3)[:, axis], after[3:6] - before[3:6], atol=1e-13)


def test_the_line_of_sight_is_a_unit_vector_from_antenna_to_satellite():
    *u, distance = line_of_sight(np.array([103.0, 4.0, 0.0]), np.array([100.0, 0.0, 0.0] + [0.0] * 9))
    assert distance == pytest.approx(5.0, rel=1e-15)
    np.testing.assert_allclose(u, [0.6, 0.8, 0.0], rtol=1e-15)
