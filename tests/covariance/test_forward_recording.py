"""What linear covariance writes at a history time."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.forward import write
from lvnav_trade.covariance.history import covariance
from tests.building import case


def test_the_true_covariance_is_the_sum_of_the_sources():
    assert callable(write)
    history = covariance(case())
    total = np.sum(history.budget, axis=1)
    np.testing.assert_allclose(np.sqrt(total), history.true_sigma, rtol=1e-9)
