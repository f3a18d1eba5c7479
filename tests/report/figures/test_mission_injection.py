"""The picture of the injection has the runs that reach their cut-off."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.records import ORBIT
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import SIZES, SOURCES, rows, with_injections

CASE = synthetic.CASES[0][0].id


def test_perigee_and_apogee_of_every_injected_run(tmp_path):
    plain = load(synthetic.results(tmp_path / "guided", n_run=8, size=8))
    figure = PLOTS["injection"](with_injections(plain), CASE)
    marks = {mark.label: mark.data for mark in figure.panels[0].marks if mark.label}
    error = rows()[:6, 3:] * 1e-3
    np.testing.assert_allclose(marks["achieved less target"]["x"], error[:, ORBIT.index("perigee")])
    np.testing.assert_allclose(marks["achieved less target"]["y"], error[:, ORBIT.index("apogee")])
    assert len(marks["achieved less navigated"]["x"]) == 6
    assert len(figure.panels) == 2
    k = ORBIT.index("perigee")
    ellipse = marks["LinCov, 3 sigma"]["x"]
    reach = 3.0 * np.linalg.norm(list(SOURCES.values())) * SIZES[k] * 1e-3
    assert np.ptp(ellipse) == pytest.approx(2.0 * reach, rel=1e-3)
    assert np.mean([ellipse.max(), ellipse.min()]) == pytest.approx(0.1 * SIZES[k] * 1e-3, abs=1e-3)
    empty = PLOTS["injection"](plain, CASE)
    assert not [mark for panel in empty.panels for mark in panel.marks if mark.label.startswith("achieved")]
