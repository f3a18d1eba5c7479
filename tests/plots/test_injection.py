"""The picture of the injection has the runs that reach their cut-off."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots import PLOTS
from lvnav_trade.records import ORBIT
from lvnav_trade.store.read import load
from tests import synthetic
from tests.injections import rows, with_injections

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
    empty = PLOTS["injection"](plain, CASE)
    assert not [mark for panel in empty.panels for mark in panel.marks if mark.label.startswith("achieved")]
