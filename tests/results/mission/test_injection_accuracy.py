"""Frames of the injection: error, its parts and how runs end."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from lvnav_trade.quantities.records import ORBIT
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.mission.injection_accuracy import FLOWN, TOGETHER
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import SIZES, SOURCES, rows, with_injections


@pytest.fixture(scope="module")
def guided(tmp_path_factory):
    return with_injections(load(synthetic.results(tmp_path_factory.mktemp("guided"), n_run=8, size=8)))


def test_the_error_is_knowledge_and_execution_with_their_correlation(guided):
    frame = METRICS["injection"](guided).set_index("quantity")
    assert list(frame.index) == list(ORBIT)
    k = ORBIT.index("apogee")
    error, knowledge = (rows()[:6, 3 + at] * 1e-3 for at in (k, k + len(ORBIT)))
    row = frame.loc["apogee"]
    assert (row.unit, row.runs) == ("km", 6)
    assert row["mean_error"] == pytest.approx(error.mean())
    assert row.sigma == pytest.approx(error.std(ddof=1))
    assert row.execution_sigma == pytest.approx((error - knowledge).std(ddof=1))
    together = 2.0 * row.correlation_ratio * row.knowledge_sigma * row.execution_sigma
    assert row.sigma**2 == pytest.approx(row.knowledge_sigma**2 + row.execution_sigma**2 + together)


def test_linear_covariance_stands_beside_the_runs(guided):
    frame = METRICS["injection"](guided).set_index("quantity")
    k, degrees = ORBIT.index("inclination"), 180.0 / np.pi
    row = frame.loc["inclination"]
    shares = np.array(list(SOURCES.values()))
    assert row.lincov_sigma == pytest.approx(np.linalg.norm(shares) * SIZES[k] * degrees)
    assert row.lincov_knowledge_sigma == pytest.approx(np.linalg.norm(shares[:2]) * SIZES[k] * degrees)
    assert row.lincov_execution_sigma == pytest.approx(np.linalg.norm(shares[2:]) * SIZES[k] * degrees)
    assert row.lincov_mean == pytest.approx(0.1 * SIZES[k] * degrees)
    assert set(frame.reason) == {""}


def test_the_budget_holds_every_source_beside_the_runs(guided):
    frame = METRICS["injection_sources"](guided)
    mine = frame[frame.quantity == "inclination"].set_index("source")
    k, degrees = ORBIT.index("inclination"), 180.0 / np.pi
    total = np.linalg.norm(list(SOURCES.values()))
    for source, share in SOURCES.items():
        assert mine.loc[source, "sigma"] == pytest.approx(share * SIZES[k] * degrees)
        assert mine.loc[source, "share_ratio"] == pytest.approx((share / total) ** 2)
        assert mine.loc[source, "source_group"] == ("vehicle" if source in ("thrust", "dry mass") else "navigation")
    assert mine.loc[TOGETHER, "sigma"] == pytest.approx(total * SIZES[k] * degrees)
    assert mine.loc[FLOWN, "sigma"] == pytest.approx(rows()[:6, 3 + k].std(ddof=1) * degrees)
    assert mine.sigma.iloc[:4].is_monotonic_decreasing
    left = frame[frame.quantity == "propellant_left"].set_index("source")
    assert left.loc[FLOWN, "sigma"] == pytest.approx(np.std(10.0 * np.arange(6), ddof=1))


def test_how_runs_end_with_the_exact_interval(guided):
    (row,) = METRICS["cutoff"](guided).itertuples()
    assert (row.runs, row.injected_count, row.depleted_count, row.failed_count) == (8, 6, 1, 1)
    assert row.depleted_ratio == 0.125
    # Clopper and Pearson, one of eight
    assert (row.low_ratio, row.high_ratio) == (pytest.approx(0.00316, abs=1e-5), pytest.approx(0.52651, abs=1e-5))
    assert row.cutoff_s == pytest.approx(np.mean(500.0 + np.arange(6)))
    assert row.propellant_left_minimum_kg == 0.0
    share = np.linalg.norm(list(SOURCES.values()))
    assert (row.lincov_cutoff_s, row.lincov_propellant_left_kg) == (503.0, 60.0)
    assert row.lincov_cutoff_sigma_s == pytest.approx(0.2 * share)
    assert row.lincov_depleted_ratio == pytest.approx(norm.sf(60.0 / (5.0 * share)))


def test_lost_runs_are_listed_with_their_largest_draws(guided):
    empty, adrift = METRICS["failed_injections"](guided).itertuples()
    assert (empty.run_number, empty.outcome, empty.t_s) == (6, "depleted", 506.0)
    assert empty.draws == "specific impulse 2: -3.1, thrust 2: -2.5, specific impulse 1: +0.3"
    assert (adrift.run_number, adrift.draws) == (7, "thrust 1: +0.1")


def test_without_guidance_there_are_no_rows(tmp_path):
    plain = load(synthetic.results(tmp_path / "plain", n_run=4, size=4))
    assert METRICS["injection"](plain).empty
    assert METRICS["cutoff"](plain).empty
