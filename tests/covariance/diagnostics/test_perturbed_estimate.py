"""An estimate that is in error by a known vector."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import increments, navigation_at, tick_at
from lvnav_trade.kernels.attitude import small_rotation
from tests.building import MATCHED, case


def test_it_is_the_truth_less_the_error():
    prepared_case = case(MATCHED)
    d = np.zeros(prepared_case.layout.n_state)
    d[:9] = [1e-3, -2e-3, 3e-3, 0.1, -0.2, 0.3, 10.0, 20.0, -30.0]
    tick, truth = tick_at(prepared_case, 10.0), prepared_case.reference
    nav = navigation_at(prepared_case, tick, d)
    assert truth.t[tick] == 10.0
    np.testing.assert_allclose(small_rotation(*truth.q_b_i[tick], *nav[:4]), d[:3], atol=1e-12)
    np.testing.assert_allclose(truth.v_i[tick] - nav[4:7], d[3:6], atol=1e-11)
    np.testing.assert_allclose(truth.r_i[tick] - nav[7:10], d[6:9], atol=1e-8)


def test_an_error_of_a_bias_stays_in_the_increments():
    prepared_case = case(MATCHED)
    d = np.zeros(prepared_case.layout.n_state)
    d[9:15] = [1e-5, 0.0, -1e-5, 1e-2, 2e-2, 0.0]
    left = increments(prepared_case, 100, 4, d) - increments(prepared_case, 100, 4, 0.0 * d)
    np.testing.assert_allclose(left, np.tile(prepared_case.unit.dt * d[9:15], (4, 1)), atol=1e-15)
