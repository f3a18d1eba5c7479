"""A figure shows the table: golden values of plotted lines; every axis is labelled."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.style import look
from lvnav_trade.store import load
from tests import synthetic

CASE = "aaaaaaaaaaaa"
ARGUMENTS = {
    "trajectory": (CASE,),
    "satellites": (CASE,),
    "sky": (CASE,),
    "envelope": (CASE, "velocity"),
    "comparison": ("position",),
    "rank": (),
    "budget": (CASE, "position"),
    "consistency": (CASE,),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("plots"), n_run=80))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("alone"), n_run=0))


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


@pytest.mark.parametrize("name", PLOTS)
def test_every_axis_is_labelled(name, good):
    figure = PLOTS[name](good, *ARGUMENTS[name])
    for axes in figure.axes:
        shared = axes.get_subplotspec().get_gridspec().nrows > 1 and not axes.get_subplotspec().is_last_row()
        assert axes.get_xlabel() or (shared and name in ("envelope", "consistency"))
        assert axes.get_ylabel() or name == "sky" or (name == "rank" and not axes.get_subplotspec().is_first_col())


@pytest.mark.parametrize("name", PLOTS)
@pytest.mark.parametrize("which", ["good", "alone"])
def test_every_figure_can_be_saved(name, which, request, tmp_path):
    figure = PLOTS[name](request.getfixturevalue(which), *ARGUMENTS[name])
    with look():
        figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 5000


def test_envelope_shows_the_history_in_the_units_of_people(good):
    figure = PLOTS["envelope"](good, CASE, "attitude")
    axes = figure.axes[0]
    assert axes.get_ylabel() == "roll (mrad, 1 sigma)"
    history = good.history
    rows = history[(history.case == CASE) & (history.quantity == "attitude") & (history.axis == "roll")]
    shown = lines(axes)
    np.testing.assert_array_equal(shown["Monte Carlo RMS, 80 runs (95 % band)"].get_ydata(), rows.rms_si * 1e3)
    np.testing.assert_array_equal(shown["LinCov, filter's own"].get_ydata(), rows.lincov_formal_si * 1e3)
    np.testing.assert_array_equal(shown["filter's own sigma"].get_ydata(), rows.filter_sigma_si * 1e3)
    np.testing.assert_array_equal(shown["LinCov, true error"].get_xdata(), rows.t_s)


def test_comparison_shows_every_case(good):
    shown = lines(PLOTS["comparison"](good, "position").axes[0])
    history = good.history
    for case, label in good.labels.items():
        rows = history[(history.case == case) & (history.quantity == "position") & (history.axis == "3d")]
        np.testing.assert_array_equal(shown[label].get_ydata(), rows.rms_si)


def test_satellites_show_the_counts(good):
    shown = lines(PLOTS["satellites"](good, CASE).axes[0])
    counts = METRICS["in_view"](good)
    counts = counts[counts.case == "imu=fine"]
    np.testing.assert_array_equal(shown["tracked"].get_ydata(), counts.tracked_count)


def test_consistency_shows_the_tests(good):
    axes = PLOTS["consistency"](good, CASE).axes
    for panel, name, value in ((axes[0], "nees", "anees_ratio"), (axes[1], "nis", "anis_ratio")):
        frame = METRICS[name](good)
        np.testing.assert_array_equal(lines(panel)["Monte Carlo"].get_ydata(), frame[frame.case == "imu=fine"][value])


def test_ranking_bars_are_the_ranking(good):
    axes = PLOTS["rank"](good).axes[0]
    widths = [patch.get_width() for patch in axes.patches]
    np.testing.assert_allclose(widths, METRICS["ranking"](good).velocity)


def test_trajectory_shows_altitude_in_km(good):
    reference = good.reference[good.reference.case == CASE]
    line = PLOTS["trajectory"](good, CASE).axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), reference.altitude_m / 1e3)


def test_faults_are_shaded_and_events_are_named(good):
    axes = PLOTS["satellites"](good, CASE).axes[0]
    assert len(axes.patches) == 1
    assert {"stage1 cutoff", "injection"} <= {text.get_text() for text in axes.texts}
