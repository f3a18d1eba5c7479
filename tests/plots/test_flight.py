"""Figures of the flight and the sky show the tables."""

from __future__ import annotations

import numpy as np

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS

CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_satellites_show_the_counts(good):
    shown = lines(PLOTS["satellites"](good, CASE).axes[0])
    counts = METRICS["in_view"](good)
    counts = counts[counts.case == "imu=fine"]
    np.testing.assert_array_equal(shown["tracked"].get_ydata(), counts.tracked_count)


def test_trajectory_shows_altitude_in_km(good):
    reference = good.reference[good.reference.case == CASE]
    line = PLOTS["trajectory"](good, CASE).axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), reference.altitude_m / 1e3)
