import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT, allan_variance, step_covariance
from lvnav_trade.world.clock import walk
from lvnav_trade.world.receiver.receiver import ClockCard

TCXO = ClockCard(h0=2e-21, h_minus2=3e-24)


@pytest.mark.parametrize("tau", [1, 10, 100])
def test_the_allan_variance_of_the_simulated_clock_lies_in_its_confidence_interval(tau):
    # One second difference of phase per run: independent normal numbers, so their mean square is a chi-square of n_run
    # degrees of freedom, exactly. The clock is stepped at 0.5 s.
    n_run, step = 3000, 0.5
    count = int(2 * tau / step)
    normals = np.random.default_rng(20260801).standard_normal((n_run, count + 1, 2))
    bias, _ = walk(TCXO, step * np.arange(count + 1), normals)
    middle = count // 2
    y = (bias[:, -1] - 2.0 * bias[:, middle] + bias[:, 0]) / (tau * SPEED_OF_LIGHT)
    ratio = np.mean(y * y) / 2.0 / allan_variance(tau, TCXO.h0, TCXO.h_minus2)
    low, high = chi2.ppf([0.0005, 0.9995], n_run) / n_run
    assert low < ratio < high


def test_bias_and_drift_of_the_simulated_clock_have_the_covariance_of_the_step():
    n_run = 40000
    normals = np.random.default_rng(7).standard_normal((n_run, 3, 2))
    bias, drift = walk(TCXO, np.array([0.0, 5.0, 20.0]), normals)  # unequal steps
    q11, q12, q22 = step_covariance(20.0, TCXO.h0, TCXO.h_minus2)
    band = 4.0 * np.sqrt(2.0 / n_run)  # four sigma of a sample variance
    assert np.mean(bias[:, -1] ** 2) == pytest.approx(q11, rel=band)
    assert np.mean(drift[:, -1] ** 2) == pytest.approx(q22, rel=band)
    cross_band = 4.0 * np.sqrt((q11 * q22 + q12**2) / n_run)
    assert np.mean(bias[:, -1] * drift[:, -1]) == pytest.approx(q12, abs=cross_band)


def test_a_clock_without_noise_keeps_its_initial_drift():
    card = ClockCard(h0=0.0, h_minus2=0.0, initial_bias="300 m", initial_drift="2 m/s")
    bias, drift = walk(card, np.array([0.0, 1.0, 4.0]), np.full((3, 2), 0.5))
    np.testing.assert_allclose(bias, [150.0, 151.0, 154.0], rtol=1e-14)
    np.testing.assert_allclose(drift, [1.0, 1.0, 1.0], rtol=1e-14)
