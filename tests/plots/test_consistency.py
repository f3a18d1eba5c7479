"""The figure of consistency shows the tests."""

from __future__ import annotations

import numpy as np

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS

CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_consistency_shows_the_tests(good):
    axes = PLOTS["consistency"](good, CASE).axes
    for panel, name, value in ((axes[0], "nees", "anees_ratio"), (axes[1], "nis", "anis_ratio")):
        frame = METRICS[name](good)
        np.testing.assert_array_equal(lines(panel)["Monte Carlo"].get_ydata(), frame[frame.case == "imu=fine"][value])
