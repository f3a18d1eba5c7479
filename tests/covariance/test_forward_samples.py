"""Linear covariance of a flight with an attitude reference against Monte Carlo, and its budget against its total."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.modelled import BASELINE, DATASHEET, MODEL, PUBLISHED, modelled

RUNS = 128
OTHER_TIMES = {"filter__imu": {
    "gyro_random_walk": "10 deg/h/sqrt(Hz)", "accel_random_walk": "1600 ug/sqrt(Hz)", "gyro_bias": "2 deg/h",
    "gyro_bias_time": "30 s", "accel_bias": "5 mg", "accel_bias_time": "15 s",
}}  # fmt: skip


@pytest.mark.parametrize(("card", "unit"), [(MODEL, PUBLISHED), (MODEL, DATASHEET), (BASELINE, PUBLISHED)])
def test_monte_carlo_and_linear_covariance_agree(card, unit, record_property):
    _agree(modelled(card, unit), record_property)


def test_they_agree_where_the_filter_assumes_another_time_constant(record_property):
    scenario = {**OTHER_TIMES, "imu__gyro__bias_instability": "5 deg/h", "imu__gyro__instability_time": "10 s"}
    prepared_case = modelled(MODEL, PUBLISHED, **{k: _frozen(v) for k, v in scenario.items()})
    _agree(prepared_case, record_property)


class _frozen(dict):
    """A setting that can key a cache."""

    def __hash__(self):
        return hash(tuple(sorted(self.items())))

    def __new__(cls, value):
        return value if isinstance(value, str) else super().__new__(cls)


def _agree(prepared_case, record_property):
    history, block = covariance(prepared_case), run_block(prepared_case, 20261121, 0, RUNS)
    expected = np.sqrt(history.true_sigma**2 + history.mean**2)
    times = [int(np.argmin(np.abs(history.t - t))) for t in (5.0, 18.0, 29.0)]
    compared = len(times) * len(prepared_case.outputs)
    low, high = np.sqrt(chi2.ppf([0.005 / compared, 1.0 - 0.005 / compared], RUNS) / RUNS)
    ratio = np.sqrt((block.err[:, times] ** 2).mean(axis=0)) / expected[times]
    record_property("RMS over linear covariance", f"{ratio.min():.3f} to {ratio.max():.3f} ({low:.3f} to {high:.3f})")
    assert low < ratio.min()
    assert ratio.max() < high
    formal = np.sqrt((block.sigma[:, times] ** 2).mean(axis=0)) / history.formal_sigma[times]
    assert np.abs(formal - 1.0).max() < 0.02
    assert block.nis.mean() == pytest.approx(history.expected_nis.mean(), rel=0.03)
    assert block.nees[:, times].mean() == pytest.approx(history.expected_nees[times].mean(), rel=0.1)


def test_the_budget_sums_to_the_true_variance_and_noise_of_samples_is_not_counted_twice():
    prepared_case = modelled()
    history = covariance(prepared_case)
    np.testing.assert_allclose(history.budget.sum(axis=1), history.true_sigma**2, rtol=1e-9, atol=1e-30)
    roll = [o.quantity for o in prepared_case.outputs].index("rate")
    at = int(np.argmin(np.abs(history.t - 15.0)))
    by_source = dict(zip(history.sources, history.budget[at, :, roll], strict=True))
    assert by_source["gyro random walk"] > 0.99 * history.true_sigma[at, roll] ** 2


def test_what_the_vehicle_does_and_the_filter_does_not_expect_moves_the_mean():
    # the boost ends at 20 s: that is in the envelope of a change, and some seconds on nothing is left of it
    prepared_case = modelled()
    history = covariance(prepared_case)
    x = [o.quantity for o in prepared_case.outputs].index("acceleration")
    after, late = (int(np.argmin(np.abs(history.t - t))) for t in (20.0, 29.0))
    assert abs(history.mean[late, x]) < 0.05 * history.formal_sigma[late, x]
    assert abs(history.mean[after, x]) < 3.0 * history.formal_sigma[after, x]
    turning = [i for i, o in enumerate(prepared_case.outputs) if o.quantity == "rate"]
    assert np.abs(history.mean[10:, turning]).max() < 1e-3


UNMODELLED = {
    "imu__gyro__scale_factor": "50 ppm", "imu__accel__scale_factor": "300 ppm", "imu__accel__misalignment": "0.3 mrad",
    "imu__gyro__g_sensitivity": "0.5 deg/h/g",
}  # fmt: skip


@lru_cache(maxsize=1)
def unmodelled():
    """A unit with errors that no state of the filter stands for: they enter its samples."""
    return modelled(MODEL, PUBLISHED, **UNMODELLED)


def test_errors_of_the_unit_that_no_state_stands_for_enter_its_samples(record_property):
    _agree(unmodelled(), record_property)
    history = covariance(unmodelled())
    at = history.sources.index("accelerometer scale factor")
    assert history.budget[-1, at, 3:6].max() > 0.0


@pytest.mark.parametrize("prepared_case", [modelled, unmodelled], ids=["matched", "unmodelled errors"])
def test_going_back_through_200_samples_a_second_gives_the_true_variance(prepared_case):
    prepared_case = prepared_case()
    history = covariance(prepared_case)
    for time in (12.0, 30.0):
        hist = int(np.argmin(np.abs(history.t - time)))
        back = adjoint(prepared_case, time).contribution.sum(axis=2)
        np.testing.assert_allclose(back.sum(axis=1), history.true_sigma[hist, :9] ** 2, rtol=1e-8)
        scale = history.true_sigma[hist, :9, None] ** 2
        np.testing.assert_allclose(back / scale, history.budget[hist, :, :9].T / scale, rtol=0, atol=1e-8)


def test_a_filter_with_samples_alone_counts_them_in_both_engines():
    prepared_case = modelled(MODEL, PUBLISHED, filter__measurements=("imu",))
    history, block = covariance(prepared_case), run_block(prepared_case, 7, 0, RUNS)
    assert np.all(history.n_row == 6)
    assert np.all(block.n_row == 6)
    n_scalar = block.n_row.sum()
    ratio = block.nis.mean() / history.expected_nis.mean()
    assert abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / n_scalar)  # four sigma of a mean square
