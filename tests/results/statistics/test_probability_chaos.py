"""Sensitivity indices of a fit: of products and sums with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.results.statistics.probability import basis, fit_polynomials, fitted_indices, predicted_variance_share


def designs(n: int, d: int) -> np.ndarray:
    return 2.0 * points("sobol", d, n, 3) - 1.0


def found(u: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, whole = fitted_indices(fit_polynomials(u, value)[None], u.shape[1])
    return first[0], whole[0]


def test_a_product_has_the_indices_of_its_closed_form() -> None:
    """y = prod exp(a_k u_k), v_k variance of exp(a u) over its mean squared: S_k = v_k / (prod (1 + v) - 1)."""
    a, u = np.array([1.5, 0.8, 0.3]), designs(64, 3)
    v = (np.sinh(2 * a) / (2 * a)) / (np.sinh(a) / a) ** 2 - 1.0
    whole = np.prod(1.0 + v)
    first, total = found(u, np.exp(u @ a))
    np.testing.assert_allclose(first, v / (whole - 1.0), atol=5e-3)
    np.testing.assert_allclose(total, v * whole / (1.0 + v) / (whole - 1.0), atol=5e-3)
    assert predicted_variance_share(u, np.exp(u @ a)) == pytest.approx(1.0, abs=1e-9)


def test_a_sum_of_variances_has_the_indices_of_the_closed_form_and_of_scipy() -> None:
    """Mean square sum s_k f_k^2, log f even: s_k^2 / sum s_j^2."""
    s = np.array([3.0, 2.0, 1.0, 0.2])
    exact = s**2 / np.sum(s**2)
    u = designs(128, 4)
    value = (2.0 ** (2.0 * u)) @ s
    for one in found(u, value):
        np.testing.assert_allclose(one, exact, atol=0.02)
    assert predicted_variance_share(u, value) > 0.99
    even = [stats.uniform(-1.0, 2.0)] * 4
    sampled = stats.sobol_indices(func=lambda x: s @ 2.0 ** (2.0 * x), n=2**12, dists=even)
    np.testing.assert_allclose(sampled.first_order, exact, atol=0.02)


def test_noise_is_not_predicted() -> None:
    assert len(basis(10)) == 76
    rng = np.random.default_rng(1)
    assert predicted_variance_share(designs(128, 4), np.exp(rng.normal(size=128))) < 0.3
