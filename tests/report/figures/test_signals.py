"""Figures of the sky show satellites, C/N0, antennas and what channels do, over time too."""

from __future__ import annotations

import numpy as np

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.report.figures.signals import _channel_intervals, _tracking_intervals, layers_of
from lvnav_trade.results.evaluation import METRICS

CASE = "aaaaaaaaaaaa"
CASE = "aaaaaaaaaaaa"


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_satellites_show_the_counts(good):
    shown = lines(matplotlib_figure(PLOTS["satellites"](good, CASE)).axes[0])
    counts = METRICS["in_view"](good)
    counts = counts[counts.case == "imu=fine"]
    np.testing.assert_array_equal(shown["tracked"].get_ydata(), counts.tracked_count)


def test_carrier_to_noise_is_drawn_with_its_median_and_thresholds(good):
    """Eight satellites with 38 to 45 dB-Hz: 41.5 in the middle; the first alone, 38, just after the outage."""
    shown = lines(matplotlib_figure(PLOTS["satellites"](good, CASE)).axes[1])
    median = dict(zip(*shown["median of those tracked"].get_data(), strict=True))
    assert (median[50.0], median[75.0]) == (41.5, 38.0)
    assert np.isnan(median[65.0])
    assert shown["found above 33 dB-Hz"].get_ydata()[0] == 33.0
    assert shown["kept above 25 dB-Hz"].get_ydata()[0] == 25.0


def test_without_a_link_budget_there_is_no_panel_of_it(good):
    bare = type(good)(good.folder)
    bare._read["satellites"] = good.satellites.assign(cn0_db_hz=np.nan)
    assert len(matplotlib_figure(PLOTS["satellites"](bare, CASE)).axes) == 1


def test_a_fault_that_takes_satellites_has_a_sky_of_its_own(good):
    figure = matplotlib_figure(PLOTS["sky"](good, CASE))
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
    axes = matplotlib_figure(PLOTS["sky"](low, CASE)).axes[0]
    assert axes.get_ylim()[1] == 1.08 * 105.0
    assert len(axes.texts) == 8 + 2 + 4  # beside the satellites elevations and azimuths


def test_a_flight_without_an_injection_ends_with_its_last_event(good):
    rocket = type(good)(good.folder)
    rocket._read["events"] = good.events[good.events.event != "injection"]
    assert matplotlib_figure(PLOTS["sky"](rocket, CASE)).axes[-1].get_title() == "stage1 cutoff\n40 s"


def test_bars_are_stretches_between_transitions(good):
    changes = good.transitions[good.transitions.case == CASE]
    bars = _channel_intervals(changes, 99.0)
    first = bars[bars.satellite == "G01"]
    assert list(zip(first.state, first.t_s, first.t_end_s.round(6), strict=True)) == [
        ("track", 1.0, 60.0), ("lost", 60.0, 74.1), ("search", 74.1, 74.5), ("acquire", 74.5, 75.0),
        ("track", 75.0, 99.0),
    ]  # fmt: skip


def test_without_channels_bars_are_the_stretches_with_a_measurement(good):
    bars = _tracking_intervals(good.satellites[good.satellites.case == CASE])
    last = bars[bars.satellite == "G08"]
    np.testing.assert_allclose(last[["t_s", "t_end_s"]], [[1.0, 60.0], [82.0, 99.0]])
    assert set(bars.state) == {"track"}


def test_the_end_of_tracking_is_marked_with_its_reason(good):
    figure = matplotlib_figure(PLOTS["timeline"](good, CASE))
    line = next(line for line in figure.axes[0].get_lines() if line.get_label() == "tracking ends: fault")
    np.testing.assert_array_equal(line.get_xdata(), np.full(8, 60.0))
    assert sorted(line.get_ydata()) == list(range(8))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == [f"G{k:02d}" for k in range(1, 9)]


def test_true_delays_stand_above_what_the_correction_leaves(good):
    axes = matplotlib_figure(PLOTS["delays"](good, CASE)).axes
    assert [a.get_ylabel().split("\n")[0] for a in axes] == [
        "troposphere, true", "ionosphere, true", "troposphere, residual", "ionosphere, residual"
    ]  # fmt: skip
    true, left = (next(line for line in a.get_lines() if line.get_label() == "their median") for a in axes[1::2])
    known = np.isfinite(true.get_ydata())
    np.testing.assert_array_equal(true.get_ydata()[known], 5.0)
    np.testing.assert_array_equal(left.get_ydata()[known], 2.5)
    assert not known[65]  # in the outage nothing is measured


def test_a_layer_without_delay_is_not_drawn(good):
    rows = good.satellites.assign(ionosphere_m=0.0, ionosphere_left_m=0.0)
    assert layers_of(rows) == ["troposphere"]
    bare = type(good)(good.folder)
    bare._read["satellites"] = rows
    assert len(matplotlib_figure(PLOTS["delays"](bare, CASE)).axes) == 2


def test_latency_is_drawn_in_milliseconds(good):
    line = matplotlib_figure(PLOTS["latency"](good, CASE)).axes[0].get_lines()[0]
    np.testing.assert_allclose(line.get_ydata()[[0, -1]], [100.0, 300.0])
