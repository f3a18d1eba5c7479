"""A measurement of the nominal flight: the gain that is given is the gain that is taken, in every covariance."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from lvnav_trade.kernels.covariance import update_scalar, update_with_gain
from tests.covariance.small import of_lanes, small, update

N = 5
ROW = np.array([0.5, 0.0, -1.0, 0.0, 0.2])
ALL = np.arange(N)


def spread():
    root = np.random.default_rng(3).standard_normal((N, N))
    return root @ root.T


def test_with_the_covariance_s_own_gain_a_row_is_processed_as_ever():
    P, other = spread(), spread()
    x, y, K = np.zeros(N), np.zeros(N), np.zeros(N)
    normalised, weight = update_scalar(P, x, K, ROW, ALL, ALL, 1.3, 0.7, np.inf, N, False)
    gain = K * weight
    same = update_with_gain(other, y, K, ROW, ALL, ALL, gain, 1.3, 0.7, np.inf, N)
    assert same == pytest.approx((normalised, weight), rel=1e-12)
    np.testing.assert_allclose(other, P, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(y, x, rtol=1e-12)


def test_with_another_gain_the_covariance_is_that_of_joseph_s_form():
    P, x, K = spread(), np.zeros(N), np.zeros(N)
    gain = np.array([0.1, -0.2, 0.05, 0.3, 0.0])
    update_with_gain(P, x, K, ROW, ALL, ALL, gain, 1.3, 0.7, np.inf, N)
    left = np.eye(N) - np.outer(gain, ROW)
    np.testing.assert_allclose(P, left @ spread() @ left.T + 0.7 * np.outer(gain, gain), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(x, 1.3 * gain)


def test_a_row_beyond_the_gate_changes_nothing():
    P, x, K = spread(), np.zeros(N), np.zeros(N)
    _, weight = update_with_gain(P, x, K, ROW, ALL, ALL, np.ones(N), 1e6, 0.7, 9.0, N)
    assert weight == 0.0
    np.testing.assert_array_equal(P, spread())
    np.testing.assert_array_equal(x, 0.0)


Signals = namedtuple("Signals", "correlated_errors partial n_receiver shift")
Shared = namedtuple("Shared", "member partial extra")


@pytest.mark.parametrize("n_source", [3, 11])
def test_every_source_has_its_own_joseph_form_and_one_the_noise(n_source):
    """More than eight sources: more than one group of lanes."""
    rng, gain = np.random.default_rng(4), np.array([0.1, -0.2, 0.05, 0.3, 0.0])
    roots = rng.standard_normal((n_source, N, N))
    starts, none = roots @ np.swapaxes(roots, 1, 2), np.zeros(n_source)
    joint, scratch, true, _ = small(
        starts, none, factor=none + 1.0, noise=none, decay=np.ones(N), white=np.zeros((n_source, N)),
        blocks=np.zeros((0, 9)), rows=ALL[:0], columns=ALL[:0], seconds=0.1,
    )  # fmt: skip
    y = rng.standard_normal(N)
    of_lanes(joint.cross, 1)[0] = y
    total = update(joint, scratch, true, gain, ROW, ALL, ALL, n_source - 1, 0.7)
    left = np.eye(N) - np.outer(gain, ROW)
    for source, start in enumerate(starts):
        noise = 0.7 if source == n_source - 1 else 0.0
        expected = left @ start @ left.T + noise * np.outer(gain, gain)
        np.testing.assert_allclose(of_lanes(joint.sources, source), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(of_lanes(joint.cross, 1)[0], left @ y, rtol=1e-12)
    assert total == pytest.approx(ROW @ starts.sum(axis=0) @ ROW + 0.7, rel=1e-12)


def test_an_error_that_measurements_share_enters_as_in_the_dense_joint_covariance():
    """[e; c] with the innovation h e + a c + v."""
    rng, gain, a = np.random.default_rng(5), np.array([0.1, -0.2, 0.05, 0.3, 0.0]), 1.7
    root = rng.standard_normal((N + 1, N + 1))
    full = root @ root.T
    joint, scratch, true, _ = small(
        np.stack([np.eye(N), full[:N, :N]]), [1.0, full[N, N]], factor=np.ones(2), noise=np.zeros(2), decay=np.ones(N),
        white=np.zeros((2, N)), blocks=np.zeros((0, 9)), rows=ALL[:0], columns=ALL[:0], seconds=0.1,
        first_correlated=1, modelling_block=np.array([-1]),
    )  # fmt: skip
    of_lanes(joint.cross, 1)[0] = full[:N, N]
    signals = Signals(
        Shared(np.zeros((1, 1), dtype=np.int64), np.full((1, 1, 1), a), np.array([-1])), np.zeros((0, 1, 1)), 6, 0
    )
    total = update(joint, scratch, true, gain, ROW, ALL, ALL, 1, 0.7, signals)
    row, gains = np.append(ROW, a), np.append(gain, 0.0)
    left = np.eye(N + 1) - np.outer(gains, row)
    expected = left @ full @ left.T + 0.7 * np.outer(gains, gains)
    np.testing.assert_allclose(of_lanes(joint.sources, 1), expected[:N, :N], rtol=0, atol=1e-12)
    np.testing.assert_allclose(of_lanes(joint.cross, 1)[0], expected[:N, N], rtol=0, atol=1e-12)
    assert total == pytest.approx(row @ full @ row + 0.7 + ROW @ ROW, rel=1e-12)
