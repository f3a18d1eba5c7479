"""Marks of events and faults."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.plots import PLOTS, style

CASE = "aaaaaaaaaaaa"


def test_faults_are_shaded_and_events_are_named(good):
    axes = PLOTS["satellites"](good, CASE).axes[0]
    assert len(axes.patches) == 1
    assert {"stage1 cutoff", "injection"} <= {text.get_text() for text in axes.texts}


def test_close_events_share_one_name_and_none_is_lost():
    times = np.array([0.0, 8.0, 150.0, 153.0, 158.0, 183.0])
    assert style._groups(times, 20.0) == [(0, 1), (2, 4), (5, 5)]
    names = [["stage1_cutoff", "stage1_separation", "stage2_ignition"], ["fairing", "injection"]]
    shown = style._apart(names, np.array([0.0, 3.0]), [False, False])
    assert shown == ["stage1_cutoff ... stage2_ignition", "fairing, injection"]


def test_names_near_the_right_edge_lean_left_from_the_widest_gap_on():
    assert style._leftward([0.1, 0.3, 0.8, 0.95]) == [False, False, True, True]
    assert style._leftward([0.1, 0.5, 0.6, 0.95]) == [False, False, False, True]
    assert style._leftward([0.1, 0.3, 0.8]) == [False, False, False]
    assert style._leftward([0.9]) == [True]
    assert style._leftward([]) == []


def test_a_legend_has_no_more_columns_than_the_page_has_room_for():
    assert style._fitting(["one", "two", "three", "four", "five"], 4) == 4
    assert style._fitting(["one", "two"], 4) == 2
    assert style._fitting(["accelerometer rate random walk"] * 8, 4) == 3
    assert style._fitting(["a label of a case that takes more than half of the width of a page"] * 2, 2) == 1
    assert style._fitting([], 4) == 1


def test_a_line_ends_where_rows_pause_and_begins_again():
    rows = pd.DataFrame({"case": "one", "t_s": [0.0, 1.0, 2.0, 60.0, 61.0], "anis_ratio": 1.0})
    found = style.with_gaps(rows)
    assert list(found.anis_ratio.isna()) == [False, False, False, True, False, False]
    assert 2.0 < found.t_s.iloc[3] < 60.0
    assert style.with_gaps(rows[:3]).equals(rows[:3])


def test_names_that_would_meet_are_those_of_the_first_event_of_each():
    groups = [["liftoff"], ["stage3_separation", "stage4_ignition"], ["injection", "stage4_cutoff"]]
    leaning = [False, False, True]
    wide = style._apart(groups, np.array([0.0, 3.0, 6.0]), leaning)
    assert wide == ["liftoff", "stage3_separation, stage4_ignition", "injection, stage4_cutoff"]
    narrow = style._apart(groups, np.array([0.0, 3.0, 4.5]), leaning)
    assert narrow == ["liftoff", "stage3_separation ...", "injection ..."]
    assert style._apart(groups[:1], np.array([0.0]), [True]) == ["liftoff"]
    assert style._apart([], np.array([]), []) == []


def test_numbers_of_events_have_a_key(good):
    events = good.events[good.events.case == CASE]
    assert style.event_key(events) == "1 liftoff   2 stage1 cutoff   3 injection"
    names = {text.get_text() for text in PLOTS["trajectory"](good, CASE).axes[0].texts}
    assert names == {"1", "2", "3"}


def test_a_key_of_many_events_has_lines_that_fit_the_page_and_loses_none():
    names = [f"stage{number}_separation" for number in range(20)]
    events = pd.DataFrame({"event": names, "kind": "event", "t_s": np.arange(20.0)})
    lines = style.event_key(events).split("\n")
    assert len(lines) == 5
    assert max(len(line) for line in lines) <= 105
    assert [word for word in " ".join(lines).split() if "stage" in word] == [f"stage{number}" for number in range(20)]
    assert style.event_key(events.head(0)) == ""


def test_a_fault_of_a_moment_is_a_line(good):
    events = good.events[good.events.case == CASE].assign(t_end_s=lambda rows: rows.t_s)
    _, grid = style.canvas()
    grid[0, 0].set_xlim(-5.0, 100.0)
    style.mark_events(grid[0, 0], events)
    assert len(grid[0, 0].patches) == 0
    assert [60.0, 60.0] in [list(line.get_xdata()) for line in grid[0, 0].get_lines()]
