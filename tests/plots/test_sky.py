"""Figures of the sky show satellites, C/N0, antennas and what channels do."""

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


def test_carrier_to_noise_is_drawn_with_its_median_and_thresholds(good):
    """Eight satellites with 38 to 45 dB-Hz: 41.5 in the middle; the first alone, 38, just after the outage."""
    shown = lines(PLOTS["satellites"](good, CASE).axes[1])
    median = dict(zip(*shown["median of those tracked"].get_data(), strict=True))
    assert (median[50.0], median[75.0]) == (41.5, 38.0)
    assert np.isnan(median[65.0])
    assert shown["found above 33 dB-Hz"].get_ydata()[0] == 33.0
    assert shown["kept above 25 dB-Hz"].get_ydata()[0] == 25.0


def test_without_a_link_budget_there_is_no_panel_of_it(good):
    bare = type(good)(good.folder)
    bare._read["satellites"] = good.satellites.assign(cn0_db_hz=np.nan)
    assert len(PLOTS["satellites"](bare, CASE).axes) == 1


def test_a_fault_that_takes_satellites_has_a_sky_of_its_own(good):
    figure = PLOTS["sky"](good, CASE)
    assert [axes.get_title() for axes in figure.axes] == [
        "lift-off\n1 s", "satellite outage 1\n74 s", "injection\n99 s"
    ]  # fmt: skip
    before, within, _ = figure.axes
    assert sum(line.get_marker() in "os" for line in before.get_lines() if len(line.get_xdata())) == 2
    assert {line.get_color() for line in within.get_lines() if line.get_marker() in "os" and len(line.get_xdata())} == {
        "#D55E00"
    }
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"tracked", "lost", "antenna 1", "antenna 2"}


def test_satellites_below_the_local_horizontal_are_shown_where_they_are_tracked(good):
    low = type(good)(good.folder)
    low._read["satellites"] = good.satellites.assign(elevation_rad=good.satellites.elevation_rad - 0.3)
    axes = PLOTS["sky"](low, CASE).axes[0]
    assert axes.get_ylim()[1] == 105.0
    assert len(axes.texts) == 8


def test_a_flight_without_an_injection_ends_with_its_last_event(good):
    rocket = type(good)(good.folder)
    rocket._read["events"] = good.events[good.events.event != "injection"]
    assert PLOTS["sky"](rocket, CASE).axes[-1].get_title() == "stage1 cutoff\n40 s"
