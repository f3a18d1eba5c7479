"""Pseudorange by figures that can be checked in the head; derivative and noise are in the family's contract."""

from __future__ import annotations

import numpy as np

from lvnav_trade.observables.base import H_CLOCK, H_POS, N_ENTRY
from lvnav_trade.observables.pseudorange import observe, row


def test_a_satellite_overhead_sees_height_and_clock_with_opposite_signs():
    # 3-4-5: the satellite is 5 m away; moving towards it by 1 m shortens the range by 1 m
    h = np.full(N_ENTRY, np.nan)
    assert row(h, np.zeros(21), 0.6, 0.8, 0.0, 5.0, 100.0) == 105.0
    np.testing.assert_array_equal(h[H_POS : H_POS + 3], [-0.6, -0.8, -0.0])
    assert h[H_CLOCK] == 1.0


def test_clock_bias_and_noise_are_added_to_the_range():
    assert observe(2e7, 300.0, 2.0, -1.5) == 2e7 + 297.0
