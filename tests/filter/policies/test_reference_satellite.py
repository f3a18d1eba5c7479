"""A reference satellite in place of the clock, against differences that are whitened by dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import update_scalar, update_with_gain


def whitened_differences(P, H, R, reference):
    """The covariance after differences against a reference satellite, whitened and taken one by one, by dense algebra:
    Bierman, Factorization Methods for Discrete Sequential Estimation, section IV.7.
    """
    others = [i for i in range(len(H)) if i != reference]
    D = np.eye(len(H))[others] - np.eye(len(H))[reference]
    root = np.linalg.cholesky(D @ np.diag(R) @ D.T)
    for row in np.linalg.solve(root, D @ H):
        K = P @ row / (row @ P @ row + 1.0)
        P = P - np.outer(K, row @ P)
    return P


@pytest.mark.parametrize("reference", [0, 3])
def test_taking_the_reference_for_the_clock_is_differencing_and_whitening(reference):
    draw = np.random.default_rng(4)
    n, m = 6, 5  # five states, and the clock behind them
    root, H = draw.normal(size=(n - 1, n - 1)), draw.normal(size=(m, n - 1))
    R, P = draw.uniform(0.5, 4.0, m), np.zeros((n, n))
    P[:5, :5], P[5, 5] = root @ root.T, 7.0
    expected = whitened_differences(P[:5, :5], H, R, reference)
    rows, every = np.hstack([H, np.ones((m, 1))]), np.arange(n)
    x, K = np.zeros(n), np.zeros(n)
    update_with_gain(P, x, K, rows[reference], every, every, np.eye(n)[5], 0.0, R[reference], np.inf, n)
    for i in set(range(m)) - {reference}:
        update_scalar(P, x, K, rows[i], every, every, 0.0, R[i], np.inf, n, False)
    np.testing.assert_allclose(P[:5, :5], expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("reference", [0, 3])
def test_a_difference_of_two_epochs_is_differenced_by_the_clock_at_the_earlier_one(reference):
    draw = np.random.default_rng(5)
    n, m = 9, 5  # three states now and three before, another; then the clock now and its clone
    root, H = draw.normal(size=(n - 2, n - 2)), draw.normal(size=(m, n - 2))
    R, P = draw.uniform(0.5, 4.0, m), np.zeros((n, n))
    whole = draw.normal(size=(n, n))
    P[:] = whole @ whole.T
    P[: n - 2, : n - 2] = root @ root.T + 3.0 * np.eye(n - 2)
    P[n - 2 :, n - 2 :] += 10.0 * np.eye(2)
    expected = whitened_differences(P[: n - 2, : n - 2], H, R, reference)
    rows, every = np.hstack([H, np.ones((m, 1)), -np.ones((m, 1))]), np.arange(n)
    x, K = np.zeros(n), np.zeros(n)
    update_with_gain(P, x, K, rows[reference], every, every, -np.eye(n)[n - 1], 0.0, R[reference], np.inf, n)
    for i in set(range(m)) - {reference}:
        update_scalar(P, x, K, rows[i], every, every, 0.0, R[i], np.inf, n, False)
    np.testing.assert_allclose(P[: n - 2, : n - 2], expected, rtol=1e-9, atol=1e-11)
