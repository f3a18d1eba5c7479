"""Tables of the covariance diagnostics."""

from __future__ import annotations

import numpy as np

from lvnav_trade.results.tables.diagnostics_tables import diagnostics_rows
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.synthetic import covariance

COV = covariance()
EXPLAINED = ("covariances", "adjoint", "sensitivity", "observability", "nonlinearity", "error_bound")


def test_the_upper_triangle_of_every_covariance_is_stored(written):
    rows = load(written).covariances
    rows = rows[(rows.case == "aaaaaaaaaaaa") & (rows.event == "injection") & (rows.quantity == "velocity")]
    assert len(rows) == (1 + len(synthetic.SOURCES)) * 6
    whole = rows[rows.source == ""].set_index(["axis", "other_axis"])
    assert whole.true_si2["north", "north"] == COV.true_cov[-1, 3, 3]
    assert whole.formal_si2["down", "down"] == COV.formal_cov[-1, 5, 5]
    assert rows[rows.source != ""].formal_si2.isna().all()


def test_contributions_to_a_norm_are_the_sum_over_its_axes(written):
    rows = load(written).adjoint
    rows = rows[(rows.case == "aaaaaaaaaaaa") & (rows.quantity == "position")]
    by_axis = rows.groupby("axis").variance_si2.sum()
    np.testing.assert_allclose(by_axis["3d"], by_axis.drop("3d").sum(), rtol=1e-12)


def test_without_an_explanation_only_the_covariances_have_rows(tmp_path):
    assert list(diagnostics_rows(synthetic.prepared_case(), COV, None)) == ["covariances"]
    tables = load(synthetic.results(tmp_path, n_run=0, explained=False))
    assert {name for name in EXPLAINED if len(getattr(tables, name))} == {"covariances"}
