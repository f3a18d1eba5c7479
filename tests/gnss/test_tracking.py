from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.tracking import (
    DEAF,
    DYNAMICS,
    HELD,
    HIDDEN,
    WEAK,
    ChannelSignals,
    TrackingCard,
    search_fraction,
    track,
)
from lvnav_trade.quantities.records import ACQUIRE, IDLE, LOST, SEARCH, TRACK

STEP = 0.1
NAMES = tuple(f"G{k:02d}" for k in range(1, 9))


def card(**changes):
    return TrackingCard(**({"coast": "0 s"} | changes))


def signals(duration, n_sat=4, start=0.0):
    """Return signals that are all there, strong, and stay; the first satellite is the highest."""
    t = start + STEP * np.arange(round(duration / STEP) + 1)
    shape = (t.size, n_sat)
    height = np.tile(np.linspace(1.2, 0.2, n_sat), (t.size, 1))
    return ChannelSignals(t, np.ones(shape, bool), np.zeros(shape, np.int8), np.ones(shape, bool), height)


def take(given, sat, start, end, cause=WEAK):
    """Take a satellite's signal away between two times, the end excluded."""
    within = (given.t >= start - 1e-9) & (given.t < end - 1e-9)
    given.cause[within, sat] = cause
    given.is_strong[within, sat] = False
    if cause == HIDDEN:
        given.is_in_view[within, sat] = False


def of(transitions, satellite):
    return [(round(x.t, 3), x.state_before, x.state_after, x.reason) for x in transitions if x.satellite == satellite]


def times(transitions, after):
    return {x.satellite: x.t for x in transitions if x.state_after == after}


def test_signals_that_stay_are_tracked_from_the_start_to_the_end():
    states, transitions = track(card(), 16, NAMES[:4], signals(10.0))
    assert np.all(states == TRACK)
    assert [(x.t, x.state_before, x.state_after) for x in transitions] == [(0.0, "idle", "track")] * 4


def test_from_cold_satellites_come_one_after_the_other_the_highest_first():
    settings = card(start="searching", search_time="20 s", pull_in="2 s", aiding="none")
    _, transitions = track(settings, 16, NAMES[:4], signals(120.0))
    searched, found, tracked = (times(transitions, word) for word in ("search", "acquire", "track"))
    assert list(searched) == list(NAMES[:4])
    for name, later in pairwise(NAMES[:4]):
        assert searched[later] == pytest.approx(found[name])  # the one searcher is free when the signal is found
    for name in NAMES[:4]:
        window = search_fraction(settings, name, searched[name]) * 20.0
        assert 0.0 <= found[name] - searched[name] - window < STEP + 1e-9
        assert tracked[name] - found[name] == pytest.approx(2.0, abs=STEP)


def test_more_searchers_search_at_the_same_time():
    settings = card(start="searching", searchers=3, aiding="none")
    _, transitions = track(settings, 16, NAMES[:4], signals(1.0))
    assert sum(x.state_after == "search" and x.t == 0.0 for x in transitions) == 3


def test_passes_last_on_average_half_their_time_and_never_longer():
    shares = [search_fraction(card(realisation=k), "G05", 12.3) for k in range(4000)]
    assert 0.0 < min(shares) < 0.002
    assert 0.998 < max(shares) < 1.0
    # uniform: mean 1/2, variance 1/12; four sigma of the mean of 4000
    assert np.mean(shares) == pytest.approx(0.5, abs=4.0 / np.sqrt(12.0 * 4000))


def test_a_satellite_is_lost_after_the_coast_and_not_before():
    given = signals(20.0)
    take(given, 1, 5.0, 5.5)
    take(given, 2, 5.0, 7.0, DYNAMICS)
    states, transitions = track(card(coast="1 s"), 16, NAMES[:4], given)
    assert np.all(states[:, 1] == TRACK)
    assert of(transitions, "G03")[1] == (6.0, "track", "lost", "dynamics")


def test_a_lost_satellite_is_found_sooner_while_it_is_remembered():
    def away(duration):
        given = signals(100.0)
        take(given, 0, 5.0, 5.0 + duration)
        settings = card(search_time="40 s", reacquire_time="2 s", memory="10 s", aiding="none", pull_in="0 s")
        _, transitions = track(settings, 16, NAMES[:4], given)
        states = [x for x in transitions if x.satellite == "G01" and x.state_after == "track"]
        return states[-1].t - 5.0 - duration

    # Found by the pass that is going on or by the next: of 2 s each, or of 40 s each.
    assert away(3.0) <= 4.0 + 2.0 * STEP
    assert 4.0 + 2.0 * STEP < away(30.0) <= 80.0 + 2.0 * STEP


@pytest.mark.parametrize(
    ("aiding", "left", "aided"), [("own", 4, True), ("own", 3, False), ("fused", 0, True), ("none", 6, False)]
)
def test_searches_are_narrower_while_the_receiver_is_aided(aiding, left, aided):
    given = signals(60.0, n_sat=left + 1)
    take(given, left, 5.0, 5.1)
    settings = card(aiding=aiding, aided_factor=0.1, search_time="30 s", memory="0 s", pull_in="0 s")
    _, transitions = track(settings, 16, NAMES[: left + 1], given)
    search = next(x for x in transitions if x.state_after == "search")
    found = next(x for x in transitions if x.state_after == "acquire" or x.reason == "not found")
    assert (search.reason == "aided search") is aided
    window = 30.0 * (0.1 if aided else 1.0)
    assert found.t - search.t == pytest.approx(window * search_fraction(settings, NAMES[left], search.t), abs=STEP)


def test_recovery_is_faster_with_the_fused_state_than_alone():
    def back(aiding):
        given = signals(400.0, n_sat=8)
        for sat in range(8):
            take(given, sat, 10.0, 40.0, DEAF)
        states, _ = track(card(aiding=aiding, search_time="40 s"), 16, NAMES, given)
        return given.t[np.flatnonzero((states == TRACK).sum(axis=1) < 4)[-1]] - 40.0

    alone, own, fused = (back(aiding) for aiding in ("none", "own", "fused"))
    assert fused < 0.5 * own
    assert own <= alone


def test_over_100_draws_aiding_halves_the_time_to_four_satellites_after_an_outage_of_30_s(record_property):
    """With one searcher four satellites take four passes met anywhere: a mean of 4 window / 2, and the last pull-in."""

    def median(aiding):
        given, found = signals(150.0, n_sat=8), []
        for sat in range(8):
            take(given, sat, 10.0, 40.0, DEAF)
        for draw in range(100):
            states, _ = track(card(aiding=aiding, realisation=draw), 16, NAMES, given)
            found.append(given.t[np.flatnonzero((states == TRACK).sum(axis=1) < 4)[-1]] - 40.0)
        return float(np.median(found))

    alone, fused = median("none"), median("fused")
    record_property("time to four satellites", f"{alone:.1f} s alone, {fused:.1f} s aided")
    assert alone == pytest.approx(4 * 20.0 / 2 + 2.0, rel=0.25)
    assert fused == pytest.approx(4 * 5.0 / 2 + 2.0, rel=0.25)
    assert fused <= 0.5 * alone


def test_a_search_without_a_signal_ends_and_others_get_their_turn():
    given = signals(60.0, n_sat=2)
    take(given, 0, 0.0, 100.0, DEAF)
    take(given, 1, 0.0, 10.0, DEAF)
    settings = card(search_time="4 s", aiding="none", pull_in="0 s")
    states, transitions = track(settings, 16, NAMES[:2], given)
    assert np.all(states[given.t > 20.0, 1] == TRACK)
    vain = [x for x in transitions if x.satellite == "G01" and x.reason == "not found"]
    assert len(vain) >= 5
    assert np.all(np.isin(states[:, 0], (IDLE, SEARCH)))  # never tracked, so never lost


def test_a_signal_that_vanishes_while_it_is_pulled_in_is_searched_again():
    given = signals(60.0, n_sat=1)
    settings = card(start="searching", search_time="0 s", pull_in="5 s", aiding="none")
    take(given, 0, 2.0, 3.0)
    _, transitions = track(settings, 16, NAMES[:1], given)
    assert (2.0, "acquire", "idle", "weak signal") in of(transitions, "G01")
    assert times(transitions, "track")["G01"] >= 3.0 + 5.0


def test_a_satellite_that_sets_is_forgotten_at_once():
    given = signals(20.0)
    take(given, 3, 5.0, 8.0, HIDDEN)
    _, transitions = track(card(), 16, NAMES[:4], given)
    assert of(transitions, "G04")[1] == (5.0, "track", "idle", "out of view")
    states, transitions = track(card(coast="10 s"), 16, NAMES[:4], given)
    assert of(transitions, "G04")[1] == (5.0, "track", "idle", "out of view")
    assert of(transitions, "G04")[2][:3] == (8.0, "idle", "search")
    assert LOST not in states[:, 3]


def test_no_more_channels_are_busy_than_there_are():
    given = signals(60.0, n_sat=8)
    take(given, 2, 20.0, 30.0)
    states, _ = track(card(searchers=4, search_time="3 s"), 5, NAMES, given)
    assert np.isin(states, (SEARCH, ACQUIRE, TRACK)).sum(axis=1).max() == 5
    assert np.all(states[-1, :2] == TRACK)
    assert np.all(states[0] == [TRACK] * 5 + [IDLE] * 3)


def test_another_satellite_leaves_the_draws_of_the_rest_alone():
    given = signals(30.0, n_sat=3)
    settings = card(start="searching", searchers=3, aiding="none")
    _, three = track(settings, 16, NAMES[:3], given)
    _, two = track(settings, 16, (NAMES[0], NAMES[2]), ChannelSignals(given.t, *(a[:, [0, 2]] for a in given[1:])))
    assert of(three, "G03") == of(two, "G03")
    _, other = track(settings.model_copy(update={"realisation": 1}), 16, NAMES[:3], given)
    assert of(other, "G03") != of(three, "G03")


def test_every_change_of_state_is_recorded_and_follows_from_the_one_before():
    given = signals(200.0, n_sat=8)
    rng = np.random.default_rng(3)
    for sat in range(8):
        for start in rng.uniform(0.0, 180.0, 6):
            take(given, sat, start, start + rng.uniform(0.1, 20.0), rng.choice([WEAK, DYNAMICS, DEAF, HIDDEN]))
    states, transitions = track(card(searchers=2), 5, NAMES, given)
    assert [x.t for x in transitions] == sorted(x.t for x in transitions)
    for sat, name in enumerate(NAMES):
        own = [x for x in transitions if x.satellite == name]
        assert own[0].state_before == "idle"
        assert all(a.state_after == b.state_before for a, b in pairwise(own))
        ends = {x.t: x.state_after for x in own}  # the last of a step
        known = ("idle", "search", "acquire", "track", "lost")
        seen = "idle"
        for t, state in zip(given.t, states[:, sat], strict=True):
            seen = ends.get(t, seen)
            assert known[state] == seen
        assert not np.any((states[:, sat] == TRACK) & (given.cause[:, sat] != HELD))  # no coast: tracked is held


def test_a_signal_that_is_found_should_not_be_lost_at_once():
    with pytest.raises(ValidationError, match="acquire_above is below track_above"):
        card(acquire_above="20 dB-Hz", track_above="25 dB-Hz")
