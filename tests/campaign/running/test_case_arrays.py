"""A case in arrays has the numbers of the same case in tables."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import load
from lvnav_trade.simulation.statistics import summarise
from tests import synthetic

CASE = "aaaaaaaaaaaa"
STATED = [
    {"metric": "velocity_error_3d", "at": "injection", "below": "0.4 m/s"},
    {"metric": "velocity_error_north", "during": "stage1_cutoff to end", "below": "0.4 m/s"},
    {"metric": "position_error_3d", "during": "flight", "below": "35 m"},
    {"metric": "impact_error", "at": "injection", "below": "0.1 km"},
    {"metric": "normalised_velocity_error", "at": "injection", "below": "2 sigma"},
    {"metric": "velocity_error_3d", "at": "touchdown", "below": "1 m/s"},
    {"metric": "attitude_error_north", "at": "injection", "below": "1 deg"},
    {"metric": "position_protection_level", "at": "injection", "below": "20 m"},
]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    tables = load(synthetic.results(tmp_path_factory.mktemp("stored"), n_run=40, failing=(3,)))
    covariance = synthetic.covariance()
    block = synthetic.block(covariance, 0, 40, failing=(3,))
    summary = summarise(block, synthetic.EVENTS, covariance.true_sigma, synthetic.OUTPUTS)
    return CaseTables(tables, CASE), CaseArrays(synthetic.prepared_case(), covariance, summary)


@pytest.mark.parametrize("stated", STATED, ids=lambda one: f"{one['metric']} {one.get('at')}")
def test_requirements_have_the_same_errors_and_the_same_law(both, stated):
    metric = metric_of(stated["metric"])
    stored, held = (metric.errors(case, stated) for case in both)
    assert (stored is None) == (held is None)
    if stored is not None and held is not None:
        np.testing.assert_array_equal(held.magnitude, stored.magnitude)
        assert held[1:] == stored[1:]
    first, second = (metric.distribution(case, stated) for case in both)
    assert isinstance(first, str) == isinstance(second, str)
    if not isinstance(first, str) and not isinstance(second, str):
        np.testing.assert_allclose(second.law.mean, first.law.mean, rtol=1e-12)
        np.testing.assert_allclose(second.law.covariance, first.law.covariance, rtol=1e-12)
        assert second[1:] == first[1:]


def test_without_runs_there_are_no_errors_and_the_phase_is_that_of_the_history():
    alone = CaseArrays(synthetic.prepared_case(), synthetic.covariance())
    assert alone.sizes("injection", "velocity", "3d").size == 0
    assert alone.errors("injection", "velocity").shape == (0, 3)
    assert alone.failed_runs().size == 0
    assert alone.phase("start to end") == (synthetic.covariance().t[0], synthetic.covariance().t[-1])
    assert alone.largest("velocity", "3d", 0.0, 100.0).size == 0


def test_the_largest_tilt_is_that_before_lift_off(both):
    covariance = synthetic.covariance()
    early = covariance.true_sigma[covariance.t <= 0.0][:, :3]
    size, t = both[1].largest_tilt()
    assert size == early.max()
    assert t <= 0.0
