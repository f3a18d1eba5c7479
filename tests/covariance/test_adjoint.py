"""When errors came in: the backward pass. That its sums are the forward budget is tested with engines.lincov."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.history import adjoint, covariance
from tests.building import INERTIAL, MATCHED, case


def test_bins_cover_the_flight_up_to_the_time_and_hold_no_negative_variance():
    back = adjoint(case(MATCHED), 20.0, bin_seconds=4.0)
    assert back.time == 20.0
    assert back.edges[0] == 0.0
    assert back.edges[-1] >= 20.0
    assert back.contribution.shape == (9, len(back.sources), back.edges.size - 1)
    assert back.contribution.min() > -1e-12 * back.contribution.max()


def test_bins_of_any_length_hold_the_same_in_all():
    totals = [adjoint(case(MATCHED), 30.0, bin_seconds=s).contribution.sum(axis=2) for s in (1.0, 7.0, 100.0)]
    for other in totals[1:]:
        np.testing.assert_allclose(other, totals[0], rtol=1e-10, atol=1e-25)


def test_what_starts_with_the_flight_comes_in_with_the_first_bin():
    back = adjoint(case(MATCHED, INERTIAL), 30.0, bin_seconds=5.0)
    for name in ("initial attitude", "initial velocity", "initial position", "accelerometer bias repeatability"):
        share = back.contribution[3:9, back.sources.index(name)]
        np.testing.assert_allclose(share[:, 1:], 0.0, atol=1e-12 * np.abs(share).max())


def test_white_noise_of_an_unaided_flight_comes_in_evenly_into_velocity():
    back = adjoint(case(MATCHED, INERTIAL), 30.0, bin_seconds=5.0)
    share = back.contribution[3:6, back.sources.index("accelerometer random walk")]
    # the gradient of gravitation turns 1e-3 of it over 30 s: (30 s)^2 x 2e-6 / s^2
    np.testing.assert_allclose(share, np.broadcast_to(share[:, -1:], share.shape), rtol=4e-3)


@pytest.mark.parametrize("time", [7.0, 30.0])
def test_the_sum_over_sources_and_times_is_the_true_variance(time):
    prepared_case = case()
    cov, hist = covariance(prepared_case), int(np.flatnonzero(prepared_case.t_hist == time)[0])
    total = adjoint(prepared_case, time).contribution.sum(axis=(1, 2))
    np.testing.assert_allclose(total, cov.true_sigma[hist, :9] ** 2, rtol=1e-10)
