"""Propagation and scalar updates of a covariance against dense matrices and textbook formulas."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import normalised_square, predict, update_scalar
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, view

N, CLOCK, N_ESTIMATED = 20, 15, 17  # nav 9, two blocks of three, clock, a considered block
# position from velocity before and after the rest; a block on the diagonal
ROWS, COLUMNS = np.array([6, 3, 3, 3, 3, 6, 0, 6]), np.array([3, 3, 0, 12, 17, 0, 9, 3])
SECONDS = 0.1


def covariance_matrix(n=N, seed=1):
    A = np.random.default_rng(seed).standard_normal((n, 2 * n))
    return A @ A.T / n


def step_inputs():
    rng = np.random.default_rng(2)
    blocks = 0.1 * rng.standard_normal((ROWS.size, 9))
    blocks[0], blocks[-1] = 0.05 * np.eye(3).ravel(), 0.07 * np.eye(3).ravel()
    decay = np.ones(N)
    decay[9:12], decay[17:] = 0.9, 0.7
    return blocks, decay, 0.2 * rng.random(N)


def dense_transition(blocks, decay):
    phi = np.eye(N)
    for row, column, block in zip(ROWS, COLUMNS, blocks, strict=True):
        step = np.eye(N)
        step[row : row + 3, column : column + 3] += block.reshape(3, 3)
        phi = step @ phi
    phi = np.diag(decay) @ phi
    phi[CLOCK, CLOCK + 1] += SECONDS
    return phi


@jit
def predict_lanes(P, blocks, rows, columns, decay, noise, clock, seconds):
    predict(view(P), view(blocks), rows, columns, decay, noise, clock, seconds)


def test_propagation_is_that_of_the_dense_matrices_with_half_of_the_noise_on_either_side():
    P = covariance_matrix()
    blocks, decay, noise = step_inputs()
    phi = dense_transition(blocks, decay)
    expected = phi @ (P + 0.5 * np.diag(noise)) @ phi.T + 0.5 * np.diag(noise)
    predict(P, blocks, ROWS, COLUMNS, decay, noise, CLOCK, SECONDS)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(P, P.T)


def test_without_a_clock_no_state_is_integrated():
    P = covariance_matrix()
    blocks, decay, noise = step_inputs()
    phi = dense_transition(blocks, decay)
    phi[CLOCK, CLOCK + 1] = 0.0
    expected = phi @ (P + 0.5 * np.diag(noise)) @ phi.T + 0.5 * np.diag(noise)
    predict(P, blocks, ROWS, COLUMNS, decay, noise, -1, SECONDS)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-13)


def test_eight_covariances_are_propagated_as_each_alone():
    blocks, decay, noise = step_inputs()
    P = np.stack([covariance_matrix(seed=s) for s in range(WIDTH)], axis=-1)
    D = np.stack([blocks * (1.0 + 0.1 * s) for s in range(WIDTH)], axis=-1)
    together = P.copy()
    predict_lanes(together, D, ROWS, COLUMNS, decay, noise, CLOCK, SECONDS)
    for s in range(WIDTH):
        alone, d = P[..., s].copy(), D[..., s].copy()
        predict(alone, d, ROWS, COLUMNS, decay, noise, CLOCK, SECONDS)
        # lanes may contract a product and a sum to one rounding
        np.testing.assert_allclose(together[..., s], alone, rtol=0, atol=1e-13)


H_COLUMNS, H_ENTRIES = np.array([6, 7, 8, 0, 1, 2, 15]), np.array([0, 1, 2, 3, 4, 5, 9])


def row(seed=3):
    rng = np.random.default_rng(seed)
    h = rng.standard_normal(10)
    dense = np.zeros(N)
    dense[H_COLUMNS] = h[H_ENTRIES]
    return h, dense


def take(P, x, h, innovation, variance=0.7, gate_squared=np.inf, n_estimated=N, joseph=False):
    K = np.empty(N)
    return update_scalar(P, x, K, h, H_ENTRIES, H_COLUMNS, innovation, variance, gate_squared, n_estimated, joseph)


@pytest.mark.parametrize("joseph", [False, True])
def test_a_row_is_the_update_of_kalman(joseph):
    P, x = covariance_matrix(), np.random.default_rng(4).standard_normal(N)
    h, dense = row()
    s = dense @ P @ dense + 0.7
    gain = P @ dense / s
    expected_x = x + gain * (1.3 - dense @ x)
    expected_P = (np.eye(N) - np.outer(gain, dense)) @ P
    normalised = (1.3 - dense @ x) / np.sqrt(s)
    given = take(P, x, h, 1.3, joseph=joseph)
    assert given == pytest.approx((normalised, 1.0 / s), rel=1e-13)
    np.testing.assert_allclose(x, expected_x, rtol=0, atol=1e-13)
    np.testing.assert_allclose(P, expected_P, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(P, P.T)


@pytest.mark.parametrize("joseph", [False, True])
def test_considered_states_get_no_gain_but_keep_their_correlations(joseph):
    """Schmidt: gain of zero on the states from 17 on, Joseph's form for a gain that is not optimal."""
    P, x = covariance_matrix(), np.zeros(N)
    h, dense = row()
    h[9], H = 2.0, dense.copy()
    H[15] = 2.0
    gain = P @ H / (H @ P @ H + 0.7)
    gain[N_ESTIMATED:] = 0.0
    A = np.eye(N) - np.outer(gain, H)
    expected = A @ P @ A.T + 0.7 * np.outer(gain, gain)
    considered = P[N_ESTIMATED:, N_ESTIMATED:].copy()
    take(P, x, h, 1.3, n_estimated=N_ESTIMATED, joseph=joseph)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(P[N_ESTIMATED:, N_ESTIMATED:], considered)
    np.testing.assert_array_equal(x[N_ESTIMATED:], 0.0)


@pytest.mark.parametrize("n_estimated", [N, N_ESTIMATED])
def test_rows_of_an_epoch_may_come_in_any_order(n_estimated):
    """All are linearised at one point: the residual of each is the epoch's, less what earlier rows have moved.

    That holds with considered states too as long as no row contains one, as with parameters of an inertial unit.
    """
    rng = np.random.default_rng(5)
    rows, z, variance = [row(seed) for seed in range(10, 16)], rng.standard_normal(6), rng.uniform(0.1, 2.0, 6)
    H, P0 = np.array([dense for _, dense in rows]), covariance_matrix()
    S = H @ P0 @ H.T + np.diag(variance)
    batch_x, batch_P = P0 @ H.T @ np.linalg.solve(S, z), P0 - P0 @ H.T @ np.linalg.solve(S, H @ P0)
    batch_x[n_estimated:], batch_P[n_estimated:, n_estimated:] = 0.0, P0[n_estimated:, n_estimated:]
    for order in (range(6), reversed(range(6)), rng.permutation(6)):
        P, x, nis = P0.copy(), np.zeros(N), 0.0
        for r in order:
            nis += take(P, x, rows[r][0], z[r], variance[r], n_estimated=n_estimated)[0] ** 2
        # conditioning of S, about 100, times rounding
        np.testing.assert_allclose(x, batch_x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(P, batch_P, rtol=0, atol=1e-12)
        assert nis == pytest.approx(z @ np.linalg.solve(S, z), rel=1e-11)


@pytest.mark.parametrize("joseph", [False, True])
def test_a_row_beyond_the_gate_leaves_everything_as_it_was(joseph):
    P, x = covariance_matrix(), np.zeros(N)
    before = P.copy()
    h, dense = row()
    s = dense @ P @ dense + 0.7
    innovation = 3.001 * np.sqrt(s)
    normalised, weight = take(P, x, h, innovation, gate_squared=9.0, joseph=joseph)
    assert normalised == pytest.approx(3.001, rel=1e-12)
    assert weight == 0.0
    np.testing.assert_array_equal(x, 0.0)
    np.testing.assert_array_equal(P, before)
    assert take(P, x, h, innovation / 3.001 * 2.999, gate_squared=9.0, joseph=joseph)[1] == pytest.approx(1.0 / s)
    assert np.any(x != 0.0)


def test_an_innovation_that_is_not_a_number_is_rejected_by_any_gate():
    P, x = covariance_matrix(), np.zeros(N)
    before = P.copy()
    _, weight = take(P, x, row()[0], np.nan, gate_squared=np.inf)
    assert weight == 0.0
    np.testing.assert_array_equal(x, 0.0)
    np.testing.assert_array_equal(P, before)


@jit
def update_lanes(P, x, K, h, entries, columns, z, variance, gate_squared, n_estimated, joseph, out):
    o, zv = view(out), view(z)
    o[0], o[1] = update_scalar(
        view(P), view(x), view(K), view(h), entries, columns, zv[0], variance, gate_squared, n_estimated, joseph
    )


@pytest.mark.parametrize("joseph", [False, True])
def test_lanes_may_differ_in_what_their_gates_decide(joseph):
    P = np.stack([covariance_matrix(seed=s) for s in range(WIDTH)], axis=-1)
    h = np.stack([row(20 + s)[0] for s in range(WIDTH)], axis=-1)
    z = np.array([[0.1, 50.0, -0.2, 0.3, -80.0, np.nan, 1.0, 0.0]])
    together, x, out = P.copy(), np.zeros((N, WIDTH)), np.empty((2, WIDTH))
    K = np.empty((N, WIDTH))
    update_lanes(together, x, K, h, H_ENTRIES, H_COLUMNS, z, 0.7, 9.0, N_ESTIMATED, joseph, out)
    assert list(out[1] > 0.0) == [True, False, True, True, False, False, True, True]
    for s in range(WIDTH):
        alone, x_alone = P[..., s].copy(), np.zeros(N)
        given = take(alone, x_alone, h[:, s].copy(), z[0, s], 0.7, 9.0, N_ESTIMATED, joseph)
        np.testing.assert_allclose(together[..., s], alone, rtol=0, atol=1e-13)
        np.testing.assert_allclose(x[:, s], x_alone, rtol=0, atol=1e-13)
        np.testing.assert_allclose(out[:, s], given, rtol=1e-12)


@pytest.mark.parametrize("joseph", [False, True])
def test_a_covariance_stays_symmetric_and_positive_through_thousands_of_precise_rows(joseph):
    rng = np.random.default_rng(6)
    P, x = np.diag(np.logspace(-8, 4, N)), np.zeros(N)
    blocks, decay, noise = step_inputs()
    smallest = np.inf
    for k in range(500):
        predict(P, blocks, ROWS, COLUMNS, decay, 1e-6 * noise, CLOCK, SECONDS)
        for _ in range(8):
            take(P, x, rng.standard_normal(10), 0.0, variance=1e-4, joseph=joseph)
        if k % 50 == 0:
            d = 1.0 / np.sqrt(np.diag(P))
            smallest = min(smallest, np.linalg.eigvalsh(P * np.outer(d, d)).min())
    np.testing.assert_array_equal(P, P.T)
    assert smallest > 0.0


@pytest.mark.parametrize("n", [1, 9, 17, 20])
def test_nees_is_the_quadratic_form_of_the_inverse(n):
    P, x = covariance_matrix(), np.random.default_rng(7).standard_normal(N)
    given = normalised_square(P.copy(), np.empty((N, N)), np.empty(N), x, n)
    assert given == pytest.approx(x[:n] @ np.linalg.solve(P[:n, :n], x[:n]), rel=1e-11)


def test_nees_leaves_the_covariance_alone_and_copes_with_a_navigation_filters_scales():
    scale = np.array([1e-4] * 3 + [0.1] * 3 + [10.0] * 3 + [1e-6] * 3 + [1e-2] * 3 + [100.0, 1.0] + [1e-4] * 3)
    P = covariance_matrix() * np.outer(scale, scale)
    before, x = P.copy(), scale * np.random.default_rng(8).standard_normal(N)
    given = normalised_square(P, np.empty((N, N)), np.empty(N), x, N)
    u = x / scale
    assert given == pytest.approx(u @ np.linalg.solve(covariance_matrix(), u), rel=1e-11)
    np.testing.assert_array_equal(P, before)
