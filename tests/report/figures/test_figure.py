"""What panels hold of the verbs that they are given."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.report.figures.figure import _KEY_LENGTH, Events, canvas, named_ticks, panel


def test_verbs_make_marks_of_six_kinds():
    _, axes = panel(2.0)
    axes.step([0, 1], [2, 3], label="a", color="black")
    axes.fill_between([0, 1], 0, [2, 3])
    axes.bar([1, 2], [5, -6], 0.5)
    axes.axhline(4)
    axes.text(0.5, [1, 2], ["one", "two"])
    axes.cells([0, 1], [0, 1], [[3.0]], (1.0, 10.0), cmap="YlGnBu")
    line, band, boxes, limit, text, cells = axes.marks
    assert [mark.mark_type for mark in axes.marks] == ["line", "band", "boxes", "limit", "text", "cells"]
    assert (line.label, line.style) == ("a", {"step": True, "color": "black"})
    assert list(band.data["low"]) == [0.0, 0.0]
    assert [list(boxes.data[side]) for side in ("x0", "x1", "y0", "y1")] == [
        [0.75, 1.75],
        [1.25, 2.25],
        [0, 0],
        [5, -6],
    ]
    assert (limit.data["at"], limit.style["axis"]) == (4.0, "y")
    assert (list(text.data["x"]), text.data["texts"]) == ([0.5, 0.5], ["one", "two"])
    assert cells.data["scale"] == (1.0, 10.0)


def test_pieces_of_lines_are_one_line_with_gaps():
    _, axes = panel(2.0)
    axes.hlines([1.0, 2.0], 0.0, [5.0, 6.0])
    np.testing.assert_array_equal(axes.marks[0].data["x"], [0.0, 5.0, np.nan, 0.0, 6.0, np.nan])
    np.testing.assert_array_equal(axes.marks[0].data["y"], [1.0, 1.0, np.nan, 2.0, 2.0, np.nan])


def test_a_lower_limit_alone_leaves_the_upper_one_open_and_an_unknown_name_is_refused():
    _, axes = panel(2.0)
    axes.set(ylim=0.0, xlim=(1.0, 2.0), yticks=named_ticks(["a", "b"], 0.5))
    assert (axes.axes["ylim"], axes.axes["xlim"]) == ((0.0, None), (1.0, 2.0))
    assert axes.axes["yticks"] == [(0.5, "a"), (1.5, "b")]
    with pytest.raises(TypeError, match="no xlabell"):
        axes.set(xlabell="x")


def test_a_legend_has_each_label_of_all_panels_once():
    figure, grid = canvas(2, 1)
    for axes in grid[:, 0]:
        axes.plot([0], [1], label="same")
    grid[1, 0].plot([0], [1], label="other")
    assert [mark.label for mark in figure.legend()] == ["same", "other"]


def test_the_key_of_a_flight_with_many_faults_names_each_kind_once_and_stays_within_its_width():
    kinds = ("satellite_outage", "wild_samples", "frozen_output", "degraded_noise", "latency_change", "invalid_output")
    faults = tuple((f"{kinds[k % 6]} {k + 1}", float(k), k + 0.5) for k in range(24))
    lines = Events((("liftoff", 0.0),), faults).key().split("\n")
    assert len(lines) > 1
    assert max(map(len, lines)) <= _KEY_LENGTH
    assert "satellite outage 1 7 13 19, wild samples 2 8 14 20" in " ".join(lines)
