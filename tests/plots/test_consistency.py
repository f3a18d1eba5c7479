"""Figures of the filter show the tests, and every mode of its logic that occurs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.store import load
from tests import synthetic

CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_consistency_shows_the_tests(good):
    axes = PLOTS["consistency"](good, CASE).axes
    for panel, name, value in ((axes[0], "nees", "anees_ratio"), (axes[1], "nis", "anis_ratio")):
        frame = METRICS[name](good)
        np.testing.assert_array_equal(lines(panel)["Monte Carlo"].get_ydata(), frame[frame.case == "imu=fine"][value])


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("watched"), n_run=8, size=8, logic=True))


def test_the_legend_names_the_modes_that_occur(watched):
    figure = PLOTS["logic"](watched, watched.cases.case[0])
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"waiting", "converging", "aiding", "predicting", "stopped"} <= named


def test_without_a_logic_it_says_so(good):
    figure = PLOTS["logic"](good, good.cases.case[0])
    assert "no logic" in figure.axes[0].texts[0].get_text()
