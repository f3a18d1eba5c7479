"""Instants and phases by name."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.basics.spans import instant, phase, time_mean

CASE = "aaaaaaaaaaaa"


@pytest.mark.parametrize(
    ("text", "t"),
    [("liftoff", 0.0), ("stage1_cutoff + 20 s", 60.0), ("injection - 0.5 min", 69.5), ("start", -5.0), ("end", 99.5)],
)
def test_an_instant_counts_from_an_event(good, text, t):
    assert instant(good, CASE, text) == pytest.approx(t)


def test_what_the_flight_does_not_have_is_no_number(good):
    assert np.isnan(instant(good, CASE, "touchdown"))
    assert np.isnan(phase(good, CASE, "liftoff to touchdown")[1])


def test_a_phase_has_two_ends_and_the_flight_begins_at_lift_off(good):
    assert phase(good, CASE, "liftoff to stage1_cutoff + 30 s") == (0.0, 70.0)
    assert phase(good, CASE, "flight") == (0.0, 99.5)


def test_the_mean_over_time_gives_uneven_steps_their_weight():
    assert time_mean(np.array([0.0, 1.0, 10.0]), np.array([2.0, 2.0, 2.0])) == 2.0
    assert time_mean(np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.0, 3.0])) == pytest.approx(1.0)
    assert time_mean(np.array([4.0]), np.array([7.0])) == 7.0
