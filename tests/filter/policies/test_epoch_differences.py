"""Clones and noises of an epoch, against closed forms."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from lvnav_trade.filter.policies.epoch_differences import (
    DifferenceProcessing,
    clone,
    reset_states,
)
from lvnav_trade.kernels.covariance import update_scalar

N, T, SIGMA = 20, 0.5, 2e-3
POSITION, SPEED, NOISE, EARLIER, EARLIER_NOISE = range(5)
FilterModel = namedtuple("FilterModel", "extra_offset")
ONE = FilterModel(np.array([NOISE]))


def differences(cloned, first, renewed=-1.0, back=False):
    """What a filter of these clones, and one extra state, needs at a single epoch."""
    return DifferenceProcessing(
        np.zeros(3, bool), np.ones((1, 3), bool), 0, np.full((1, 1), renewed), np.array(cloned), first, back
    )  # fmt: skip


def straight(noise_is_state, n=N):
    """Speed of a straight motion from n phase differences: formal and true variance of the estimate.

    The truth is what the gains make of the n + 1 independent errors of phase.
    """
    P, x, K = np.zeros((5, 5)), np.zeros(5), np.zeros(5)
    P[POSITION, POSITION], P[SPEED, SPEED] = 1.0, 1.0
    P[EARLIER_NOISE, EARLIER_NOISE] = SIGMA**2 if noise_is_state else 0.0
    P[EARLIER], P[:, EARLIER] = P[POSITION], P[:, POSITION]
    P[EARLIER, EARLIER] = P[POSITION, POSITION]
    clones = differences([POSITION, NOISE], EARLIER, SIGMA**2 if noise_is_state else 0.0)
    step, h = np.eye(5), np.array([1.0, 0.0, 1.0, -1.0, -1.0])
    step[POSITION, SPEED] = T
    error = np.zeros((5, n + 1))  # of the estimate, by error of phase
    if noise_is_state:
        error[EARLIER_NOISE, 0] = 1.0
    for k in range(1, n + 1):
        P[:] = step @ P @ step.T
        error = step @ error
        reset_states(P, x, np.zeros(1), clones, ONE, 0)
        error[NOISE] = 0.0
        missed = np.zeros(n + 1)
        if noise_is_state:
            error[NOISE, k] = 1.0
        else:
            missed[[k, k - 1]] = 1.0, -1.0
        variance = 0.0 if noise_is_state else 2.0 * SIGMA**2
        _, weight = update_scalar(P, x, K, h, np.arange(5), np.arange(5), 0.0, variance, np.inf, 5, False)
        error = error - np.outer(K * weight, h @ error + missed)
        clone(P, clones)
        error[[EARLIER, EARLIER_NOISE]] = error[[POSITION, NOISE]]
    return P[SPEED, SPEED], SIGMA**2 * np.sum(error[SPEED] ** 2)


def test_differences_taken_for_white_give_the_speed_of_the_first_and_the_last_phase():
    formal, true = straight(noise_is_state=False)
    assert formal == pytest.approx(2.0 * SIGMA**2 / (N * T**2), rel=1e-4)
    # what they have in common cancels: the sum of all differences is the last phase less the first
    assert true == pytest.approx(2.0 * SIGMA**2 / (N * T) ** 2, rel=1e-4)


def test_differences_whose_noise_is_a_state_give_the_straight_line_through_all_phases():
    formal, true = straight(noise_is_state=True)
    assert formal == pytest.approx(12.0 * SIGMA**2 / (N * (N + 1) * (N + 2) * T**2), rel=1e-4)
    assert true == pytest.approx(formal, rel=1e-4)


def test_a_state_that_begins_anew_has_its_variance_and_is_independent():
    P, x, extra = np.ones((5, 5)), np.ones(5), np.ones(1)
    reset_states(P, x, extra, differences([POSITION], EARLIER, 0.25), ONE, 0)
    assert P[NOISE, NOISE] == 0.25
    assert (x[NOISE], extra[0]) == (0.0, 0.0)
    assert np.abs(np.delete(P[NOISE], NOISE)).max() == 0.0
    kept, others = P.copy(), [POSITION, SPEED, EARLIER, EARLIER_NOISE]
    reset_states(P, x, extra, differences([POSITION], EARLIER), ONE, 0)  # none is due
    np.testing.assert_array_equal(P, kept)
    assert np.all(P[np.ix_(others, others)] == 1.0)
