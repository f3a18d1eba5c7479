"""A one-dimensional INS/GNSS toy: true covariance by source against 40 000 runs, and what a dropped mismatch costs.

Boost, coast, boost over 300 s. The filter neglects the scale factor and the bias of the fixes, and assumes that the
bias of the accelerometer decays with 10 000 s where it does with 50 s.
"""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.kernels.covariance import predict, update_scalar
from lvnav_trade.kernels.transition import POS, VEL
from tests.covariance.small import of_lanes, propagate, small, update

RUNS, DT, N, BIAS = 40_000, 1.0, 12, 9
FORCE = np.where((np.arange(300) < 100) | (np.arange(300) >= 200), 30.0, 0.0)  # m/s^2
SIGMA_BIAS, TRUE_TIME, MODEL_TIME = 5e-3, 50.0, 1e4
SCALE, WALK, FIX, FIX_BIAS, START_VEL, START_POS = 1e-3, 2e-3, 3.0, 2.0, 0.1, 5.0
ROWS, COLUMNS = np.array([POS, VEL, POS]), np.array([VEL, BIAS, VEL])
BLOCKS = np.array([scale * np.eye(3).ravel() for scale in (0.5 * DT, -DT, 0.5 * DT)])
DECAY, DECAY_HAT = np.exp(-DT / TRUE_TIME), np.exp(-DT / MODEL_TIME)
DRIFT = SIGMA_BIAS**2 * (1.0 - DECAY**2)
ENTRIES, STATES = np.array([0]), np.array([POS])
SOURCES = ("bias", "scale factor", "velocity random walk", "fix bias", "fix noise", "start")
BIASED, SCALED, WALKED, FIXED, NOISY, STARTED = range(len(SOURCES))
# As much of the engine's records as the shared error of a fix needs.
Fixes = namedtuple("Fixes", "correlated_errors partial n_receiver shift")
Shares = namedtuple("Shares", "member partial extra")
X = np.array([VEL, POS, BIAS])  # the states of the one axis that counts


def noise_of(bias, walk):
    """Noise of each state over a window; the filter's bias is held at its assumed sigma."""
    noise = np.zeros(N)
    noise[VEL : VEL + 3], noise[BIAS : BIAS + 3] = walk**2 * DT, bias
    return noise


def start():
    P = np.zeros((N, N))
    for at, sigma in ((0, 1.0), (VEL, START_VEL), (POS, START_POS), (BIAS, SIGMA_BIAS)):
        P[range(at, at + 3), range(at, at + 3)] = sigma**2
    return P


def gains():
    """The filter's own pass: gains (300, N) and formal variances (300, N)."""
    P, K, x = start(), np.zeros(N), np.zeros(N)
    decay = np.ones(N)
    decay[BIAS:] = DECAY_HAT
    noise = noise_of(2.0 * SIGMA_BIAS**2 * np.tanh(DT / MODEL_TIME), WALK)
    found, formal = [], []
    for _ in FORCE:
        predict(P, BLOCKS, ROWS, COLUMNS, decay, noise, -1, DT)
        _, weight = update_scalar(P, x, K, np.ones(1), ENTRIES, STATES, 0.0, FIX**2, np.inf, N, False)
        found.append(K * weight)
        formal.append(np.diag(P).copy())
    return np.array(found), np.array(formal)


def linear(gain, mismatch=True):
    """True variances by source, (300, n_source, N), through the joint recursion; if asked without the mismatch."""
    n_source = len(SOURCES)
    P, variance, factors, noise = (
        np.zeros((n_source, N, N)),
        np.zeros(n_source),
        np.ones(n_source),
        np.zeros(n_source),
    )
    P[BIASED, BIAS, BIAS] = SIGMA_BIAS**2
    P[STARTED, VEL, VEL], P[STARTED, POS, POS] = START_VEL**2, START_POS**2
    variance[[BIASED, SCALED, FIXED]] = SIGMA_BIAS**2, SCALE**2, FIX_BIAS**2
    factors[BIASED], noise[BIASED] = DECAY if mismatch else DECAY_HAT, DRIFT
    decay, white = np.ones(N), np.zeros((n_source, N))
    decay[BIAS:], white[WALKED, VEL] = DECAY_HAT, WALK**2 * DT
    joint, scratch, true, model = small(
        P, variance, factor=factors, noise=noise, decay=decay, white=white, blocks=BLOCKS, rows=ROWS,
        columns=COLUMNS, seconds=DT, states=np.array([BIAS]),
        state_from=(np.arange(n_source + 1) > BIASED).astype(np.int64), first_correlated=FIXED,
        modelling_block=np.array([-1]),
    )  # fmt: skip
    of_lanes(joint.cross, BIASED)[0, BIAS] = SIGMA_BIAS**2
    signals = Fixes(
        Shares(np.zeros((1, 1), dtype=np.int64), np.ones((1, 1, 1)), np.array([-1])), np.zeros((0, 1, 1)), 6, 0
    )
    out = []
    for force, k in zip(FORCE, gain, strict=True):
        of_lanes(scratch.b, SCALED)[0, [VEL, POS]] = -force * DT, -0.5 * force * DT**2
        propagate(joint, scratch, true, model)
        update(joint, scratch, true, k, np.ones(1), ENTRIES, STATES, NOISY, FIX**2, signals)
        out.append([np.diag(of_lanes(joint.sources, source)).copy() for source in range(n_source)])
    return np.array(out)


def mean_squares(gain):
    """Mean squares (300, 3) of the errors of velocity, position and bias over runs with the same gains."""
    rng = np.random.default_rng(20261121)
    bias, scale, fixed = (s * rng.standard_normal(RUNS) for s in (SIGMA_BIAS, SCALE, FIX_BIAS))
    v, p, estimate = START_VEL * rng.standard_normal(RUNS), START_POS * rng.standard_normal(RUNS), np.zeros(RUNS)
    out = []
    for force, k in zip(FORCE, gain, strict=True):
        felt = bias - estimate + scale * force
        # half of the walk before the window and half after, as the transition of a window has it
        v = v + WALK * np.sqrt(0.5 * DT) * rng.standard_normal(RUNS)
        p, v = p + DT * v - 0.5 * DT**2 * felt, v - DT * felt
        v = v + WALK * np.sqrt(0.5 * DT) * rng.standard_normal(RUNS)
        bias = DECAY * bias + np.sqrt(DRIFT) * rng.standard_normal(RUNS)
        estimate = DECAY_HAT * estimate
        innovation = p + fixed + FIX * rng.standard_normal(RUNS)
        v, p, estimate = v - k[VEL] * innovation, p - k[POS] * innovation, estimate + k[BIAS] * innovation
        out.append([np.mean(error**2) for error in (v, p, bias - estimate)])
    return np.array(out)


@pytest.fixture(scope="module")
def toy():
    gain, formal = gains()
    return gain, formal, linear(gain)


def test_true_covariance_agrees_with_40000_runs_at_every_epoch(toy):
    gain, _, by_source = toy
    true = by_source.sum(axis=1)[20:, X]
    ratio = mean_squares(gain)[20:] / true
    tail = 1e-3 / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS) / RUNS
    assert np.all((ratio > low) & (ratio < high)), (ratio.min(axis=0), ratio.max(axis=0))


def test_the_filter_is_optimistic_by_a_large_factor(toy):
    _, formal, by_source = toy
    factor = np.sqrt(by_source[-1].sum(axis=0)[X] / formal[-1, X])
    assert factor.min() > 2.0


def test_every_source_has_its_share_and_none_is_negative(toy):
    share = toy[2][-1][:, VEL] / toy[2][-1][:, VEL].sum()
    assert share.min() >= 0.0
    named = dict(zip(SOURCES, share, strict=True))
    assert min(named["bias"], named["scale factor"]) > 0.01


def test_without_the_mismatch_of_the_time_constant_the_answer_is_wrong_and_on_the_large_side(toy):
    gain, _, by_source = toy
    dropped = linear(gain, mismatch=False)[-1].sum(axis=0)[X]
    ratio = np.sqrt(dropped / by_source[-1].sum(axis=0)[X])
    assert ratio[0] > 1.03  # ten times what 40 000 runs leave open
