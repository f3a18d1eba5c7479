"""Lines under other lines are widened: as many steps as solid lines lie over them."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.report.figures.figure import panel
from lvnav_trade.report.figures.overlap import widen_covered

T = np.linspace(0.0, 100.0, 101)


def widths(*lines, **axes):
    figure, ax = panel(2.0)
    for number, (y, style) in enumerate(lines):
        ax.plot(T, y, **{"label": f"line {number}"} | style)
    ax.set(**axes)
    widen_covered(figure)
    return [mark.style.get("lw", 1.5) for mark in ax.marks]


def test_three_equal_lines_are_seen_as_three():
    assert widths((T, {}), (T, {}), (T, {}), (2.0 * T, {})) == [5.5, 3.5, 1.5, 1.5]


@pytest.mark.parametrize(
    "style", [{"ls": "--"}, {"label": ""}, {"ls": "none", "marker": "o"}], ids=["dashed", "no label", "markers"]
)
def test_what_leaves_gaps_or_has_no_name_hides_nothing(style):
    assert widths((T, {}), (T, style), (2.0 * T, {})) == [1.5, 1.5, 1.5]


def test_lines_that_meet_for_a_moment_stay_as_they_are():
    assert widths((T, {}), (100.0 - T, {})) == [1.5, 1.5]


def test_nearness_is_that_of_the_scale():
    """A factor of two is a hair over five decades, and far apart where the largest values count."""
    near, far = 10.0 ** (T / 20.0), 1.02 * 10.0 ** (T / 20.0)
    assert widths((near, {}), (far, {}), yscale="log") == [3.5, 1.5]
    small, double = np.full(101, 1.0), np.full(101, 2.0)
    assert widths((small, {}), (double, {}), (1e3 * T + 1.0, {}))[0] == 3.5


def test_gaps_are_no_points():
    y = np.where(T < 50.0, T, np.nan)
    assert widths((y, {}), (T, {})) == [3.5, 1.5]
    assert widths((np.full(101, np.nan), {}), (T, {})) == [1.5, 1.5]
