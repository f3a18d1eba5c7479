"""Streamed statistics against whole-sample statistics and closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.simulation import statistics
from lvnav_trade.simulation.statistics import columns, counts, merge, quantiles, summarise
from tests.synthetic import EVENTS, OUTPUTS, SIGMA, block, covariance

COV = covariance()


def parts(cuts: list[int], failing: tuple[int, ...] = ()) -> list[statistics.BlockSummary]:
    spans = pairwise(cuts)
    return [
        summarise(block(COV, first, end - first, failing=failing), EVENTS, COV.true_sigma, OUTPUTS)
        for first, end in spans
    ]


@pytest.fixture(scope="module")
def four() -> list[statistics.BlockSummary]:
    return parts([0, 40, 80, 120, 160])


def test_merged_sums_are_those_of_the_whole_sample(four):
    whole = block(COV, 0, 160)
    merged = merge(four)
    assert merged.n_good[0] == 160
    np.testing.assert_allclose(merged.total[:, :10], whole.err.sum(axis=0), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(merged.squares[:, :10], (whole.err**2).sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(merged.nis, whole.nis.sum(axis=0), rtol=1e-12)


def test_parts_merge_to_the_same_bytes_in_any_order(four):
    shuffled = merge([four[2], four[0], four[3], four[1]])
    for one, other in zip(merge(four), shuffled, strict=True):
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()


def test_a_stream_of_parts_merges_like_a_list(four):
    np.testing.assert_array_equal(merge(iter(four)).squares, merge(four).squares)


def test_merging_leaves_the_parts_as_they_were(four):
    before = four[0].total.copy()
    merge(four)
    np.testing.assert_array_equal(four[0].total, before)


def test_overlapping_parts_are_refused(four):
    with pytest.raises(ValueError, match="in two parts"):
        merge([four[0], four[0]])


def test_parts_of_another_history_are_refused(four):
    other = four[1]._replace(t=four[1].t + 1.0)
    with pytest.raises(ValueError, match="another history"):
        merge([four[0], other])


def test_the_norm_of_three_axes_is_a_column_of_its_own():
    names = [(column.quantity, column.axis) for column in columns(OUTPUTS)]
    assert names[10:] == [("attitude", "3d"), ("velocity", "3d"), ("position", "3d")]
    summary = parts([0, 40])[0]
    np.testing.assert_allclose(summary.squares[:, 12], summary.squares[:, 6:9].sum(axis=1), rtol=1e-12)


def test_quantiles_are_those_of_the_sample_to_half_a_bin(four):
    """Bins are 2 % wide and answered by their middle: 1 % of the order statistic of the same rank."""
    sample = np.sort(np.abs(block(COV, 0, 160).err), axis=0)
    for probability in (0.5, 0.95, 0.997):
        rank = int(np.ceil(probability * 160)) - 1
        np.testing.assert_allclose(quantiles(merge(four), probability)[0][:, :10], sample[rank], rtol=0.0101)


def test_the_95_percent_quantile_of_a_gaussian_is_1_96_sigma():
    summary = summarise(block(COV._replace(mean=0 * COV.mean), 0, 2000), EVENTS, COV.true_sigma, OUTPUTS)
    found = quantiles(summary, 0.95)[0][:, :10] / COV.true_sigma
    # 106 times x 10 outputs x 2000 runs: the median over times leaves 0.3 % of sampling error, 1 % of bin
    assert np.median(found) == pytest.approx(stats.norm.ppf(0.975), rel=0.013)


def test_an_error_beyond_the_bins_gives_an_infinite_quantile_and_one_below_gives_zero():
    runs = block(COV, 0, 8)
    runs.err[:, 3, 6] = 1e9
    runs.err[:, 4, 6] = 0.0
    found = quantiles(summarise(runs, EVENTS, COV.true_sigma, OUTPUTS), 0.5)[0]
    assert found[3, 6] == np.inf
    assert found[4, 6] == 0.0


def test_a_failed_run_counts_until_it_fails_and_is_infinite_in_quantiles_from_then_on():
    summary, whole = parts([0, 40], failing=(3, 17))[0], parts([0, 40])[0]
    before, after = summary.t < 50.0, summary.t >= 50.0
    assert (summary.n_good[before] == 40).all()
    assert (summary.n_good[after] == 38).all()
    np.testing.assert_array_equal(summary.n_good_epoch, np.where(summary.t_epoch < 50.0, 40, 38))
    assert summary.failed.sum() == 4
    np.testing.assert_array_equal(summary.squares[before], whole.squares[before])
    assert np.sqrt(summary.squares[-1, 6] / 38) < 5 * COV.true_sigma[-1, 6]
    assert (counts(summary).sum(axis=-1) == 40).all()
    np.testing.assert_array_equal(counts(summary)[after, :, -1], 2)
    assert np.isfinite(quantiles(summary, 0.95)[0]).all()
    assert np.isinf(quantiles(summary, 0.96)[0][after]).all()
    assert np.isfinite(quantiles(summary, 0.96)[0][before]).all()
    assert np.isnan(summary.t_failed[0])
    assert summary.t_failed[3] == 50.0


def test_a_run_that_is_not_finite_counts_as_failed_even_if_nobody_said_so():
    runs = block(COV, 0, 8)
    runs.err[5, 7, 2] = np.nan
    assert list(np.flatnonzero(summarise(runs, EVENTS, COV.true_sigma, OUTPUTS).failed)) == [5]


def test_event_rows_hold_the_error_of_each_run_at_the_event():
    runs = block(COV, 40, 8)
    summary = summarise(runs, EVENTS, COV.true_sigma, OUTPUTS)
    assert summary.events == ("liftoff", "stage1_cutoff", "injection")
    at = int(np.flatnonzero(runs.t == 99.5)[0])
    np.testing.assert_array_equal(summary.event_error[:, 2, :10], runs.err[:, at])
    np.testing.assert_allclose(summary.event_error[:, 2, 12], np.linalg.norm(runs.err[:, at, 6:9], axis=1))
    assert list(summary.runs) == list(range(40, 48))


def test_an_event_between_history_times_is_refused():
    with pytest.raises(ValueError, match="staging at 40"):
        summarise(block(COV, 0, 8), {"staging": 40.2}, COV.true_sigma, OUTPUTS)


def test_lag_products_are_those_of_a_first_order_process():
    """x_k = a x_(k-1) + sqrt(1 - a^2) w has autocorrelation a^l; 63 000 pairs: 3 sigma 0.02."""
    draw, a = np.random.default_rng(3), 0.6
    x = draw.standard_normal((40, 99, 16))
    for k in range(1, 99):
        x[:, k] = a * x[:, k - 1] + np.sqrt(1 - a * a) * x[:, k]
    summary = summarise(block(COV, 0, 40)._replace(innovation=x), EVENTS, COV.true_sigma, OUTPUTS)
    found = (summary.lag_sum / summary.lag_count).mean(axis=1)
    np.testing.assert_allclose(found[:4], a ** np.arange(4), atol=0.05)


def test_a_missing_innovation_makes_no_pair():
    runs = block(COV, 0, 8)
    runs.innovation[:, 10, 2] = np.nan
    count = summarise(runs, EVENTS, COV.true_sigma, OUTPUTS).lag_count
    assert count[0, 2] == 8 * 98
    assert count[1, 2] == 8 * 96
    assert count[1, 3] == 8 * 98


def test_sigma_of_the_filter_is_averaged_as_variance():
    summary = parts([0, 40])[0]
    np.testing.assert_allclose(np.sqrt(summary.sigma_squares[:, :10] / 40), COV.formal_sigma, rtol=1e-12)
    assert SIGMA.size == 10


def test_the_worst_of_a_span_is_that_of_the_whole_history_both_bounds_included(four):
    whole = block(COV, 0, 160)
    merged = merge(four)
    np.testing.assert_array_equal(merged.t_bound, [-5.0, 0.0, 40.0, 99.5])
    for k, (first, last) in enumerate(pairwise(merged.t_bound)):
        within = (whole.t >= first) & (whole.t <= last)
        np.testing.assert_array_equal(merged.worst[:, k, :10], np.abs(whole.err[:, within]).max(axis=1))
        norm = np.sqrt((whole.err[:, within][:, :, 3:6] ** 2).sum(axis=2)).max(axis=1)
        np.testing.assert_allclose(merged.worst[:, k, 11], norm, rtol=1e-12)


def test_the_mean_square_of_a_span_is_the_integral_over_its_time(four):
    whole = block(COV, 0, 160)
    merged = merge(four)
    for k, (first, last) in enumerate(pairwise(merged.t_bound)):
        within = np.flatnonzero((whole.t >= first) & (whole.t <= last))
        square, t = whole.err[:, within] ** 2, whole.t[within]
        area = (0.5 * (square[:, 1:] + square[:, :-1]) * np.diff(t)[:, None]).sum(axis=1)
        np.testing.assert_allclose(merged.mean_square[:, k, :10], area / (last - first), rtol=1e-12)
        norm = merged.mean_square[:, k, 3:6].sum(axis=1)
        np.testing.assert_allclose(merged.mean_square[:, k, 11], norm, rtol=1e-12)


def test_the_worst_of_spans_together_is_the_worst_of_the_flight(four):
    whole = np.abs(block(COV, 0, 160).err).max(axis=1)
    np.testing.assert_array_equal(merge(four).worst[:, :, :10].max(axis=1), whole)


def test_without_rows_a_merged_summary_has_the_same_sums_and_the_same_runs(four):
    whole, biases_only = (merge(four, rows=rows) for rows in (True, False))
    for name in whole._fields:
        if name in ("event_error", "event_sigma", "event_nees", "worst", "mean_square", "changes"):
            assert getattr(biases_only, name).shape == (0, *getattr(whole, name).shape[1:])
        else:
            np.testing.assert_array_equal(np.asarray(getattr(biases_only, name)), np.asarray(getattr(whole, name)))
