"""A schedule of gains: what it was made of comes out again, by event or by time; changed numbers are refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.filter.policies.stored_gains import (
    ROWS,
    GainHistory,
    GainSchedule,
    build_gain_schedule,
    evaluate_schedule,
    thin_knots,
)

STATES = ("velocity x", "position x", "gyro_bias x")
EVENTS = {"liftoff": 0.0, "cutoff": 100.0, "ignition": 130.0}
T = np.arange(-20.0, 200.0, 1.0)


def table():
    """Gains that ends, jump at the cut-off, and drift from the ignition on."""
    level = 0.1 + 0.9 * np.exp(-(T + 20.0) / 8.0)
    level[T >= 100.0] = 0.05
    level[T >= 130.0] = 0.05 + 0.001 * (T[T >= 130.0] - 130.0)
    factors = np.linspace(-1.0, 2.0, len(ROWS) * len(STATES)).reshape(len(ROWS), len(STATES))
    return level[:, None, None] * factors


def made(by="event", tolerance=0.01):
    return build_gain_schedule("test", "a nominal flight", by, GainHistory(STATES, ROWS, T, table()), EVENTS, tolerance)


@pytest.mark.parametrize("by", ["event", "time"])
@pytest.mark.parametrize("tolerance", [0.05, 0.01, 0.001])
def test_gains_come_out_as_they_went_in_within_the_tolerance(by, tolerance):
    off = np.abs(evaluate_schedule(made(by, tolerance), T, EVENTS) - table())
    assert np.all(off <= (tolerance + 1e-3) * np.abs(table()).max(axis=0))  # 1e-3: rounded to four digits


def test_few_knots_are_kept_and_fewer_where_the_tolerance_is_greater():
    count = [sum(len(s.knots) for s in made("event", tolerance).segments) for tolerance in (0.05, 0.01, 0.001)]
    assert count[0] < count[1] < count[2] < len(T) / 3
    assert thin_knots(T, np.ones((len(T), 2)), 1e-9) == [0, len(T) - 1]


def test_by_event_the_gains_move_with_the_events_and_by_time_they_stay():
    later = {"liftoff": 0.0, "cutoff": 110.0, "ignition": 145.0}
    moved, stayed = evaluate_schedule(made("event"), T, later), evaluate_schedule(made("time"), T, later)
    np.testing.assert_allclose(stayed, evaluate_schedule(made("time"), T, EVENTS))
    at = np.searchsorted(T, [105.0, 112.0, 150.0])
    nominal = evaluate_schedule(made("event"), T, EVENTS)
    before, here = np.searchsorted(T, [99.0, 102.0, 135.0]), moved[at]
    np.testing.assert_allclose(here[0], nominal[before[0]], rtol=1e-2)  # the burn goes on: its last gains are held
    np.testing.assert_allclose(here[1], nominal[before[1]], rtol=1e-9)
    np.testing.assert_allclose(here[2], nominal[before[2]], rtol=1e-9)


def test_it_is_read_again_from_its_own_text_and_one_changed_number_is_refused():
    text = made().model_dump(mode="json")
    assert GainSchedule.model_validate(text) == made()
    text["segments"][0]["knots"][0]["gain"][0][0] += 1e-3
    with pytest.raises(ValidationError, match="compute the schedule again"):
        GainSchedule.model_validate(text)


def test_a_flight_without_the_event_is_reported_so():
    with pytest.raises(ValueError, match="needs the event 'ignition'"):
        evaluate_schedule(made(), T, {"liftoff": 0.0, "cutoff": 100.0})


def test_knots_out_of_order_are_refused():
    text = made().model_dump(mode="json")
    text["segments"][0]["knots"].reverse()
    with pytest.raises(ValidationError, match="should rise"):
        GainSchedule.model_validate(text)


def test_rounding_makes_neither_knots_nor_digits():
    def with_rounding(seed):
        gains = table()
        gains[T < 100.0, 1, 2] = 0.0
        noise = 1e-11 * np.abs(gains).max(axis=0) * np.random.default_rng(seed).uniform(-1.0, 1.0, gains.shape)
        flown = GainHistory(STATES, ROWS, T, gains + noise)
        return build_gain_schedule("test", "a nominal flight", "event", flown, EVENTS, 0.05)

    one, other = with_rounding(1), with_rounding(2)
    knots = [[knot.since for knot in segment.knots] for segment in one.segments]
    assert knots == [[knot.since for knot in segment.knots] for segment in other.segments]
    assert all(knot.gain[1][2] == 0.0 for knot in one.segments[0].knots)
    assert any(knot.gain[1][2] != 0.0 for knot in one.segments[-1].knots)
