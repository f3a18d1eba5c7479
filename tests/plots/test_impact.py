"""The figure of the point of impact shows trace, corridor, sigmas and the last ellipse."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.impact import _magnification
from lvnav_trade.store import load
from tests import mission as flights
from tests.metrics.mechanics.test_mission import falling
from tests.metrics.mission.test_impact import INSIDE, with_corridor


def test_trace_corridor_and_runs_are_those_of_the_table(tmp_path):
    tables = load(flights.results(tmp_path, falling(), 80, campaign=with_corridor(INSIDE)))
    figure = PLOTS["impact"](tables, flights.CASE)
    chart, last = figure.axes[-1], figure.axes[1]
    rows = METRICS["impact"](tables)
    lines = {line.get_label(): line for line in chart.get_lines()}
    np.testing.assert_allclose(lines["point of impact"].get_ydata(), rows.latitude_deg)
    assert chart.patches[0].get_label() == "corridor"
    np.testing.assert_allclose(chart.patches[0].get_xy()[0], [17.0, 28.0])
    dots = next(line for line in last.get_lines() if line.get_label() == "runs")
    assert np.std(dots.get_ydata(), ddof=1) == pytest.approx(rows[rows.event == "injection"].mc_down_sigma_km.iloc[0])


@pytest.mark.parametrize(("major", "width", "times"), [(1.0, 40.0, 100.0), (5.0, 1.0, 1.0), (0.1, 20.0, 100.0)])
def test_ellipses_are_drawn_a_power_of_ten_larger(major, width, times):
    assert _magnification(major, width) == times


def test_an_orbit_has_nothing_to_draw(tmp_path):
    tables = load(flights.results(tmp_path, n_run=0))
    figure = PLOTS["impact"](tables, flights.CASE)
    assert figure.axes[0].texts[0].get_text() == "no point of impact in the stored flight"
