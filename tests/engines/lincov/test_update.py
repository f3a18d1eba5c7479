"""A row of the nominal flight: the gain that is given is the gain that is taken, in every covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import absorb, absorb_with

N = 5
ROW = np.array([0.5, 0.0, -1.0, 0.0, 0.2])
ALL = np.arange(N)


def spread():
    root = np.random.default_rng(3).standard_normal((N, N))
    return root @ root.T


def test_with_the_covariance_s_own_gain_a_row_is_absorbed_as_ever():
    P, other = spread(), spread()
    x, y, K = np.zeros(N), np.zeros(N), np.zeros(N)
    normalised, weight = absorb(P, x, K, ROW, ALL, ALL, 1.3, 0.7, np.inf, N, False)
    gain = K * weight
    same = absorb_with(other, y, K, ROW, ALL, ALL, gain, 1.3, 0.7, np.inf, N)
    assert same == pytest.approx((normalised, weight), rel=1e-12)
    np.testing.assert_allclose(other, P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(y, x, rtol=1e-12)


def test_with_another_gain_the_covariance_is_that_of_joseph_s_form():
    P, x, K = spread(), np.zeros(N), np.zeros(N)
    gain = np.array([0.1, -0.2, 0.05, 0.3, 0.0])
    absorb_with(P, x, K, ROW, ALL, ALL, gain, 1.3, 0.7, np.inf, N)
    left = np.eye(N) - np.outer(gain, ROW)
    np.testing.assert_allclose(P, left @ spread() @ left.T + 0.7 * np.outer(gain, gain), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(x, 1.3 * gain)


def test_a_row_beyond_the_gate_changes_nothing():
    P, x, K = spread(), np.zeros(N), np.zeros(N)
    _, weight = absorb_with(P, x, K, ROW, ALL, ALL, np.ones(N), 1e6, 0.7, 9.0, N)
    assert weight == 0.0
    np.testing.assert_array_equal(P, spread())
    np.testing.assert_array_equal(x, 0.0)
