import math

import numpy as np
import pytest

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT, clock_step, spectral_densities, step_covariance

TCXO = (2e-21, 3e-24)  # Brown and Hwang, 4th ed., section 9.3, "TCXO high"; Canepa and Servidia, eq. 2.3


def test_the_densities_of_a_clock_in_metres_carry_c_squared():
    bias, drift = spectral_densities(*TCXO)
    assert bias == pytest.approx(1e-21 * 299792458.0**2, rel=1e-12)  # m^2/s: 9.0e-5
    assert drift == pytest.approx(2.0 * math.pi**2 * 3e-24 * 299792458.0**2, rel=1e-12)  # m^2/s^3: 5.3e-6


def test_the_step_covariance_is_the_integral_of_the_driving_noise():
    dt, n = 3.0, 20000
    since = (np.arange(n) + 0.5) * dt / n
    bias, drift = spectral_densities(*TCXO)
    q11, q12, q22 = step_covariance(dt, *TCXO)
    assert q11 == pytest.approx(np.sum(bias + drift * since**2) * dt / n, rel=1e-8)
    assert q12 == pytest.approx(np.sum(drift * since) * dt / n, rel=1e-8)
    assert q22 == pytest.approx(drift * dt, rel=1e-12)


def test_two_half_steps_add_what_one_step_adds():
    q11, q12, q22 = step_covariance(0.5, *TCXO)
    half, move = np.array([[q11, q12], [q12, q22]]), np.array([[1.0, 0.5], [0.0, 1.0]])
    p11, p12, p22 = step_covariance(1.0, *TCXO)
    np.testing.assert_allclose(move @ half @ move.T + half, [[p11, p12], [p12, p22]], rtol=1e-12)


@pytest.mark.parametrize("h", [TCXO, (2e-21, 0.0), (0.0, 3e-24), (0.0, 0.0)])
@pytest.mark.parametrize("dt", [0.0, 0.005, 1.0, 1000.0])
def test_the_factor_of_a_step_multiplies_to_its_covariance(h, dt):
    a11, a21, a22 = clock_step(dt, *h)
    expected = step_covariance(dt, *h)
    assert [a11 * a11, a11 * a21, a21 * a21 + a22 * a22] == pytest.approx(expected, rel=1e-12, abs=0.0)


def test_the_step_covariance_gives_the_allan_variance():
    # The second difference of phase over tau is a21-free: var(x2 - 2 x1 + x0) from two independent steps.
    tau = 10.0
    q11, q12, q22 = step_covariance(tau, *TCXO)
    second_difference = q11 + (q11 + tau**2 * q22 - 2.0 * tau * q12)
    h0, h_minus2 = TCXO  # IEEE Std 1139, conversion of white and random-walk frequency noise
    expected = h0 / (2.0 * tau) + 2.0 * math.pi**2 * h_minus2 * tau / 3.0
    assert second_difference / (2.0 * tau**2 * SPEED_OF_LIGHT**2) == pytest.approx(expected, rel=1e-12)
