"""The bars of the timeline are the receiver's transitions."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.timeline import _from_changes, _from_rows

CASE = "aaaaaaaaaaaa"


def test_bars_are_stretches_between_transitions(good):
    changes = good.transitions[good.transitions.case == CASE]
    bars = _from_changes(changes, 99.0)
    first = bars[bars.satellite == "G01"]
    assert list(zip(first.state, first.t_s, first.t_end_s.round(6), strict=True)) == [
        ("track", 1.0, 60.0), ("lost", 60.0, 74.1), ("search", 74.1, 74.5), ("acquire", 74.5, 75.0),
        ("track", 75.0, 99.0),
    ]  # fmt: skip


def test_without_channels_bars_are_the_stretches_with_a_measurement(good):
    bars = _from_rows(good.satellites[good.satellites.case == CASE])
    last = bars[bars.satellite == "G08"]
    np.testing.assert_allclose(last[["t_s", "t_end_s"]], [[1.0, 60.0], [82.0, 99.0]])
    assert set(bars.state) == {"track"}


def test_the_end_of_tracking_is_marked_with_its_reason(good):
    figure = PLOTS["timeline"](good, CASE)
    line = next(line for line in figure.axes[0].get_lines() if line.get_label() == "tracking ends: fault")
    np.testing.assert_array_equal(line.get_xdata(), np.full(8, 60.0))
    assert sorted(line.get_ydata()) == list(range(8))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == [f"G{k:02d}" for k in range(1, 9)]
