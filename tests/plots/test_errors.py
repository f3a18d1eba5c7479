"""Figures of errors show the tables."""

from __future__ import annotations

import numpy as np

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS

CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_envelope_shows_the_history_in_the_units_of_people(good):
    figure = PLOTS["envelope"](good, CASE, "attitude")
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
    shown = lines(PLOTS["comparison"](good, "position").axes[0])
    history = good.history
    for case, label in good.labels.items():
        rows = history[(history.case == case) & (history.quantity == "position") & (history.axis == "3d")]
        np.testing.assert_array_equal(shown[label].get_ydata(), rows.rms_si)


def test_ranking_bars_are_the_ranking(good):
    axes = PLOTS["rank"](good).axes[0]
    widths = [patch.get_width() for patch in axes.patches]
    np.testing.assert_allclose(widths, METRICS["ranking"](good).velocity)
