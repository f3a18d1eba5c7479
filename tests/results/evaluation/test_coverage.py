"""Coverage of three sigmas against the runs themselves, and what both covariances expect of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.coverage import GAUSSIAN, SIGMAS, coverage, coverage_probability
from lvnav_trade.results.evaluation.published import references
from lvnav_trade.results.statistics.probability import box_probability, success_bounds
from lvnav_trade.results.tables.dictionary import error_column
from lvnav_trade.results.tables.read import load
from tests import synthetic

N_RUN = 200


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("coverage"), n_run=N_RUN))


def test_every_case_event_and_quantity_has_a_row_and_the_counts_are_those_of_the_runs(tables):
    frame = coverage(tables)
    assert set(frame.case) == set(tables.labels.values())
    assert set(frame.quantity) == {"attitude", "velocity", "position"}
    row = frame.iloc[-1]
    case = next(key for key, label in tables.labels.items() if label == row.case)
    runs = tables.runs[(tables.runs.case == case) & (tables.runs.event == row.event)]
    mine = tables.history[(tables.history.case == case) & (tables.history.quantity == row.quantity)]
    inside = []
    for axis in [name for name in dict.fromkeys(mine.axis) if name != "3d"]:
        series = mine[mine.axis == axis]
        sigma = series.filter_sigma_si.iloc[np.argmin(np.abs(series.t_s.to_numpy() - runs.t_s.iloc[0]))]
        error = runs[error_column(row.quantity, axis, series.unit.iloc[0])].to_numpy()
        inside.append((np.abs(error) <= SIGMAS * sigma) & (runs.failure.to_numpy() == ""))
    assert row.all_inside_ratio == pytest.approx(np.all(inside, axis=0).mean())
    assert row.inside_ratio == pytest.approx(np.mean(inside))


def test_the_interval_is_exact_and_what_is_honest_reaches_a_gaussian(tables):
    frame = coverage(tables)
    for row in frame.itertuples():
        out = round(row.run_count * (1.0 - row.all_inside_ratio))
        assert (row.low_ratio, row.high_ratio) == pytest.approx(success_bounds(row.run_count, out, 0.975))
        assert row.honest == (row.high_ratio >= GAUSSIAN**3)


def test_a_gaussian_in_a_box_is_a_product_where_axes_are_independent_and_as_drawn_where_not():
    limits = np.array([1.0, 2.0, 0.5])
    sigma, mean = np.array([0.6, 1.5, 0.3]), np.array([0.2, -0.4, 0.1])
    parts = special.ndtr((limits - mean) / sigma) - special.ndtr((-limits - mean) / sigma)
    assert box_probability(mean, np.diag(sigma**2), limits) == pytest.approx(np.prod(parts), rel=1e-9)
    root = np.array([[1.0, 0.2, -0.3], [0.0, 0.7, 0.5], [0.4, 0.0, 0.6]])
    drawn = mean + np.random.default_rng(1).standard_normal((400_000, 3)) @ root.T
    inside = np.mean(np.all(np.abs(drawn) < limits, axis=1))
    assert box_probability(mean, root @ root.T, limits) == pytest.approx(inside, abs=4.0 * 0.5 / np.sqrt(400_000))
    assert box_probability(np.zeros(3), np.eye(3), np.full(3, 3.0)) == pytest.approx(0.9919, abs=1e-4)


def test_a_row_names_coverage_as_a_metric_and_is_the_one_of_the_table(tables):
    frame = METRICS["coverage"](tables).set_index(["case", "event", "quantity"])
    stated = {
        "references": [
            {"source": "a page", "metric": "velocity_coverage", "at": "injection", "value": 0.9919, "unit": "-",
             "case": {"imu": "fine"}, "band": [0.99, 1.009]}
        ],
    }  # fmt: skip
    (number,) = references(tables, stated).itertuples()
    row = frame.loc[("imu=fine", "injection", "velocity")]
    assert number.ours == number.monte_carlo == pytest.approx(row.all_inside_ratio)
    assert (number.low, number.high) == pytest.approx((row.low_ratio, row.high_ratio))
    assert number.in_band == (0.99 <= row.all_inside_ratio / 0.9919 <= 1.009)


def test_of_missions_together_it_is_the_mean_and_its_interval_is_that_of_a_share(tables):
    stated = {
        "references": [
            {"source": "a page", "metric": "position_coverage", "at": "injection", "value": 0.9919, "unit": "-",
             "case": {}, "pool": ["imu"], "band": [0.99, 1.009]}
        ]
    }  # fmt: skip
    (row,) = references(tables, stated).itertuples()
    parts = [coverage_probability(tables, case, "injection", "position").runs.mean() for case in tables.labels]
    assert row.ours == row.monte_carlo == pytest.approx(np.mean(parts))
    assert 0.0 <= row.low <= row.ours <= row.high <= 1.0


def test_both_covariances_expect_a_share_of_their_own(tables):
    case = next(iter(tables.labels))
    found = coverage_probability(tables, case, "injection", "velocity")
    assert found.formal == pytest.approx(GAUSSIAN**3, abs=0.003)
    assert 0.0 < found.true <= 1.0
    assert len(found.runs) == N_RUN
