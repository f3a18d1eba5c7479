"""Linear covariance of an injection, from tables: what was stored comes back."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.injection_covariance import merge_sources
from lvnav_trade.results.statistics.case_tables import stored_injection_law
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import law, with_injections

CASE = synthetic.CASES[0][0].id


def test_a_law_that_was_stored_comes_back(tmp_path):
    plain = load(synthetic.results(tmp_path / "guided", n_run=8, size=8))
    assert stored_injection_law(plain, CASE) is None
    mine, stored = law(), stored_injection_law(with_injections(plain), CASE)
    for name in ("reference", "target", "mean", "covariance"):
        np.testing.assert_allclose(getattr(stored, name), getattr(mine, name), rtol=1e-12)
    assert (stored.sources, stored.n_navigation) == (mine.sources, mine.n_navigation)
    np.testing.assert_allclose(stored.knowledge.sum(axis=0), mine.knowledge.sum(axis=0))
    together = merge_sources(mine)
    assert together.sources == ("navigation", "vehicle")
    np.testing.assert_allclose(together.covariance.sum(axis=0), mine.covariance.sum(axis=0))
