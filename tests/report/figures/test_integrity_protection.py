"""Protection levels as drawn: above what they are without faults, beside the true error."""

from __future__ import annotations

import numpy as np

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.report.flight import protection as section
from tests.synthetic import with_protection_levels


def test_a_panel_has_both_levels_and_the_true_error(good):
    case, tables = with_protection_levels(good)
    figure = matplotlib_figure(PLOTS["protection"](tables, case))
    position, velocity = figure.axes[:2]
    assert position.get_ylabel() == "position (m, log)"
    assert velocity.get_ylabel() == "velocity (m/s, log)"
    lines = {line.get_label(): line for line in position.get_lines()}
    assert {"protection level", "without faults", "runs (RMS)"} <= set(lines)
    level, free = (lines[name].get_ydata() for name in ("protection level", "without faults"))
    np.testing.assert_allclose(level, 1.5 * np.asarray(free))


def test_a_section_stands_on_the_page_where_levels_were_asked_for(good):
    _, tables = with_protection_levels(good)
    numbers = {"integrity_risk": 1e-3, "false_alarm": 1e-3, "satellite_fault": 1e-4}
    tables.campaign["covariance"] = {"protection": numbers}
    blocks = section(tables)
    assert "0.001" in blocks[0].text
    assert len(blocks) >= 3
    assert section(good) == []
