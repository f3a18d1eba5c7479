"""Figures over numeric axes."""

from __future__ import annotations

import json

import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from tests.results.requirements.test_limit_crossings import FACTORS, LIMIT, tables


def test_curves_have_a_panel_for_every_requirement_with_its_limit_and_crossing(tmp_path):
    figure = matplotlib_figure(PLOTS["curves"](tables(tmp_path, [f"{factor} deg" for factor in FACTORS]), "heading"))
    assert [ax.get_ylabel() for ax in figure.axes] == ["north (m)", "fast (m/s)"]
    lines = figure.axes[0].lines
    assert [line.get_linestyle() for line in lines].count("--") == 1
    assert LIMIT in [line.get_ydata()[0] for line in lines if line.get_linestyle() == "--"]
    assert [len(line.get_xdata()) for line in lines if line.get_marker() == "x"] == [1]


def test_a_tornado_has_a_bar_for_every_axis(tmp_path):
    levels = [{"heading": "base", "imu": "base"}, {"heading": "3 deg", "imu": "base"}]
    found = tables(tmp_path, ["1 deg", "3 deg"], design="one_at_a_time", levels=levels)
    (ax,) = matplotlib_figure(PLOTS["tornado"](found, "north")).axes
    assert [label.get_text() for label in ax.get_yticklabels()] == ["imu", "heading"]
    widths = [bar.get_width() for bar in ax.patches]
    assert widths[0] == pytest.approx(0.0)
    assert widths[1] > 0.0
    assert json.dumps(levels[0]) in list(found.cases["axes"])
