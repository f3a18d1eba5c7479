"""Corrections of a filter card are taken off the ranges before a receiver solves them for a loose filter."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.transition import POS
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import case

KLOBUCHAR = (
    "{kind: klobuchar, alpha: [1.4901e-8, 2.2352e-8, -1.1921e-7, -1.1921e-7], "
    "beta: [1.1059e+5, 1.6384e+5, -6.5536e+4, -5.8982e+5]}"
)
LOOSE = (
    "base.filter=filters/loose_conae_000",
    "base.receiver.solution={kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s, reported: true}",
)
TRUE = f"base.atmosphere.ionosphere={KLOBUCHAR}"


def _position(*settings: str) -> np.ndarray:
    return run_block(case(*LOOSE, *settings), 20261120, 0, 8).err[:, :, POS : POS + 3]


@pytest.fixture(scope="module")
def clear() -> np.ndarray:
    return _position()


def test_the_true_model_as_correction_leaves_a_solved_receiver_as_if_there_were_no_ionosphere(clear):
    corrected = _position(TRUE, "base.filter.corrections.ionosphere={kind: matched}")
    np.testing.assert_allclose(corrected, clear, atol=1e-4)


def test_the_broadcast_model_takes_its_own_delay_off_and_none_leaves_metres(clear):
    broadcast = _position(TRUE, f"base.filter.corrections.ionosphere={KLOBUCHAR}")
    np.testing.assert_allclose(broadcast, clear, atol=1e-4)
    assert np.abs(_position(TRUE) - clear).max() > 1.0
