"""Frames of the injection: error, its parts and how runs end."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.records import ORBIT
from lvnav_trade.store.read import load
from tests import synthetic
from tests.injections import rows, with_injections


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


def test_the_budget_holds_navigation_and_vehicle_beside_the_runs(guided):
    frame = METRICS["injection_sources"](guided)
    mine = frame[frame.quantity == "inclination"].set_index("source")
    k, degrees = ORBIT.index("inclination"), 180.0 / np.pi
    navigation = rows()[:6, 3 + 2 * len(ORBIT) + k].std(ddof=1)
    sizes = {"navigation": navigation, "thrust": 1e-3, "dry mass": 1e-4}
    total = np.sqrt(sum(size**2 for size in sizes.values()))
    for source, size in sizes.items():
        assert mine.loc[source, "sigma"] == pytest.approx(size * degrees)
        assert mine.loc[source, "share_ratio"] == pytest.approx((size / total) ** 2)
    assert mine.loc["root sum of squares", "sigma"] == pytest.approx(total * degrees)
    assert mine.loc["runs, all together", "sigma"] == pytest.approx(rows()[:6, 3 + k].std(ddof=1) * degrees)
    assert mine.sigma.iloc[:3].is_monotonic_decreasing


def test_how_runs_end_with_the_exact_interval(guided):
    (row,) = METRICS["cutoff"](guided).itertuples()
    assert (row.runs, row.injected_count, row.depleted_count, row.lost_count) == (8, 6, 1, 1)
    assert row.depleted_ratio == 0.125
    # Clopper and Pearson, one of eight
    assert (row.low_ratio, row.high_ratio) == (pytest.approx(0.00316, abs=1e-5), pytest.approx(0.52651, abs=1e-5))
    assert row.cutoff_s == pytest.approx(np.mean(500.0 + np.arange(6)))
    assert row.left_least_kg == 0.0


def test_without_guidance_there_are_no_rows(tmp_path):
    plain = load(synthetic.results(tmp_path / "plain", n_run=4, size=4))
    assert METRICS["injection"](plain).empty
    assert METRICS["cutoff"](plain).empty
