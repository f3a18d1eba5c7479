"""Ticks of the filter with a vehicle model against dense linear algebra written out from the equations."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.transition import CONSTANT, OTHER_0, OWN_0
from lvnav_trade.kernels.vehicle import (
    advance,
    advance_vector,
    advance_vector_transposed,
    fill_samples,
    joint_gain,
    mirror,
    update_samples,
    update_together,
    update_vector_together,
)

N, BIAS, MOTION, DT = 24, 9, 18, 0.005
BIASES = np.array([[[0, CONSTANT]], [[1, CONSTANT]]])
COLUMNS = np.array([[MOTION + r, BIAS + r] for r in range(6)])
RATE, FORCE = np.array([0.3, -0.2, 0.1]), np.array([30.0, 1.0, -2.0])


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


def biases():
    """Jacobian rows (6, 2) of a filter with biases of both sensors."""
    h = np.zeros((6, 2))
    fill_samples(h, BIASES, RATE, FORCE)
    return h


def updated(P, x, z, R, n_estimated=N):
    """What `update_samples` makes of copies: P whole again, x, gains, weights and residuals."""
    P, x, K, weight, residual = P.copy(), x.copy(), np.zeros((6, N)), np.zeros(6), np.zeros(6)
    update_samples(P, x, K, weight, residual, z, R, biases(), COLUMNS, n_estimated)
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


def test_six_samples_update_as_a_dense_kalman_filter_that_takes_all_six_at_once(rng):
    P, x, z, H = covariance(rng), rng.normal(size=N), rng.normal(size=6), rows()
    R = rng.uniform(0.1, 1.0, size=6)
    S = H @ P @ H.T + np.diag(R)
    gain = np.linalg.solve(S, H @ P).T
    found, x_new, K, weight, residual = updated(P, x, z, R)
    np.testing.assert_allclose(found, (np.eye(N) - gain @ H) @ P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x_new, x + gain @ (z - H @ x), rtol=1e-9)
    joint = np.zeros((6, N))
    joint_gain(joint, K, weight, biases(), COLUMNS, N)
    np.testing.assert_allclose(joint.T, gain, rtol=1e-9, atol=1e-12)
    # the innovations row after row have the same sum of squares as those of all six together
    r = z - H @ x
    assert residual**2 @ weight == pytest.approx(r @ np.linalg.solve(S, r), rel=1e-10)


@pytest.mark.parametrize("n_entry", [1, 2, 4])
def test_any_gain_of_six_rows_together_gives_josephs_covariance(rng, n_entry):
    P, gain, noise = covariance(rng), rng.normal(scale=0.3, size=(6, N)), rng.uniform(0.1, 1.0, size=6)
    columns = np.array([rng.permutation(N)[:n_entry] for _ in range(6)])
    h = rng.normal(size=(6, n_entry))
    H = np.zeros((6, N))
    for r in range(6):
        H[r, columns[r]] = h[r]
    found, S, y = P.copy(), np.zeros((6, 6)), rng.normal(size=N)
    update_together(found, np.zeros((6, N)), S, gain, h, columns, noise)
    mirror(found)
    A = np.eye(N) - gain.T @ H
    np.testing.assert_allclose(found, A @ P @ A.T + gain.T @ np.diag(noise) @ gain, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(S, H @ P @ H.T + np.diag(noise), rtol=1e-12, atol=1e-13)
    moved, seen = y.copy(), np.zeros(6)
    update_vector_together(moved, seen, gain, h, columns)
    np.testing.assert_allclose(moved, A @ y, rtol=1e-12)
    np.testing.assert_allclose(seen, H @ y, rtol=1e-12)


def test_a_row_has_a_parameter_times_what_drives_it():
    """A gyro's scale factor by its own axis' rate, its g-sensitivity by the force along x, a bias by one."""
    h = np.full((6, 3), np.nan)
    fill_samples(h, np.array([[[0, OWN_0], [1, OTHER_0]], [[2, CONSTANT], [-1, CONSTANT]]]), RATE, FORCE)
    np.testing.assert_array_equal(h[:, 0], 1.0)
    np.testing.assert_array_equal(h[:, 1], [*RATE, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(h[:, 2], [FORCE[0]] * 3 + [0.0] * 3)


def test_considered_states_keep_their_variance_and_their_correlations_follow_the_gain(rng):
    """Rows one after the other, each with Schmidt's gain: that of the estimated states, zero for the others."""
    n_estimated, P, x, z = 20, covariance(rng), rng.normal(size=N), rng.normal(size=6)
    R, H = rng.uniform(0.1, 1.0, size=6), rows()
    x[n_estimated:] = 0.0
    dense, state = P.copy(), x.copy()
    for r in range(6):
        gain = dense @ H[r] / (H[r] @ dense @ H[r] + R[r])
        gain[n_estimated:] = 0.0
        A = np.eye(N) - np.outer(gain, H[r])
        state = state + gain * (z[r] - H[r] @ state)
        dense = A @ dense @ A.T + R[r] * np.outer(gain, gain)
    found, x_new, K, weight, _ = updated(P, x, z, R, n_estimated)
    np.testing.assert_allclose(found, dense, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(x_new, state, rtol=1e-9)
    np.testing.assert_array_equal(found[n_estimated:, n_estimated:], P[n_estimated:, n_estimated:])
    together = np.zeros((6, N))
    joint_gain(together, K, weight, biases(), COLUMNS, n_estimated)
    A = np.eye(N) - together.T @ H
    np.testing.assert_allclose(A @ P @ A.T + together.T @ np.diag(R) @ together, dense, rtol=1e-9, atol=1e-12)


def test_a_tick_goes_back_by_the_transpose_of_its_transition(rng):
    sums, phi = tick(rng)
    y = rng.normal(size=N)
    found = y.copy()
    advance_vector_transposed(found, sums, DT, MOTION)
    np.testing.assert_allclose(found, phi.T @ y, rtol=1e-13, atol=1e-15)


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
        update_samples(ours, x_ours, np.zeros((6, N)), np.zeros(6), np.zeros(6), z, R, biases(), COLUMNS, N)
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
