"""True covariance by source against dense matrices and the stored baselines of NASA's Orbit Determination Toolbox."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import (
    apply_phi,
    apply_phi_transposed,
    predict,
    update_covariance,
    update_scalar,
    update_vector,
)
from lvnav_trade.kernels.jit import array_jit

NONE = np.zeros(0, dtype=np.int64)


def product(n, rows, columns, blocks):
    """Return what blocks do one after the other, (n, n)."""
    phi = np.eye(n)
    for r, c, block in zip(rows, columns, blocks, strict=True):
        step = np.eye(n)
        step[r : r + 3, c : c + 3] += block.reshape(3, 3)
        phi = step @ phi
    return phi


def test_a_vector_is_multiplied_by_phi_and_by_its_transpose():
    rng = np.random.default_rng(1)
    n, clock, seconds = 14, 12, 0.3
    rows, columns, blocks = np.array([6, 3, 3, 0]), np.array([3, 3, 0, 9]), rng.standard_normal((4, 9))
    decay, y = np.concatenate([np.ones(9), [0.5, 0.6, 0.7], [1.0, 1.0]]), rng.standard_normal(n)
    phi = np.diag(decay) @ product(n, rows, columns, blocks)
    phi[clock, clock + 1] = seconds
    expected, back = phi @ y, phi.T @ y
    z = y.copy()
    apply_phi(y, blocks, rows, columns, decay, clock, seconds)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-13)
    apply_phi_transposed(z, blocks, rows, columns, decay, clock, seconds)
    np.testing.assert_allclose(z, back, rtol=0, atol=1e-13)


def test_the_true_update_is_josephs_form_for_any_gain():
    rng = np.random.default_rng(3)
    n, columns, entries = 12, np.array([2, 5, 11]), np.array([0, 4, 9])
    root, gain, h, y = rng.standard_normal((n, n)), *(rng.standard_normal(size) for size in (n, 10, n))
    P, dense = root @ root.T, np.zeros(n)
    dense[columns] = h[entries]
    A = np.eye(n) - np.outer(gain, dense)
    expected, spread = A @ P @ A.T + 0.4 * np.outer(gain, gain), dense @ P @ dense
    moved, projected = A @ y, dense @ y
    assert update_covariance(P, np.empty(n), gain, h, entries, columns, 0.4) == pytest.approx(spread, rel=1e-13)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-12)
    assert update_vector(y, gain, h, entries, columns) == pytest.approx(projected, rel=1e-13)
    np.testing.assert_allclose(y, moved, rtol=0, atol=1e-13)


# ---------------------------------------------------------------------------------- the three stored baselines of ODTBX


@array_jit
def take_rows(formal, sources, h, entries, columns, variance, true_variance, noise_source, n_estimated):
    """Process rows in the formal covariance, and with their gains in every source; `sources` (n_source, n, n)."""
    n = formal.shape[0]
    K, x, gain, work = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for row in range(h.shape[0]):
        _, weight = update_scalar(formal, x, K, h[row], entries, columns[row], 0.0, variance, np.inf, n_estimated, True)
        for i in range(n):
            gain[i] = K[i] * weight if i < n_estimated else 0.0
        for s in range(sources.shape[0]):
            noise = true_variance if s == noise_source else 0.0
            update_covariance(sources[s], work, gain, h[row], entries, columns[row], noise)


@array_jit
def advance(P, blocks, rows, columns, noise, clock, seconds, n_step):
    """Propagate in many short steps: noise enters a step half before and half after, exact as the steps shrink."""
    n = P.shape[0]
    decay = np.ones(n)
    for _ in range(n_step):
        predict(P, blocks, rows, columns, decay, noise, clock, seconds)


def test_a_random_walk_that_the_filter_takes_for_a_constant_grows_as_in_odtbx_case_1():
    """Exercised: process, predict, update_covariance by source (start, measurement noise, process noise)."""
    n, no_blocks = 9, np.zeros((0, 9))
    formal, sources = np.zeros((n, n)), np.zeros((3, n, n))
    formal[0, 0] = sources[0, 0, 0] = 10.0
    walk = np.zeros(n)
    walk[0] = 1.0
    h, entries, columns = np.ones((1, 10)), np.array([0]), np.array([[0]])
    truth, accepted = [], []
    for epoch in range(5):
        if epoch:
            advance(sources[2], no_blocks, NONE, NONE, walk, -1, 1.0, 1)
        take_rows(formal, sources, h, entries, columns, 1.0, 1.0, 1, n)
        truth.append(sources[:, 0, 0].sum())
        accepted.append(formal[0, 0])
    # half a unit of the sixth printed digit
    np.testing.assert_allclose(truth, [0.909091, 0.750567, 0.907388, 1.149911, 1.427912], rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(accepted, [0.909091, 0.476190, 0.322581, 0.243902, 0.196078], rtol=0, atol=5.1e-7)
    np.testing.assert_allclose(sources[:, 0, 0], [0.003845, 0.192234, 1.231834], rtol=0, atol=5.1e-7)


def rational_case_1():
    """Return true and formal variance after each update of case 1 by the textbook recursion in exact fractions."""
    true, formal, found = Fraction(10), Fraction(10), []
    for epoch in range(5):
        true += 1 if epoch else 0
        gain = formal / (formal + 1)
        true, formal = (1 - gain) ** 2 * true + gain**2, (1 - gain) ** 2 * formal + gain**2
        found.append((float(true), float(formal)))
    return np.array(found).T


def test_case_1_agrees_with_exact_fractions_to_1e_10():
    n = 9
    formal, sources = np.zeros((n, n)), np.zeros((3, n, n))
    formal[0, 0] = sources[0, 0, 0] = 10.0
    walk = np.zeros(n)
    walk[0] = 1.0
    h, entries, columns = np.ones((1, 10)), np.array([0]), np.array([[0]])
    found = []
    for epoch in range(5):
        if epoch:
            advance(sources[2], np.zeros((0, 9)), NONE, NONE, walk, -1, 1.0, 1)
        take_rows(formal, sources, h, entries, columns, 1.0, 1.0, 1, n)
        found.append((sources[:, 0, 0].sum(), formal[0, 0]))
    np.testing.assert_allclose(np.array(found).T, rational_case_1(), rtol=0, atol=1e-10)


BIAS, RATE, N_CLOCKED = 9, 10, 11
POSITION_OF_VELOCITY = (np.array([6]), np.array([3]))
STEPS = 1000  # of a second; the noise entering in halves leaves q h^2 / 6 per second, 2e-9 of 1e-2


def three_axis_case(n_estimated, formal_start, formal_noise):
    """Position and velocity on three axes, y = position - b, b a drifting bias: the clock of this code, negative.

    The three measurements are turned so that one of them alone sees b: scalar rows with considered states in them equal
    the joint update only then.
    """
    h, turn = np.zeros((3, 10)), np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]])
    h[:, :3] = turn / np.linalg.norm(turn, axis=1)[:, None]
    h[0, 9] = -np.sqrt(3.0)
    columns = np.tile([6, 7, 8, BIAS], (3, 1))
    formal, sources = np.diag(formal_start), np.zeros((2, N_CLOCKED, N_CLOCKED))
    sources[0] = np.diag([0.0] * 3 + [1.0] * 6 + [2.0, 2.0])
    true_noise = np.array([0.0] * 3 + [1e-6] * 3 + [0.0] * 4 + [1e-6])
    step = 1.0 / STEPS
    block = step * np.eye(3).reshape(1, 9)
    for epoch in range(30):
        if epoch:
            advance(formal, block, *POSITION_OF_VELOCITY, step * formal_noise, BIAS, step, STEPS)
            advance(sources[0], block, *POSITION_OF_VELOCITY, step * true_noise, BIAS, step, STEPS)
            advance(sources[1], block, *POSITION_OF_VELOCITY, np.zeros(N_CLOCKED), BIAS, step, STEPS)
        take_rows(formal, sources, h, np.array([0, 1, 2, 9]), columns, 1e4, 1.0, 1, n_estimated)
    return formal, sources.sum(axis=0)


def test_a_bias_that_the_filter_ignores_grows_as_in_odtbx_case_2():
    """Exercised: as case 1, and the blocks and the clock of `predict`; the filter's own covariance knows no bias."""
    start = np.array([0.0] * 3 + [2.0] * 6 + [0.0] * 2)
    noise = np.array([0.0] * 3 + [1e-2] * 3 + [0.0] * 5)
    formal, true = three_axis_case(N_CLOCKED, start, noise)
    np.testing.assert_allclose(np.diag(true)[6:9], 803.667704, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.diag(true)[3:6], 0.971987949, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diag(true)[[BIAS, RATE]], [1684.00813, 2.000029], rtol=0, atol=6e-6)
    np.testing.assert_allclose(np.diag(formal)[6:9], 639.061272, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.diag(formal)[3:6], 0.916216, rtol=0, atol=6e-7)


def test_a_bias_that_the_filter_considers_behaves_as_in_odtbx_case_3():
    """Exercised: as case 2, with bias and rate as considered (Schmidt) states of `update_scalar`."""
    start = np.array([0.0] * 3 + [2.0] * 8)
    noise = np.array([0.0] * 3 + [1e-2] * 3 + [0.0] * 4 + [1e-2])
    formal, true = three_axis_case(BIAS, start, noise)
    np.testing.assert_allclose(np.diag(true)[6:9], 349.578873, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.diag(true)[3:6], 0.416260024, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diag(formal)[6:9], 924.236578, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.diag(formal)[3:6], 1.26545684, rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.diag(formal)[[BIAS, RATE]], [1765.29667, 2.29], rtol=0, atol=6e-6)
