"""Allan variances of unit processes against closed forms, their covariance against quadratic forms of the angles."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.imu import allan
from lvnav_trade.imu.allan_covariance import PROCESSES, covariance, variances


def _angle_covariance(name, s, t):
    """Covariance of the angles at s and t >= 0 of a process that begins at rest at 0."""
    if name == "quantisation":
        return (s == t) / 12.0
    low, high = np.minimum(s, t), np.maximum(s, t)
    return low if name == "random_walk" else low**2 * (3.0 * high - low) / 6.0


@pytest.mark.parametrize("name", ["quantisation", "random_walk", "rate_random_walk"])
def test_the_covariance_of_gaussian_processes_is_that_of_quadratic_forms(name):
    n, dt, m = 120, 0.5, [1, 4, 13]
    t = dt * np.arange(n + 1)
    C = _angle_covariance(name, t[:, None], t[None, :])
    forms = []
    for a in m:
        D = np.zeros((n + 1 - 2 * a, n + 1))
        for k in range(len(D)):
            D[k, [k, k + a, k + 2 * a]] = 1.0, -2.0, 1.0
        forms.append(D.T @ D / (2.0 * (a * dt) ** 2 * len(D)))
    dense = np.array([[2.0 * np.trace(A @ C @ B @ C) for B in forms] for A in forms])
    squares = np.array([float(name == process) for process in PROCESSES])
    found = covariance(squares, m, n, dt)
    if name == "quantisation":  # a uniform error has a fourth moment 1.2 squared variances smaller
        counts = [n + 1 - 2 * a for a in m]
        weights = np.array([[1.0 / (4.0 * (a * b) ** 2 * dt**4 * na * nb) for b, nb in zip(m, counts, strict=True)]
                            for a, na in zip(m, counts, strict=True)])  # fmt: skip
        dense -= 1.2 * 36.0 / 144.0 * np.minimum.outer(counts, counts) * weights
    np.testing.assert_allclose(found, dense, rtol=1e-6)


def test_the_deviations_are_the_closed_forms_of_the_processes():
    m, dt = np.array([1, 7, 300]), 0.2
    tau = m * dt
    np.testing.assert_allclose(np.sqrt(variances("random_walk", m, dt)), allan.white(1.0, tau))
    np.testing.assert_allclose(np.sqrt(variances("rate_random_walk", m, dt)), allan.random_walk(1.0, tau))
    np.testing.assert_allclose(np.sqrt(variances("bias_instability", m, dt)), allan.FLOOR)
    np.testing.assert_allclose(np.sqrt(variances("quantisation", m, dt)), 0.5 / tau)
