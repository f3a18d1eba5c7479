"""Normalised errors squared inside and outside their bounds, and innovations that are white or not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.filter.consistency import accepted_moments, nees, nis
from lvnav_trade.store import Tables


def test_a_matched_filter_is_inside_its_bounds(good):
    """99 epochs of ANIS in 95 % bounds: fewer than 87 inside has probability 0.1 %."""
    found = METRICS["consistency"](good).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANIS"), "inside_ratio"] >= 87 / 99
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(
        found.loc[("imu=fine", "ANEES"), "expected_ratio"], rel=0.01
    )


def test_an_optimistic_filter_is_outside_its_bounds(wrong):
    found = METRICS["consistency"](wrong).set_index(["case", "test"])
    assert found.loc[("imu=fine", "ANEES"), "inside_ratio"] == 0.0
    assert found.loc[("imu=fine", "ANEES"), "mean_ratio"] == pytest.approx(1.6**2 + 0.0285, rel=0.03)


def test_bounds_of_anees_are_chi_square_with_all_runs(good):
    row = nees(good).iloc[0]
    assert row.low_ratio == pytest.approx(stats.chi2.ppf(0.025, 1990) / 1990, rel=1e-12)


def test_anis_is_bounded_by_the_rows_that_there_were(good):
    row = nis(good).iloc[0]
    assert row.row_count == 199 * 16
    assert row.high_ratio == pytest.approx(stats.chi2.ppf(0.975, 199 * 16) / (199 * 16), rel=1e-12)


@pytest.mark.parametrize("gate", [1.0, 2.0, 3.0])
def test_the_moments_are_those_of_a_truncated_normal(gate):
    """Variance and fourth moment of a standard normal within +- gate, by scipy's truncated normal."""
    law = stats.truncnorm(-gate, gate)
    mean, variance = accepted_moments(np.array([gate]))
    assert mean[0] == pytest.approx(law.moment(2), rel=1e-9)
    assert variance[0] == pytest.approx(law.moment(4) - law.moment(2) ** 2, rel=1e-8)


def test_without_a_gate_it_is_the_chi_square():
    mean, variance = accepted_moments(np.array([np.nan]))
    assert (mean[0], variance[0]) == (1.0, 2.0)


def test_white_innovations_pass_and_channels_have_names(good):
    found = METRICS["whiteness"](good)
    assert found.white.all()
    assert found.channel.iloc[0] == "G01 range"
    assert found.channel.nunique() == 16


def test_coloured_innovations_fail_in_their_channel_and_the_lag_is_named(good):
    """A product sum of 0.1 per pair at lag 3 among 17 900 pairs is thirteen sigma."""
    rows = good.whiteness.copy()
    hit = (rows.channel == "G02 range") & (rows.lag_number == 3)
    rows.loc[hit, "product_sum_ratio"] = 0.1 * rows.pair_count[hit]
    coloured = Tables(good.folder)
    coloured._read["whiteness"] = rows
    found = METRICS["whiteness"](coloured).set_index(["case", "channel"])
    assert not found.loc[("imu=fine", "G02 range"), "white"]
    assert found.loc[("imu=fine", "G02 range"), "largest_lag_number"] == 3
    assert found.white.sum() == 30
