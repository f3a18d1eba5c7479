"""The figure of a statement along its axis holds the numbers that it shows."""

from __future__ import annotations

import numpy as np

from lvnav_studies.figures import bound
from lvnav_trade.report.figures.raster import matplotlib_figure


def test_the_value_of_a_statement_stands_over_its_axis_with_its_bounds(good):
    size = {"metric": "velocity_error_3d", "at": "injection"}
    stated = {"value": "a", "terms": {"a": size}, "unit": "cm/s", "along": "imu", "at_least": 20.0, "at_most": 70.0}
    ax = matplotlib_figure(bound(good, stated)).axes[0]
    lines = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    np.testing.assert_allclose(lines["formal"], 199.5 * np.sqrt(0.1**2 + 0.12**2 + 0.2**2) * np.array([1.0, 3.0]))
    assert sorted(float(line.get_ydata()[0]) for line in ax.get_lines() if line.get_label() == "bound") == [20.0, 70.0]
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["fine", "coarse"]
