"""The tables of a case hold what the engines handed over."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.synthetic import block, covariance

COV = covariance()


def test_history_holds_the_moments_of_the_runs(written):
    history = load(written).history
    row = history[(history.case == "aaaaaaaaaaaa") & (history.t_s == 99.5) & (history.quantity == "position")]
    errors = block(COV, 0, 100).err[:, -1, 6:9]
    np.testing.assert_allclose(row.rms_si[:3], np.sqrt((errors**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(row.rms_si.iloc[3], np.sqrt((errors**2).sum(axis=1).mean()), rtol=1e-12)
    np.testing.assert_allclose(row.lincov_true_si.iloc[3], np.linalg.norm(COV.true_sigma[-1, 6:9]), rtol=1e-12)


def test_degrees_of_freedom_of_a_norm_are_satterthwaites(written):
    """One axis without mean: 1. Three axes 3, 3.5, 6 with mean 2 along the last: 2 E^2 / Var by hand."""
    history = load(written).history
    row = history[(history.case == "aaaaaaaaaaaa") & (history.t_s == 0.0) & (history.quantity == "position")]
    variance = np.array([9.0, 12.25, 36.0])
    expected = 2 * (variance.sum() + 4) ** 2 / (2 * (variance**2).sum() + 4 * 4 * 36)
    np.testing.assert_allclose(row.dof_ratio.iloc[[0, 3]], [1.0, expected], rtol=1e-12)


def test_budget_shares_sum_to_one(written):
    budget = load(written).budget
    total = budget.groupby(["case", "event", "t_s", "quantity", "axis"]).share_ratio.sum()
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_a_fault_is_an_interval_among_the_events(written):
    events = load(written).events
    fault = events[events.kind == "fault"].iloc[0]
    assert (fault.t_s, fault.t_end_s) == (60.0, 75.0)


def test_the_reference_climbs_as_it_was_reported(written):
    reference = load(written).reference
    row = reference[(reference.case == "aaaaaaaaaaaa") & (reference.t_s.round(6) == 50.0)].iloc[0]
    assert row.altitude_m == pytest.approx(25000.0, abs=1e-3)


def test_linear_covariance_alone_fills_its_columns_and_leaves_the_others_empty(tmp_path):
    found = load(synthetic.results(tmp_path, n_run=0))
    assert found.history.rms_si.isna().all()
    assert (found.history.run_count == 0).all()
    assert found.history.lincov_true_si.notna().all()
    assert len(found.runs) == 0
