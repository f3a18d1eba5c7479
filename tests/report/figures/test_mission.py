"""Figures of the orbit and the point of impact: runs, ellipses, trace, corridor, in the units of people."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.mission import _magnification, ellipse_points
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.evaluate import errors_at
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests.results.mechanics.test_mission_errors import falling
from tests.results.mission.test_impact import INSIDE, with_corridor


def test_dots_are_the_runs_and_ellipses_those_of_linear_covariance(tmp_path):
    tables = load(flights.results(tmp_path, n_run=80))
    figure = PLOTS["orbit"](tables, flights.CASE)
    axes = matplotlib_figure(figure).axes
    lines = {line.get_label(): line for line in axes[0].get_lines()}
    size = errors_at(tables, flights.CASE, "injection", "perigee_error").magnitude * 1e-3
    np.testing.assert_allclose(np.abs(lines["runs"].get_xdata()), size, rtol=1e-9)
    assert set(lines) == {"runs", "LinCov, true, 3 sigma", "LinCov, filter's own, 3 sigma"}
    assert axes[0].get_xlabel() == "perigee error (km)"
    assert any("99 % below" in mark.label for mark in figure.legend())


def test_where_the_orbit_is_circular_perigee_and_apogee_have_draws_and_no_ellipse(tmp_path):
    tables = load(flights.results(tmp_path, flights.CIRCULAR, n_run=0, factor=40.0))
    axes = matplotlib_figure(PLOTS["orbit"](tables, flights.CASE)).axes
    assert [line.get_label() for line in axes[0].get_lines()] == ["draws of LinCov"]
    assert "no first-order sigma" in axes[0].get_title()
    assert "LinCov, true, 3 sigma" in [line.get_label() for line in axes[1].get_lines()]


def test_an_outline_lies_at_so_many_sigmas():
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    points = ellipse_points(covariance, 2.0)
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", points, np.linalg.inv(covariance), points), 4.0, rtol=1e-12)


def test_a_flight_that_does_not_end_in_an_orbit_says_so(good):
    figure = matplotlib_figure(PLOTS["orbit"](good, "aaaaaaaaaaaa"))
    assert figure.axes[0].texts[0].get_text() == "the flight does not end in an orbit"
    assert len(figure.axes) == pytest.approx(1)


def test_trace_corridor_and_runs_are_those_of_the_table(tmp_path):
    tables = load(flights.results(tmp_path, falling(), 80, campaign=with_corridor(INSIDE)))
    figure = matplotlib_figure(PLOTS["impact"](tables, flights.CASE))
    chart, _, last = figure.axes
    rows = METRICS["impact"](tables)
    lines = {line.get_label(): line for line in chart.get_lines()}
    np.testing.assert_allclose(lines["point of impact"].get_ydata(), rows.latitude_deg)
    np.testing.assert_allclose(lines["corridor"].get_xydata()[[0, -1]], [[17.0, 28.0], [17.0, 28.0]])
    dots = next(line for line in last.get_lines() if line.get_label() == "runs")
    assert np.std(dots.get_ydata(), ddof=1) == pytest.approx(rows[rows.event == "injection"].mc_down_sigma_km.iloc[0])


@pytest.mark.parametrize(("major", "width", "times"), [(1.0, 40.0, 100.0), (5.0, 1.0, 1.0), (0.1, 20.0, 100.0)])
def test_ellipses_are_drawn_a_power_of_ten_larger(major, width, times):
    assert _magnification(major, width) == times


def test_an_orbit_has_nothing_to_draw(tmp_path):
    tables = load(flights.results(tmp_path, n_run=0))
    figure = matplotlib_figure(PLOTS["impact"](tables, flights.CASE))
    assert figure.axes[0].texts[0].get_text() == "no point of impact in the stored flight"
