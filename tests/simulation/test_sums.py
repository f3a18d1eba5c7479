"""The kernels of statistics against the same sums in numpy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.simulation.statistics import BIN, LOWEST, N_BIN, N_LAG, add_norms, counts, merge, summarise
from tests.synthetic import EVENTS, OUTPUTS, block, covariance

COV = covariance()
FAILING = (3, 17)


@pytest.fixture(scope="module")
def runs():
    """Forty runs, of which two fail at 50 s and one is no number after that; some innovations are missing."""
    found = block(COV, 0, 40, failing=FAILING)
    found.err[FAILING[0], -3, 2] = np.nan
    found.innovation[7, 5:9, 2] = np.nan
    found.innovation[:, :, 1] = np.nan
    return found


@pytest.fixture(scope="module")
def summary(runs):
    return summarise(runs, EVENTS, COV.true_sigma, OUTPUTS)


def counted(values, alive):
    return np.where(alive[..., None], values, 0.0)


def test_sums_are_those_of_numpy_to_the_last_bit(runs, summary):
    alive = runs.t < np.where(runs.failed, runs.t_failed, np.inf)[:, None]
    error, sigma = add_norms(runs.err, OUTPUTS), add_norms(runs.sigma, OUTPUTS)
    np.testing.assert_array_equal(summary.total, counted(error, alive).sum(axis=0))
    np.testing.assert_array_equal(summary.squares, (counted(error, alive) ** 2).sum(axis=0))
    np.testing.assert_array_equal(summary.sigma_squares, (counted(sigma, alive) ** 2).sum(axis=0))


def test_bins_are_those_of_the_logarithm(runs, summary):
    alive = runs.t < np.where(runs.failed, runs.t_failed, np.inf)[:, None]
    ratio = np.abs(add_norms(runs.err, OUTPUTS)) / (summary.scale * LOWEST)
    place = np.where(alive[..., None], np.floor(np.log(np.where(alive[..., None], ratio, 1.0)) / BIN) + 1.0, N_BIN)
    np.testing.assert_array_equal(summary.bins, np.clip(place, 0, N_BIN - 1))
    found = counts(merge([summary]))
    for cell in ((0, 0), (50, 6), (-1, 12)):
        np.testing.assert_array_equal(found[cell], np.bincount(summary.bins[:, *cell], minlength=N_BIN))


def test_spans_have_the_largest_error_and_the_mean_square_of_the_trapezoidal_rule(runs, summary):
    error = add_norms(runs.err, OUTPUTS)
    at = np.searchsorted(runs.t, summary.t_bound)
    for span, (first, last) in enumerate(pairwise(at)):
        inside, t = error[:, first : last + 1], runs.t[first : last + 1]
        np.testing.assert_array_equal(summary.worst[:, span], np.abs(inside).max(axis=1))
        mean = np.trapezoid(inside**2, t, axis=1) / (t[-1] - t[0])
        np.testing.assert_allclose(summary.mean_square[:, span], mean, rtol=1e-13)
    assert np.isnan(summary.worst[FAILING[0], -1, 2])


def test_products_of_innovations_are_those_of_pairs_that_exist(runs, summary):
    alive = runs.t_epoch < np.where(runs.failed, runs.t_failed, np.inf)[:, None]
    x = np.where(alive[..., None], runs.innovation, np.nan)
    for lag in range(N_LAG):
        products = x[:, : x.shape[1] - lag] * x[:, lag:]
        np.testing.assert_array_equal(summary.lag_count[lag], np.isfinite(products).sum(axis=(0, 1)))
        np.testing.assert_allclose(summary.lag_sum[lag], np.nansum(products, axis=(0, 1)), rtol=1e-12, atol=1e-12)
    assert summary.lag_count[0, 1] == 0 < summary.lag_count[0, 2] < summary.lag_count[0, 0]
