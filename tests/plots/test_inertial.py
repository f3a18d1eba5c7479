"""The Allan deviation of the units as drawn: dots of the stream on the line of the card, parts in their own dashes."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.raster import drawn
from lvnav_trade.report.flight import allan as section
from tests.synthetic import with_allan_curves


def test_a_panel_has_the_card_as_a_line_and_the_stream_as_dots(good):
    case, tables = with_allan_curves(good)
    figure = drawn(PLOTS["allan"](tables, case))
    gyro, accel = figure.axes[:2]
    assert (gyro.get_ylabel(), accel.get_ylabel()) == ("gyro\n(deg/h)", "accelerometer\n(mg)")
    lines = {line.get_label(): line for line in gyro.get_lines()}
    assert set(lines) == {"card", "white noise", "random walk", "simulated stream"}  # no bias instability in the card
    np.testing.assert_allclose(lines["simulated stream"].get_ydata(), 1.1 * lines["card"].get_ydata())
    assert lines["simulated stream"].get_linestyle() == "None"
    assert gyro.get_xscale() == gyro.get_yscale() == "log"


def test_a_section_stands_on_the_page_where_a_stream_was_asked_for(good):
    _, tables = with_allan_curves(good)
    assert len(section(tables)) == 3
    assert section(good) == []
