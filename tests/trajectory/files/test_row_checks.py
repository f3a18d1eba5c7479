"""Times, gaps and rounding of the rows of a user's file."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.row_checks import find_pair_starts, rounding, usable_rows


@pytest.mark.parametrize(
    ("t", "fault"),
    [
        ([0.0, 1.0, 1.0, 2.0], ":7: time 1 s repeats 1 s of the row before"),
        ([0.0, 1.0, 0.5, 2.0], ":7: time 0.5 s goes back from 1 s"),
        ([0.0, 1.0, 2.0, 20.0, 21.0], ":8: no data between 2 s and 20 s, where the rows around are 1 s apart"),
    ],
)
def test_times_that_repeat_go_back_or_leave_a_gap_are_refused(t, fault):
    with pytest.raises(InputError, match=fault):
        usable_rows(np.array(t), {}, "a.csv", [str(k) for k in range(5, 5 + len(t))])


def test_a_change_of_rate_is_no_gap():
    t = np.concatenate([np.arange(0.0, 5.0, 0.1), np.arange(5.0, 30.0)])
    assert usable_rows(t, {}, "a.csv", [""] * 100) == (t.size, [], [])


def with_holes(*spans):
    """Times at 30 Hz over 60 s, none within the spans, and their places."""
    t = np.arange(0.0, 60.0, 1.0 / 30.0)
    t = t[~np.any([(t > begin) & (t < end) for begin, end in spans], axis=0)]
    return t, [str(k) for k in range(t.size)]


def test_a_hole_of_less_than_a_second_is_filled_whatever_the_rate_and_said():
    t, places = with_holes((20.0, 20.83))
    count, (hole,), notes = usable_rows(t, {}, "a.csv", places)
    assert (count, hole.start) == (t.size, pytest.approx(20.0))
    assert notes == ["no data from 20 to 20.8333 s: a spline through the rows on both sides fills the hole"]
    _, both, (note,) = usable_rows(*with_holes((20.0, 20.83), (30.0, 30.9))[:1], {}, "a.csv", places)
    assert len(both) == 2
    assert note.startswith("2 holes without data, the longest from 30 to 30.9")
    with pytest.raises(
        InputError, match=r"no data between 20 s and 21\.2 s, where the rows around are 0\.0333 s apart; at "
    ):
        usable_rows(*with_holes((20.0, 21.2))[:1], {}, "a.csv", places)


def test_a_hole_after_the_last_event_ends_the_flight_and_one_before_it_is_refused():
    t, places = with_holes((40.0, 55.0))
    count, holes, notes = usable_rows(t, {"injection": 39.5}, "a.csv", places)
    assert (t[count - 1], holes) == (pytest.approx(40.0), [])
    assert notes == [
        "no data from 40 to 55 s, after the last event: the flight ends there and the rows behind it are left out"
    ]
    for events in ({}, {"injection": 45.0}, {"injection": 39.5, "separation": 58.0}):
        with pytest.raises(InputError, match="no data between 40 s and 55 s"):
            usable_rows(t, events, "a.csv", places)


@pytest.mark.parametrize(
    ("column", "digit"),
    [
        ([0.1, 0.2, 0.25], 0.01),
        ([1000.0, 3000.0, 4000.0], 1000.0),
        ([6378137.123456789, 6378138.2, 6378139.3], 1e-9),
    ],
)
def test_rounding_is_seen_in_the_digits(column, digit):
    if digit > 1e-6:
        assert rounding(np.array(column)) == pytest.approx(digit / math.sqrt(12.0))
    else:
        assert rounding(np.array(column)) == 0.0  # all the digits that a double has


def test_columns_that_hardly_vary_or_carry_all_digits_are_not_rounded():
    assert rounding(np.array([90.0, 90.0, 90.0])) == 0.0
    assert rounding(np.array([90.0, 90.00000000000006, 90.00000000000003])) == 0.0
    assert rounding(np.array([0.0, 1e-17, -3e-16])) == 0.0
    assert rounding(np.sqrt(np.arange(2.0, 40.0))) == 0.0


def test_the_first_of_two_rows_at_an_event_ends_the_phase_before_it():
    t = np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0])
    assert find_pair_starts(t, {"cutoff": 1.0}).tolist() == [False, True, False, False, False, False]
    assert not find_pair_starts(t, {}).any()
