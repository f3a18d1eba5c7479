"""The Allan deviation of the units as drawn: dots of the stream on the line of the card, parts in their own dashes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.report.figures.vehicle_motion import allan_of_log
from lvnav_trade.report.flight import allan as section
from tests.synthetic import with_allan_curves


def test_a_panel_has_the_card_as_a_line_and_the_stream_as_dots(good):
    case, tables = with_allan_curves(good)
    figure = matplotlib_figure(PLOTS["allan"](tables, case))
    gyro, accel = figure.axes[:2]
    assert (gyro.get_ylabel(), accel.get_ylabel()) == ("gyro\n(deg/h, log)", "accelerometer\n(mg, log)")
    lines = {line.get_label(): line for line in gyro.get_lines()}
    assert set(lines) == {"card", "white noise", "random walk", "simulated"}  # no bias instability in the card
    np.testing.assert_allclose(lines["simulated"].get_ydata(), 1.1 * lines["card"].get_ydata())
    assert lines["simulated"].get_linestyle() == "None"
    assert gyro.get_xscale() == gyro.get_yscale() == "log"


def test_a_section_stands_on_the_page_where_a_stream_was_asked_for(good):
    _, tables = with_allan_curves(good)
    assert len(section(tables)) == 3
    assert section(good) == []


def test_a_log_has_a_panel_for_each_axis_with_the_fit_and_its_interval():
    tau = np.geomspace(0.1, 100.0, 7)
    names = [f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz"]
    curves = pd.concat([
        pd.DataFrame({"sensor": name, "tau_s": tau, "deviation_si": 1e-3 / tau, "low_si": 9e-4 / tau,
                      "high_si": 1.1e-3 / tau, "model_si": 1e-3 / tau}) for name in names
    ])  # fmt: skip
    figure = matplotlib_figure(allan_of_log(curves))
    assert [axes.get_ylabel() for axes in figure.axes[2:4]] == ["gyro z (deg/h, log)", "accelerometer x (mg, log)"]
    fit = next(line for line in figure.axes[0].get_lines() if line.get_label() == "fit")
    np.testing.assert_allclose(fit.get_ydata(), 206.26480624709636 / tau)
    assert len(figure.axes) == 6
