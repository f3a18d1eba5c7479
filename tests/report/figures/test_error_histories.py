"""Figures of errors, of chosen cases too, show the tables."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.error_histories import autocorrelation, errors, relative
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.margins import worst_runs
from lvnav_trade.results.statistics.select import pick
from lvnav_trade.results.tables.read import load
from tests import synthetic

CASE = "aaaaaaaaaaaa"
CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_envelope_shows_the_history_in_the_units_of_people(good):
    figure = matplotlib_figure(PLOTS["envelope"](good, CASE, "attitude"))
    axes = figure.axes[0]
    assert axes.get_ylabel() == "roll, RMS or\n1 sigma (mrad)"
    history = good.history
    rows = history[(history.case == CASE) & (history.quantity == "attitude") & (history.axis == "roll")]
    shown = lines(axes)
    np.testing.assert_array_equal(shown["Monte Carlo RMS, 80 runs (95 % band)"].get_ydata(), rows.rms_si * 1e3)
    np.testing.assert_array_equal(shown["LinCov, filter's own"].get_ydata(), rows.lincov_formal_si * 1e3)
    np.testing.assert_array_equal(shown["filter's own sigma"].get_ydata(), rows.filter_sigma_si * 1e3)
    np.testing.assert_array_equal(shown["LinCov, true error"].get_xdata(), rows.t_s)


def test_comparison_shows_every_case(good):
    shown = lines(matplotlib_figure(PLOTS["comparison"](good, "position")).axes[0])
    history = good.history
    for case, label in good.labels.items():
        rows = history[(history.case == case) & (history.quantity == "position") & (history.axis == "3d")]
        np.testing.assert_array_equal(shown[label].get_ydata(), rows.rms_si)


def test_ranking_bars_are_the_ranking(good):
    axes = matplotlib_figure(PLOTS["rank"](good)).axes[0]
    widths = [patch.get_width() for patch in axes.patches]
    np.testing.assert_allclose(widths, METRICS["ranking"](good).velocity)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    from lvnav_trade.results.tables.read import load

    return load(synthetic.results(tmp_path_factory.mktemp("chosen"), n_run=40))


def test_errors_are_those_of_the_cases_and_the_phase_that_are_asked_for(tables):
    ax = matplotlib_figure(errors(tables, "velocity", [{"imu": "coarse"}], "north", "liftoff to stage1_cutoff")).axes[0]
    runs, expected = ax.get_lines()[:2]
    assert runs.get_label() == "imu=coarse"
    history = tables.history
    rows = history[(history.case == "bbbbbbbbbbbb") & (history.quantity == "velocity") & (history.axis == "north")]
    rows = rows[rows.t_s.between(0.0, 40.0)]
    np.testing.assert_allclose(runs.get_ydata(), rows.rms_si)
    np.testing.assert_allclose(expected.get_ydata(), rows.lincov_true_si)
    assert "velocity error, north RMS" in ax.get_ylabel()


def test_all_cases_are_drawn_where_none_is_chosen(tables):
    labels = [line.get_label() for line in matplotlib_figure(errors(tables, "position")).axes[0].get_lines()]
    assert {"imu=fine", "imu=coarse"} <= set(labels)


def test_every_case_has_a_panel_with_a_line_per_channel(tables):
    figure = matplotlib_figure(autocorrelation(tables, [{"imu": "fine"}], "rate"))
    panel = next(ax for ax in figure.axes if ax.get_title() == "imu=fine")
    assert len(panel.get_lines()) == synthetic.N_SAT
    assert list(panel.get_lines()[0].get_xdata()) == list(range(1, 11))


def test_relative_errors_are_over_those_of_the_first_case(tables):
    ax = matplotlib_figure(
        relative(tables, "velocity", [{"imu": "fine"}, {"imu": "coarse"}], "north", "liftoff to stage1_cutoff")
    ).axes[0]
    lines = {line.get_label(): line for line in ax.get_lines()}
    history = tables.history
    rows = history[(history.quantity == "velocity") & (history.axis == "north") & history.t_s.between(0.0, 40.0)]
    fine, coarse = (rows[rows.case == case] for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb"))
    over = lines["imu=coarse"].get_ydata()
    np.testing.assert_allclose(over, coarse.rms_si.to_numpy() / fine.rms_si.to_numpy())
    own = lines["dots: filter's own sigma over its true error"].get_ydata()
    np.testing.assert_allclose(own, fine.lincov_formal_si / np.hypot(fine.lincov_true_si, fine.lincov_mean_si))


def test_consistency_shows_the_tests(good):
    axes = matplotlib_figure(PLOTS["consistency"](good, CASE)).axes
    for panel, name, value in ((axes[0], "nees", "anees_ratio"), (axes[1], "nis", "anis_ratio")):
        frame = METRICS[name](good)
        np.testing.assert_array_equal(lines(panel)["Monte Carlo"].get_ydata(), frame[frame.case == "imu=fine"][value])


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("watched"), n_run=8, size=8, logic=True))


def test_the_legend_names_the_modes_that_occur(watched):
    figure = matplotlib_figure(PLOTS["logic"](watched, watched.cases.case[0]))
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"waiting", "converging", "aiding", "predicting", "stopped"} <= named


def test_without_a_logic_it_says_so(good):
    figure = matplotlib_figure(PLOTS["logic"](good, good.cases.case[0]))
    assert "no mode logic" in figure.axes[0].texts[0].get_text()


def test_a_worst_run_is_the_one_of_the_table_of_runs_up_to_its_failure(good, tmp_path):
    row = worst_runs(good).iloc[0]
    figure = matplotlib_figure(PLOTS["worst_run"](good, row.case, str(row.run_number)))
    runs = pick(good.runs, case=row.case, event="injection")
    at_injection = runs[runs.run_number == row.run_number].iloc[0]
    for axes, quantity, unit, factor in zip(
        figure.axes, ("attitude", "velocity", "position"), ("rad", "m_per_s", "m"), (1e3, 1.0, 1.0), strict=True
    ):
        error = lines(axes)[f"run {row.run_number}"].get_ydata()
        assert error[-1] == pytest.approx(factor * at_injection[f"{quantity}_3d_error_{unit}"], rel=1e-12)
    failed = load(synthetic.results(tmp_path, n_run=40, failing=(7,)))
    run = worst_runs(failed).iloc[0]
    assert (run.run_number, run.error) == (7, np.inf)
    until = failed.runs[(failed.runs.case == run.case) & (failed.runs.run_number == 7)].t_failed_s.iloc[0]
    axes = matplotlib_figure(PLOTS["worst_run"](failed, run.case, "7")).axes[0]
    shown = lines(axes)["run 7"]
    assert np.nanmax(np.where(np.isfinite(shown.get_ydata()), shown.get_xdata(), np.nan)) < until


def test_a_run_that_is_not_kept_is_said(good):
    assert (
        "is not kept over time" in matplotlib_figure(PLOTS["worst_run"](good, CASE, "1000")).axes[0].texts[0].get_text()
    )
