"""Instants, phases and sizes that metrics read of a case."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.statistics.case_results import error_magnitudes, instant_time, phase_interval, symmetric

EVENTS = {"liftoff": 0.0, "cutoff": 40.0}


@pytest.mark.parametrize(
    ("text", "t"), [("cutoff", 40.0), ("cutoff - 0.5 min", 10.0), ("start", -5.0), ("end", 90.0), ("touchdown", np.nan)]
)
def test_an_instant_counts_from_an_event_or_an_end(text, t):
    assert instant_time(text, EVENTS, (-5.0, 90.0)) == pytest.approx(t, nan_ok=True)


def test_a_phase_has_two_ends_and_the_flight_begins_at_lift_off():
    assert phase_interval("flight", EVENTS, (-5.0, 90.0)) == (0.0, 90.0)
    assert phase_interval("start to cutoff + 1 s", EVENTS, (-5.0, 90.0)) == (-5.0, 41.0)


def test_a_failed_run_and_an_error_that_is_not_finite_are_infinite():
    found = error_magnitudes(np.array([-1.0, 2.0, np.nan]), np.array([False, True, False]))
    assert found.tolist() == [1.0, np.inf, np.inf]


def test_the_upper_triangle_makes_a_symmetric_matrix():
    found = symmetric(np.array([[1.0, 2.0], [9.0, 3.0]]))
    assert found.tolist() == [[1.0, 2.0], [2.0, 3.0]]
