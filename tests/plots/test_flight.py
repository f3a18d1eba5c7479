"""The figure of the flight shows the tables."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots import PLOTS

CASE = "aaaaaaaaaaaa"


def test_trajectory_shows_altitude_in_km(good):
    reference = good.reference[good.reference.case == CASE]
    line = PLOTS["trajectory"](good, CASE).axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), reference.altitude_m / 1e3)
