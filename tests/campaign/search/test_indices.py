"""Sensitivity indices: polynomials with known indices, scipy's own estimate, and the budget's closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.campaign.definition.searches import Indices
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.campaign.search.indices import basis, chaos, indices
from lvnav_trade.errors import InputError


def designs(n: int, d: int) -> np.ndarray:
    return 2.0 * points("sobol", d, n, 3) - 1.0


def test_the_indices_of_a_polynomial_are_those_of_its_terms() -> None:
    """y = u1 + 2 u2 + 3 u1 u3 on [-1, 1]^3: parts of the variance 1/3, 4/3, 9/9."""
    u = designs(64, 3)
    first, whole, predicted = chaos(u, u[:, 0] + 2.0 * u[:, 1] + 3.0 * u[:, 0] * u[:, 2])
    total = 1 / 3 + 4 / 3 + 1.0
    np.testing.assert_allclose(first, [1 / 3 / total, 4 / 3 / total, 0.0], atol=1e-9)
    np.testing.assert_allclose(whole, [(1 / 3 + 1.0) / total, 4 / 3 / total, 1.0 / total], atol=1e-9)
    assert predicted == pytest.approx(1.0, abs=1e-9)


def test_a_sum_of_variances_has_the_indices_of_the_closed_form_and_of_scipy() -> None:
    """Mean square sum s_k f_k^2, log f even: s_k^2 / sum s_j^2, by polynomials and by scipy's sampling."""
    s = np.array([3.0, 2.0, 1.0, 0.2])
    exact = s**2 / np.sum(s**2)
    u = designs(128, 4)
    first, whole, predicted = chaos(u, (2.0 ** (2.0 * u)) @ s)
    np.testing.assert_allclose(first, exact, atol=5e-3)
    np.testing.assert_allclose(whole, exact, atol=5e-3)
    assert predicted > 0.999
    even = [stats.uniform(-1.0, 2.0)] * 4
    sampled = stats.sobol_indices(func=lambda x: s @ 2.0 ** (2.0 * x), n=2**12, dists=even)
    np.testing.assert_allclose(sampled.first_order, exact, atol=0.02)
    np.testing.assert_allclose(sampled.total_order, exact, atol=0.02)


def test_too_few_designs_are_refused_and_what_is_left_out_is_not_predicted_by_noise() -> None:
    assert len(basis(10)) == 76
    rng = np.random.default_rng(1)
    assert chaos(designs(128, 4), rng.normal(size=128))[2] < 0.3


REQUIREMENT = "requirements=[{name: v, metric: velocity_error_3d, at: liftoff, probability: 0.95, below: 1 m/s}]"


@pytest.mark.slow
def test_indices_of_a_flight_stand_beside_its_budget() -> None:
    campaign = load("campaigns/smoke.yaml", [REQUIREMENT])
    with pytest.raises(InputError, match="too few for 8 polynomials; give 16"):
        indices(campaign, Indices.model_construct(requirement="v", sources=2, factor=2.0, samples=15))
    found = indices(campaign, Indices(requirement="v", sources=2, factor=1.5, samples=16))
    frame = found.frame
    assert frame.frozen_first.sum() == pytest.approx(1.0)
    assert (frame.retuned_total >= frame.retuned_first - 1e-12).all()
    assert list(frame.share_ratio) == sorted(frame.share_ratio, reverse=True)
    assert found.covered == pytest.approx(frame.share_ratio.sum())
    assert found.predicted > 0.9
