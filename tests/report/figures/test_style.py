"""Marks of events and faults."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.report.figures import PLOTS, raster, style
from lvnav_trade.report.figures.figure import Events, events_of, panel, unit_of
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.report.figures.style import line_of, scale_up, share_scales

CASE = "aaaaaaaaaaaa"


def test_faults_are_shaded_and_events_are_numbered(good):
    axes = matplotlib_figure(PLOTS["satellites"](good, CASE)).axes[0]
    assert len(axes.patches) == 1
    assert {"2", "3"} == {text.get_text() for text in axes.texts}  # the first is before the first sample


def test_close_events_share_a_label_and_none_is_lost():
    times = [0.0, 3.0, 150.0, 153.0, 158.0, 500.0]
    events = Events(tuple((f"event{k}", t) for k, t in enumerate(times)), ())
    assert events.groups(-50.0, 550.0) == [(0.0, "1-2"), (150.0, "3-5"), (500.0, "6")]
    assert events.groups(100.0, 550.0)[0] == (150.0, "3-5")  # the numbers of the key, whatever is left out
    assert events.groups(-50.0, 550.0, 20) == [(0.0, "1-5"), (500.0, "6")]


def test_a_legend_has_no_more_columns_than_the_page_has_room_for():
    assert raster._column_count(["one", "two", "three", "four", "five"], 4) == 4
    assert raster._column_count(["one", "two"], 4) == 2
    assert raster._column_count(["accelerometer rate random walk"] * 8, 4) == 3
    assert raster._column_count(["a label of a case that takes more than half of the width of a page"] * 2, 2) == 1
    assert raster._column_count([], 4) == 1


def test_a_line_ends_where_rows_pause_and_begins_again():
    rows = pd.DataFrame({"case": "one", "t_s": [0.0, 1.0, 2.0, 60.0, 61.0], "anis_ratio": 1.0})
    found = style.with_gaps(rows)
    assert list(found.anis_ratio.isna()) == [False, False, False, True, False, False]
    assert 2.0 < found.t_s.iloc[3] < 60.0
    assert style.with_gaps(rows[:3]).equals(rows[:3])


def test_numbers_of_events_have_a_key(good):
    figure = PLOTS["trajectory"](good, CASE)
    assert figure.key == "1 liftoff · 2 stage1 cutoff · 3 injection · shaded: satellite outage 1"
    names = {text.get_text() for text in matplotlib_figure(figure).axes[0].texts}
    assert names == {"1", "2", "3"}


def test_a_key_of_many_events_has_lines_that_fit_the_page_and_loses_none():
    names = [f"stage{number}_separation" for number in range(20)]
    lines = Events(tuple((name, float(k)) for k, name in enumerate(names)), ()).key().split("\n")
    assert len(lines) == 5
    assert max(len(line) for line in lines) <= 105
    assert [word for word in " ".join(lines).split() if "stage" in word] == [f"stage{number}" for number in range(20)]
    assert Events((), ()).key() == ""


def test_a_fault_of_a_moment_is_a_line(good):
    figure, axes = panel(2.0)
    axes.plot([-5.0, 100.0], [0.0, 1.0])
    axes.events = events_of(good.events[good.events.case == CASE].assign(t_end_s=lambda rows: rows.t_s))
    found = matplotlib_figure(figure).axes[0]
    assert len(found.patches) == 0
    assert [60.0, 60.0] in [list(line.get_xdata()) for line in found.get_lines()]


def test_figures_of_a_section_share_one_scale_and_those_of_one_label_their_limits():
    figures = []
    for label, values in (("a (m)", [1.0, 2.0]), ("a (m)", [3.0, 4.0]), ("b (m/s)", [0.01, 9.0])):
        figure, ax = panel(2.0)
        ax.plot([0.0, 1.0], values)
        ax.set(ylabel=label)
        scale_up(ax, "y", values)
        figures.append(figure)
    share_scales(figures)
    axes = [figure.panels[0] for figure in figures]
    assert {ax.axes["yscale"] for ax in axes} == {"log"}
    assert axes[0].axes["ylim"] == axes[1].axes["ylim"] != axes[2].axes["ylim"]
    assert [ax.label("y") for ax in axes] == ["a (m, log)", "a (m, log)", "b (m/s, log)"]
    assert unit_of("3D RMS (m/s; short dashes: LinCov)") == "m/s"


def test_six_cases_differ_in_dashes_as_well_as_in_colour():
    looks = [line_of(number) for number in range(6)]
    assert len({str(look["ls"]) for look in looks}) == len({look["color"] for look in looks}) == 6
