"""Ticks of the filter with a vehicle model against dense linear algebra written out from the equations."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.vehicle import (
    absorb_samples,
    advance,
    advance_vector,
    joint_gain,
    mirror,
    update_rows,
    update_rows_vector,
)

N, BIAS, MOTION, DT = 24, 9, 18, 0.005


def skew(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def covariance(rng):
    root = rng.normal(size=(N, N)) * np.geomspace(1.0, 1e-3, N)[:, None]
    return root @ root.T + 1e-9 * np.eye(N)


def tick(rng):
    """Sums of a tick, and its dense transition from the equations of the module's caption."""
    q = rng.normal(size=4)
    C = np.array(matrix(*(q / np.linalg.norm(q)))).reshape(3, 3)
    gained = C @ rng.normal(scale=0.2, size=3)
    sums = np.zeros(21)
    sums[:9], sums[9:12] = DT * C.ravel(), gained
    phi = np.eye(N)
    phi[0:3, 18:21] = DT * C
    phi[3:6, 0:3], phi[3:6, 21:24] = -skew(gained), DT * C
    phi[6:9, 3:6] = DT * np.eye(3)
    phi[6:9, :] += 0.5 * DT * (phi[3:6, :] - np.eye(N)[3:6, :])
    return sums, phi


def rows():
    h = np.zeros((6, N))
    h[range(6), range(MOTION, MOTION + 6)] = 1.0
    h[range(6), range(BIAS, BIAS + 6)] = 1.0
    return h


def absorbed(P, x, z, R):
    """What `absorb_samples` makes of copies: P whole again, x, gains and weights."""
    P, x, K, weight, residual = P.copy(), x.copy(), np.zeros((6, N)), np.zeros(6), np.zeros(6)
    absorb_samples(P, x, K, weight, residual, z, R, BIAS, MOTION)
    mirror(P)
    return P, x, K, weight, residual


@pytest.fixture
def rng():
    return np.random.default_rng(20261121)


def test_a_tick_propagates_the_covariance_as_the_dense_transition_does(rng):
    for _ in range(5):
        P, (sums, phi) = covariance(rng), tick(rng)
        found = P.copy()
        found[np.tril_indices(N, -1)] = np.nan  # only the upper triangle is read
        advance(found, np.zeros((9, N)), sums, DT, MOTION)
        mirror(found)
        np.testing.assert_allclose(found, phi @ P @ phi.T, rtol=1e-12, atol=1e-13)


def test_a_tick_propagates_a_vector_as_the_dense_transition_does(rng):
    sums, phi = tick(rng)
    y = rng.normal(size=N)
    found = y.copy()
    advance_vector(found, sums, DT, MOTION)
    np.testing.assert_allclose(found, phi @ y, rtol=1e-13)


def test_six_samples_are_absorbed_as_a_dense_kalman_update_of_all_six_at_once(rng):
    P, x, z, H = covariance(rng), rng.normal(size=N), rng.normal(size=6), rows()
    R = rng.uniform(0.1, 1.0, size=6)
    S = H @ P @ H.T + np.diag(R)
    gain = np.linalg.solve(S, H @ P).T
    found, x_new, K, weight, residual = absorbed(P, x, z, R)
    np.testing.assert_allclose(found, (np.eye(N) - gain @ H) @ P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x_new, x + gain @ (z - H @ x), rtol=1e-9)
    joint = np.zeros((6, N))
    joint_gain(joint, K, weight, BIAS, MOTION)
    np.testing.assert_allclose(joint.T, gain, rtol=1e-9, atol=1e-12)
    # the innovations row after row have the same sum of squares as those of all six together
    r = z - H @ x
    assert residual**2 @ weight == pytest.approx(r @ np.linalg.solve(S, r), rel=1e-10)


@pytest.mark.parametrize("n_row", [1, 3, 6])
def test_any_gain_gives_josephs_covariance(rng, n_row):
    P, gain = covariance(rng), rng.normal(scale=0.3, size=(n_row, N))
    h, columns = rng.normal(size=(n_row, 2)), np.array([[MOTION + r, BIAS + r] for r in range(n_row)])
    count, noise = np.full(n_row, 2), rng.uniform(0.1, 1.0, size=n_row)
    count[0] = 1  # rows may have fewer entries than there is room for
    H = np.zeros((n_row, N))
    for r in range(n_row):
        H[r, columns[r, : count[r]]] = h[r, : count[r]]
    found, S, y = P.copy(), np.zeros((n_row, n_row)), rng.normal(size=N)
    update_rows(found, np.zeros((n_row, N)), S, gain, h, columns, count, noise)
    mirror(found)
    A = np.eye(N) - gain.T @ H
    np.testing.assert_allclose(found, A @ P @ A.T + gain.T @ np.diag(noise) @ gain, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(S, H @ P @ H.T + np.diag(noise), rtol=1e-12, atol=1e-13)
    moved, seen = y.copy(), np.zeros(n_row)
    update_rows_vector(moved, seen, gain, h, columns, count)
    np.testing.assert_allclose(moved, A @ y, rtol=1e-12)
    np.testing.assert_allclose(seen, H @ y, rtol=1e-12)


def test_a_second_of_samples_equals_a_dense_kalman_filter_of_24_states(rng, record_property):
    # The same rows, transitions and random-walk steps, in 24 x 24 matrices with numpy's solver; nothing is shared.
    H, R = rows(), np.array([4.9e-7] * 3 + [0.053] * 3)
    walk = (DT * np.array([0.002, 0.02, 0.02, 15.0, 10.0, 10.0])) ** 2
    sigma = np.concatenate([np.full(3, 0.017), np.full(3, 0.1), np.full(3, 5.0), np.full(3, 2.4e-7), np.full(3, 0.07),
                            np.full(3, 5.0), np.full(3, 0.017), np.full(3, 20.0)])  # fmt: skip
    P = np.diag(sigma**2)
    ours, x_ours, dense, x = P.copy(), np.zeros(N), P.copy(), np.zeros(N)
    for _ in range(200):
        sums, phi = tick(rng)
        z = rng.normal(size=6) * np.sqrt(R)
        for i in range(6):
            ours[MOTION + i, MOTION + i] += walk[i]
        absorb_samples(ours, x_ours, np.zeros((6, N)), np.zeros(6), np.zeros(6), z, R, BIAS, MOTION)
        advance(ours, np.zeros((9, N)), sums, DT, MOTION)
        advance_vector(x_ours, sums, DT, MOTION)
        dense[range(18, 24), range(18, 24)] += walk
        gain = np.linalg.solve(H @ dense @ H.T + np.diag(R), H @ dense).T
        x = phi @ (x + gain @ (z - H @ x))
        A = np.eye(N) - gain @ H
        dense = phi @ (A @ dense @ A.T + gain @ np.diag(R) @ gain.T) @ phi.T
    mirror(ours)
    scale = np.sqrt(np.diag(dense))
    worst = np.max(np.abs(ours - dense) / np.outer(scale, scale))
    record_property("covariance against a dense filter, in its sigmas", f"{worst:.1e}")
    assert worst < 1e-7
    assert np.max(np.abs(x_ours - x) / scale) < 1e-7
