"""Sensitivity indices: of products and sums with closed forms, and of a flight beside its budget."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.campaign.definition.searches import Indices
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.campaign.search.indices import basis, fitted, fitted_indices, indices, predicted
from lvnav_trade.errors import InputError


def designs(n: int, d: int) -> np.ndarray:
    return 2.0 * points("sobol", d, n, 3) - 1.0


def found(u: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, whole = fitted_indices(fitted(u, value)[None], u.shape[1])
    return first[0], whole[0]


def test_a_product_has_the_indices_of_its_closed_form() -> None:
    """y = prod exp(a_k u_k), v_k variance of exp(a u) over its mean squared: S_k = v_k / (prod (1 + v) - 1)."""
    a, u = np.array([1.5, 0.8, 0.3]), designs(64, 3)
    v = (np.sinh(2 * a) / (2 * a)) / (np.sinh(a) / a) ** 2 - 1.0
    whole = np.prod(1.0 + v)
    first, total = found(u, np.exp(u @ a))
    np.testing.assert_allclose(first, v / (whole - 1.0), atol=5e-3)
    np.testing.assert_allclose(total, v * whole / (1.0 + v) / (whole - 1.0), atol=5e-3)
    assert predicted(u, np.exp(u @ a)) == pytest.approx(1.0, abs=1e-9)


def test_a_sum_of_variances_has_the_indices_of_the_closed_form_and_of_scipy() -> None:
    """Mean square sum s_k f_k^2, log f even: s_k^2 / sum s_j^2."""
    s = np.array([3.0, 2.0, 1.0, 0.2])
    exact = s**2 / np.sum(s**2)
    u = designs(128, 4)
    value = (2.0 ** (2.0 * u)) @ s
    for one in found(u, value):
        np.testing.assert_allclose(one, exact, atol=0.02)
    assert predicted(u, value) > 0.99
    even = [stats.uniform(-1.0, 2.0)] * 4
    sampled = stats.sobol_indices(func=lambda x: s @ 2.0 ** (2.0 * x), n=2**12, dists=even)
    np.testing.assert_allclose(sampled.first_order, exact, atol=0.02)


def test_too_few_designs_are_refused_and_what_is_left_out_is_not_predicted_by_noise() -> None:
    assert len(basis(10)) == 76
    rng = np.random.default_rng(1)
    assert predicted(designs(128, 4), np.exp(rng.normal(size=128))) < 0.3


REQUIREMENT = "requirements=[{name: v, metric: velocity_error_3d, at: liftoff, probability: 0.95, below: 1 m/s}]"


@pytest.mark.slow
def test_indices_of_a_flight_stand_beside_its_budget() -> None:
    campaign = load("campaigns/smoke.yaml", [REQUIREMENT])
    with pytest.raises(InputError, match="too few for 8 polynomials; give 16"):
        indices(campaign, Indices.model_construct(requirement="v", sources=2, factor=2.0, samples=15))
    made = indices(campaign, Indices(requirement="v", sources=2, factor=1.5, samples=16))
    frame = made.indices
    assert frame.frozen_first.sum() == pytest.approx(1.0)
    assert (frame.retuned_total >= frame.retuned_first - 0.02).all()
    assert list(frame.share_ratio) == sorted(frame.share_ratio, reverse=True)
    assert made.covered == pytest.approx(frame.share_ratio.sum())
    assert made.predicted > 0.9
