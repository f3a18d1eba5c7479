"""What the joint vector carries behind the filter's error: dense matrices, forwards and backwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.chained import advance, go_back, keep_states, kept_column
from lvnav_trade.engines.solution import Chain
from lvnav_trade.kernels.transition import ATT, POS, VEL

N_NAV, M, N_ALL = 4, 3, 9  # four states of the filter, three of a solution's error, two that are kept


class Carried(NamedTuple):
    """What `advance` takes of the joint state."""

    sources: np.ndarray
    cross: np.ndarray
    shared_cross: np.ndarray
    shared_variance: np.ndarray
    mean: np.ndarray


class Truth(NamedTuple):
    """What it asks of the truth."""

    chain: int
    chain_source: np.ndarray
    shared_source: np.ndarray


class Back(NamedTuple):
    """What `go_back` takes."""

    e: np.ndarray
    shared: np.ndarray
    contribution: np.ndarray


def setting():
    """Two sources and two shared components of the second one, with a full covariance of everything with everything."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((N_ALL + 2, 20))
    full = root @ root.T
    chain = Chain(
        rng.standard_normal((1, M, M)), rng.standard_normal((1, M, 2)), np.array([[0.5, 2.0]]), np.array([0, 1]),
        rng.standard_normal((1, M, 2)), rng.standard_normal((1, M)), np.arange(6), np.zeros((1, 6, 6)),
        np.ones(1, dtype=bool), np.zeros((1, 6)),
    )  # fmt: skip
    true = Truth(N_NAV, np.array([0, 1]), np.array([1, 1]))
    full[N_ALL, N_ALL + 1] = full[N_ALL + 1, N_ALL] = 0.0  # components are independent of each other
    joint = Carried(
        np.stack([np.eye(N_ALL), full[:N_ALL, :N_ALL]]), np.zeros((0, 3, N_ALL)), full[N_ALL:, :N_ALL].copy(),
        np.diag(full)[N_ALL:].copy(), rng.standard_normal(N_ALL),
    )  # fmt: skip
    return chain, true, joint, full


def dense(chain):
    """The same step in one matrix of the joint vector and the two components."""
    step = np.eye(N_ALL + 2)
    s = slice(N_NAV, N_NAV + M)
    step[s, s], step[s, N_ALL:] = chain.move[0], chain.shared[0]
    return step, chain.white[0]


def test_a_solutions_error_goes_on_as_in_dense_matrices():
    chain, true, joint, full = setting()
    step, white = dense(chain)
    mean = step[:N_ALL, :N_ALL] @ joint.mean
    mean[N_NAV : N_NAV + M] += chain.push[0]
    advance(joint, np.zeros(N_ALL), chain, true, 0)
    expected = step @ full @ step.T
    s = slice(N_NAV, N_NAV + M)
    expected[s, s] += 2.0 * np.outer(white[:, 1], white[:, 1])
    np.testing.assert_allclose(joint.sources[1], expected[:N_ALL, :N_ALL], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(joint.shared_cross, expected[N_ALL:, :N_ALL], rtol=1e-12, atol=1e-12)
    other = step[:N_ALL, :N_ALL] @ step[:N_ALL, :N_ALL].T
    other[s, s] += 0.5 * np.outer(white[:, 0], white[:, 0])
    np.testing.assert_allclose(joint.sources[0], other, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(joint.mean, mean, rtol=1e-12)


def test_backwards_multipliers_see_what_goes_in_forwards():
    chain, true, _, _ = setting()
    step, white = dense(chain)
    rows = np.random.default_rng(5).standard_normal((2, N_ALL))
    back = Back(rows.copy(), np.zeros((2, 2)), np.zeros((2, 2, 1)))
    go_back(back, np.zeros(N_ALL), chain, true, 0, 0)
    before = np.hstack([rows, np.zeros((2, 2))]) @ step
    np.testing.assert_allclose(back.e, before[:, :N_ALL], rtol=1e-12)
    np.testing.assert_allclose(back.shared, before[:, N_ALL:], rtol=1e-12)
    through = rows[:, N_NAV : N_NAV + M] @ white
    np.testing.assert_allclose(back.contribution[:, :, 0], through**2 * chain.variance[0], rtol=1e-12)


def test_what_is_kept_is_a_copy_with_all_its_correlations():
    _, _, joint, full = setting()
    mean = joint.mean.copy()
    keep_states(joint, 7, 1, 2)
    copy = np.eye(N_ALL + 2)
    copy[7:9] = 0.0
    copy[7, 1] = copy[8, 2] = 1.0
    expected = copy @ full @ copy.T
    np.testing.assert_allclose(joint.sources[1], expected[:N_ALL, :N_ALL])
    np.testing.assert_allclose(joint.shared_cross, expected[N_ALL:, :N_ALL])
    np.testing.assert_allclose(joint.mean, copy[:N_ALL, :N_ALL] @ mean)


def test_only_navigation_errors_of_a_buffered_measurement_are_those_of_its_time():
    assert [kept_column(c, 40, buffered=True) for c in (ATT, VEL, POS + 2, 9, 16)] == [40, 43, 48, 9, 16]
    assert [kept_column(c, 40, buffered=False) for c in (ATT, POS)] == [ATT, POS]
