"""The distribution of the correction by runs and by linear covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import errors_at
from lvnav_trade.store import load
from tests import mission as flights


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    tables = load(flights.results(tmp_path_factory.mktemp("cost"), failing=(3,)))
    return tables, METRICS["correction"](tables).set_index("by")


def test_runs_and_linear_covariance_agree_on_the_quantiles(reported):
    _, found = reported
    runs, lincov = found.loc["Monte Carlo"], found.loc["linear covariance"]
    assert runs["count"] == 199
    assert runs.q50 == pytest.approx(lincov.q50, rel=0.15)
    assert runs.q95 == pytest.approx(lincov.q95, rel=0.15)
    assert lincov.q50 < lincov.q95 < lincov.q99


def test_the_quantiles_are_those_of_the_runs_errors(reported):
    tables, found = reported
    size = errors_at(tables, flights.CASE, "injection", "correction_delta_v").size
    assert found.loc["Monte Carlo", "q99"] == pytest.approx(np.quantile(size[np.isfinite(size)], 0.99), rel=1e-12)


def test_the_parts_stand_beside_the_whole(reported):
    """A norm is at most the sum of its parts', draw by draw; here velocity makes nearly all of it."""
    _, found = reported
    assert (found.velocity_q99 > 0.9 * found.q99).all()
    assert (found.position_q99 < 0.2 * found.q99).all()


def test_a_flight_that_falls_back_has_no_correction(good):
    assert METRICS["correction"](good).empty
