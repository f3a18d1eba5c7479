"""Whitened rows, processed one by one, are the joint update with a full covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import update_scalar
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.kernels.whitening import whiten

N = 15
COLUMNS = np.array([6, 7, 8, 0, 1, 2, 3, 4, 5])
ENTRIES = np.arange(9)


def case(seed=1):
    rng = np.random.default_rng(seed)
    root, spread = rng.standard_normal((6, 12)), rng.standard_normal((N, 2 * N))
    scale = np.array([3.0] * 3 + [0.1] * 3)  # metres, and metres per second
    R = np.outer(scale, scale) * (root @ root.T) / 12.0
    return R, rng.standard_normal(6) * scale, rng.standard_normal((6, 9)) * scale[:, None], spread @ spread.T / N


def test_the_errors_of_whitened_rows_are_independent_with_variance_one():
    R, z, H, _ = case()
    root = np.linalg.cholesky(R)
    whitened, rows, residual = R.copy(), H.copy(), z.copy()
    whiten(whitened, residual, rows, 6, 9)
    np.testing.assert_allclose(np.tril(whitened), root, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(rows, np.linalg.solve(root, H), rtol=0, atol=1e-12)
    np.testing.assert_allclose(residual, np.linalg.solve(root, z), rtol=0, atol=1e-12)


def test_processed_one_after_another_they_are_the_joint_update():
    R, z, H, P0 = case(2)
    dense = np.zeros((6, N))
    dense[:, COLUMNS] = H
    S = dense @ P0 @ dense.T + R
    gain = np.linalg.solve(S, dense @ P0).T
    P, x, K, nis = P0.copy(), np.zeros(N), np.empty(N), 0.0
    rows, residual, work = H.copy(), z.copy(), R.copy()
    whiten(work, residual, rows, 6, 9)
    for i in range(6):
        normalised, _ = update_scalar(P, x, K, rows[i], ENTRIES, COLUMNS, residual[i], 1.0, np.inf, N, False)
        nis += normalised**2
    np.testing.assert_allclose(x, gain @ z, rtol=0, atol=1e-11)
    np.testing.assert_allclose(P, P0 - gain @ dense @ P0, rtol=0, atol=1e-10)
    assert nis == pytest.approx(z @ np.linalg.solve(S, z), rel=1e-10)


@jit
def whiten_lanes(R, z, H, n, n_entry):
    whiten(view(R), view(z), view(H), n, n_entry)


def test_eight_runs_are_whitened_to_the_bit_as_each_alone():
    cases = [case(seed) for seed in range(WIDTH)]
    R, z, H = (np.ascontiguousarray(np.stack([c[i] for c in cases], axis=-1)) for i in range(3))
    z[:, 5] = np.nan  # a run without a solution
    whiten_lanes(R, z, H, 6, 9)
    for run in range(WIDTH):
        alone_R, alone_z, alone_H, _ = cases[run]
        alone_z = alone_z if run != 5 else np.full(6, np.nan)
        whiten(alone_R, alone_z, alone_H, 6, 9)
        np.testing.assert_array_equal(R[..., run], alone_R)
        np.testing.assert_array_equal(z[..., run], alone_z)
        np.testing.assert_array_equal(H[..., run], alone_H)


def test_a_covariance_that_is_not_positive_leaves_rows_that_no_update_assumes():
    R, z, H, P0 = case(3)
    R[3, 3] = -1.0
    whiten(R, z, H, 6, 9)
    assert np.all(np.isfinite(z[:3]))
    assert np.isnan(z[3])
    _, weight = update_scalar(P0, np.zeros(N), np.empty(N), H[3], ENTRIES, COLUMNS, z[3], 1.0, np.inf, N, False)
    assert weight == 0.0
