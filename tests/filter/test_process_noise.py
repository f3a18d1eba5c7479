"""Process noise that a filter card adds to attitude, velocity and position (eq. 7.2 to 7.6 of Canepa and Servidia)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.filter import model as room
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import predict
from lvnav_trade.kernels.transition import POS
from tests.building import ascent
from tests.filter.test_model import accepted

SIGMA, NOISE = 2.0, 10.0  # m of a position, m/sqrt(s)


def _steady(variance: float, step: float) -> float:
    """Variance after an update of a random walk that gains `step` between two measurements of `variance`."""
    return 0.5 * (math.sqrt(step**2 + 4.0 * step * variance) - step)


def test_position_noise_stands_beside_the_noise_of_velocity():
    _, quiet = accepted()
    _, noisy = accepted(position_noise="3 m/sqrt(s)")
    added = noisy.noise - quiet.noise
    np.testing.assert_allclose(added[1, POS : POS + 3], 0.1 * 9.0)
    added[1, POS : POS + 3] = 0.0
    np.testing.assert_array_equal(added, 0.0)


def test_position_moves_by_its_own_noise_and_by_the_integral_of_velocitys():
    # closed form of dp = v dt + q dW1, dv = s dW2 from rest: q^2 t + s^2 t^3 / 3
    own, speed, seconds, count = 3.0, 0.5, 0.01, 1000
    rows, columns, kinds, _ = room.transition_blocks((), 1)
    of_position = kinds == transition.POS_VEL
    blocks = np.zeros((1, 9))
    blocks[0, [0, 4, 8]] = seconds
    noise = np.repeat([0.0, speed**2 * seconds, own**2 * seconds], 3)
    P = np.zeros((9, 9))
    for _ in range(count):
        predict(P, blocks, rows[of_position], columns[of_position], np.ones(9), noise, -1, seconds)
    t = count * seconds
    assert P[POS, POS] == pytest.approx(own**2 * t + speed**2 * t**3 / 3.0, rel=1e-5)


def test_the_formal_sigma_of_position_is_the_steady_state_of_a_random_walk():
    # so much noise that only the last fix counts: fixes of 2 m once a second, 10 m/sqrt(s) between them
    case = ascent(
        "base.imu=imu/conae_000",
        "base.filter=filters/loose_conae_000",
        "base.receiver=receivers/l1_precise_solution",
        f"base.receiver.solution.position_sigma={SIGMA} m",
        f"base.filter.position_noise={NOISE} m/sqrt(s)",
    )
    history = covariance(case)
    updated = np.isin(history.t, case.t_epoch[5:])
    assert updated.sum() > 500
    formal = history.formal_sigma[updated, POS : POS + 3]
    np.testing.assert_allclose(formal, math.sqrt(_steady(SIGMA**2, NOISE**2)), rtol=1e-3)
