"""Holes in the rows of a file."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.discontinuities import RowGap, bridged_gaps, find_gaps, gap_remarks

T = np.concatenate([np.arange(0.0, 10.05, 0.1), np.arange(10.9, 20.0, 0.1), np.arange(30.0, 40.0, 0.1)])


def test_a_hole_is_measured_against_the_intervals_beside_it():
    first, second = find_gaps(T)
    assert (first.start, first.end, first.length) == (pytest.approx(10.0), pytest.approx(10.9), pytest.approx(0.9))
    assert (second.start, second.end, second.usual_interval) == (pytest.approx(19.9), 30.0, pytest.approx(0.1))
    assert find_gaps(np.array([0.0, 5.0, 10.0, 39.0, 44.0])) == []  # less than six intervals
    assert [hole.row for hole in find_gaps(np.array([0.0, 5.0, 10.0, 41.0, 46.0]))] == [2]


def test_short_holes_are_bridged_and_a_long_one_ends_the_rows_where_nothing_is_needed_behind_it():
    (short,), last = bridged_gaps(T, 19.0, 1.0, "a.csv")
    assert (short.start, last.start) == (pytest.approx(10.0), pytest.approx(19.9))
    assert bridged_gaps(T, 35.0, 11.0, "a.csv") == (find_gaps(T), None)
    with pytest.raises(InputError, match=r"^a.csv: no data between 10 s and 10.9 s, .* at most 0.5 s are bridged$"):
        bridged_gaps(T, 19.0, 0.5, "a.csv")
    places = [str(k + 2) for k in range(T.size)]
    with pytest.raises(InputError, match=rf"^a.csv:{find_gaps(T)[1].row + 3}: no data between 19.9 s and 30 s"):
        bridged_gaps(T, 35.0, 1.0, "a.csv", places)


def test_what_is_filled_is_said_in_one_line():
    assert gap_remarks([]) == []
    (line,) = gap_remarks([RowGap(1, 3.0, 4.0, 0.1)])
    assert line == "no data from 3 to 4 s: a spline through the rows on both sides fills the hole"
    (line,) = gap_remarks([RowGap(1, 3.0, 4.0, 0.1), RowGap(9, 7.0, 9.0, 0.1)])
    assert line == "2 holes without data, the longest from 7 to 9 s: a spline through the rows on both sides fills them"
