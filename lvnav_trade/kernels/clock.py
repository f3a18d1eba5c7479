"""Receiver clock of two states, bias and drift in metres: spectral densities and the covariance of a step."""

import math

SPEED_OF_LIGHT = 299792458.0


def spectral_densities(h0: float, h_minus2: float) -> tuple[float, float]:
    """Return the white-noise densities that drive bias (m^2/s) and drift (m^2/s^3) of a clock in metres.

    Parameters
    ----------
    h0, h_minus2
        One-sided power-law coefficients of fractional frequency: white (s) and random-walk (1/s) frequency noise.

    Notes
    -----
    Brown and Hwang, Introduction to Random Signals and Applied Kalman Filtering, 4th ed., section 9.3: h0/2 and
    2 pi^2 h_minus2 for a clock in seconds. In metres both have the factor c squared; Canepa and Servidia, eq. 2.2,
    print c.
    """
    bias_density = SPEED_OF_LIGHT**2 * 0.5 * h0
    drift_density = SPEED_OF_LIGHT**2 * 2.0 * math.pi**2 * h_minus2
    return bias_density, drift_density


def step_covariance(dt: float, h0: float, h_minus2: float) -> tuple[float, float, float]:
    """Return the covariance that the noise of a receiver clock adds over a time step.

    Parameters
    ----------
    dt
        s. Length of the step.
    h0, h_minus2
        s, 1/s. Power-law coefficients, as in `spectral_densities`.

    Returns
    -------
    tuple of float
        Variance of bias (m^2), covariance of bias and drift (m^2/s), variance of drift (m^2/s^2).
    """
    bias, drift = spectral_densities(h0, h_minus2)
    bias_variance = bias * dt + drift * dt**3 / 3.0
    covariance = drift * dt**2 / 2.0
    drift_variance = drift * dt
    return bias_variance, covariance, drift_variance


def clock_step(dt: float, h0: float, h_minus2: float) -> tuple[float, float, float]:
    """Return the lower Cholesky factor of `step_covariance`: a11 (m), a21 (m/s), a22 (m/s).

    With two standard normal draws n1, n2 a step is ``bias += drift * dt + a11 * n1`` and
    ``drift += a21 * n1 + a22 * n2``. A clock without noise, or a step of no length, gives zeros.

    Parameters
    ----------
    dt
        s. Length of the step.
    h0, h_minus2
        s, 1/s. Power-law coefficients, as in `spectral_densities`.
    """
    q11, q12, q22 = step_covariance(dt, h0, h_minus2)
    if q11 <= 0.0:
        return 0.0, 0.0, 0.0
    a11 = math.sqrt(q11)
    a21 = q12 / a11
    a22 = math.sqrt(max(0.0, q22 - a21 * a21))
    return a11, a21, a22
