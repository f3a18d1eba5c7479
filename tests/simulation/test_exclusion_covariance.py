"""Covariance after an exclusion, in closed form: the mean of two of three like IMUs."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.transition import ATT, CONSTANT, GYRO
from lvnav_trade.simulation.exclusion_covariance import grow
from tests.simulation.test_imu_redundancy import three


def test_the_covariance_grows_by_the_noise_and_the_change_of_bias_of_the_mean_of_two_in_place_of_three():
    """White noise by N^2 (1/2 - 1/3) t; the bias by s^2 (2 (1/2 - 1/3)^2 + 1/9), and by its walk as white noise."""
    prepared_case = three(parity={})
    model, units = prepared_case.model, prepared_case.options.imu_array
    redundancy, seconds = units.redundant, 2.0
    before = redundancy.mean[0]
    solved = np.where(np.arange(3)[:, None, None, None] < 2, 1.5 * before, 0.0)
    P = np.zeros((model.n_state, model.n_state))
    grow(P, solved, before, 1.0, units.n_axis, redundancy, model, seconds)
    noise, spread, walk = (table[GYRO, 0] for table in (redundancy.noise, redundancy.spread, redundancy.walk))
    np.testing.assert_allclose(np.diag(P)[ATT : ATT + 3], noise * seconds / 6.0, rtol=1e-9)
    is_bias = (model.par_driver == CONSTANT) & (model.par_sensor == GYRO)
    first = model.par_offset[is_bias][0]
    np.testing.assert_allclose(np.diag(P)[first : first + 3], spread / 6.0 + walk * seconds / 6.0, rtol=1e-9)
