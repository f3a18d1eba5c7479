"""Range rate by figures that can be checked in the head; derivative and noise are in the family's contract."""

from __future__ import annotations

import numpy as np

from lvnav_trade.observables.base import H_CLOCK, H_POS, H_VEL, N_ENTRY
from lvnav_trade.observables.doppler import observe, row


def test_flying_towards_a_satellite_gives_a_negative_rate():
    h, at = np.full(N_ENTRY, np.nan), np.zeros(21)
    at[3] = 7000.0  # antenna velocity along x, the satellite is ahead at rest, the clock drifts by 3 m/s
    assert row(h, at, np.zeros(3), 1.0, 0.0, 0.0, 1e6, 3.0) == -6997.0
    np.testing.assert_array_equal(h[H_VEL : H_VEL + 3], [-1.0, -0.0, -0.0])
    assert h[H_CLOCK] == 1.0


def test_passing_a_satellite_abeam_changes_the_rate_by_the_angle_that_is_flown():
    # 7000 m/s across a line of 1e6 m: a metre further on, the rate has grown by 7000 / 1e6
    h, at = np.full(N_ENTRY, np.nan), np.zeros(21)
    at[3] = 7000.0
    assert row(h, at, np.zeros(3), 0.0, 1.0, 0.0, 1e6, 0.0) == 0.0
    np.testing.assert_allclose(h[H_POS : H_POS + 3], [7e-3, 0.0, 0.0], rtol=1e-15)


def test_drift_and_noise_are_added_to_the_rate():
    assert observe(-700.0, 3.0, 0.1, 2.0) == -696.8
