"""The pass itself: symmetric and positive covariances (see test_vehicle_lincov for their sizes)."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.lincov.history import covariance
from tests.engines.modelled import modelled


def test_covariances_are_symmetric_and_positive_all_along():
    history = covariance(modelled())
    for P in (history.formal_cov, history.true_cov):
        np.testing.assert_allclose(P, np.swapaxes(P, 1, 2), rtol=0.0, atol=1e-12 * np.abs(P).max())
        sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))[5:]
        correlation = P[5:] / (sigma[:, :, None] * sigma[:, None, :])
        assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_a_filter_that_expects_more_than_comes_believes_no_less_than_is_true():
    history = covariance(modelled())
    late = history.t > 5.0
    assert (history.formal[late] > 0.999 * history.true_sigma[late]).all()
