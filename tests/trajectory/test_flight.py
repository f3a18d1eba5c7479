"""Every kind of card becomes a flight, and oscillations are laid over any of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import gmst
from lvnav_trade.trajectory.flight import build, identity, motion
from lvnav_trade.trajectory.flights.sounding import SoundingFlight
from tests.building import loaded
from tests.trajectory.flight_cases import ascent, ascent_card, recorded, recovery, sounding, sounding_settings

SHAKEN = {"start": "stage2_ignition", "end": "stage2_cutoff", "coning": [{"angle": "0.3 deg", "frequency": "2 Hz"}]}


def test_the_identity_of_a_flight_is_that_of_its_numbers_and_not_of_its_name():
    card = ascent_card()
    assert identity(card.model_copy(update={"name": "other", "source": "other"})) == identity(card)
    assert identity(type(card).model_validate(card.model_dump(mode="json"))) == identity(card)
    assert identity(card.model_copy(update={"pad_hold": card.pad_hold + 1.0})) != identity(card)


@pytest.mark.parametrize("flight", [ascent, recorded])
def test_a_card_becomes_a_flight_from_pad_to_coast(flight):
    built = flight()
    assert built.theta0 == gmst(built.epoch)
    assert (built.phases[0].name, built.phases[-1].name) == ("pad", "final coast")
    assert built.events["liftoff"] == 0.0
    assert list(built.events.values()) == sorted(built.events.values())
    assert built.phases[-1].start == pytest.approx(built.events["injection"])


@pytest.mark.parametrize(("flight", "first"), [(sounding, "pad"), (recovery, "coast")])
def test_flights_that_are_not_to_orbit_end_with_the_event_end(flight, first):
    built = flight()
    assert built.theta0 == gmst(built.epoch)
    assert (built.phases[0].name, built.phases[-1].name) == (first, "descent")
    assert list(built.events)[-1] == "end"
    assert built.events["end"] == built.end


@pytest.mark.parametrize("name", ["shefex2_class", "recovery_polar"])
def test_the_cards_of_the_new_kinds_stand_in_a_campaign(name):
    scenario = loaded(f"base.trajectory=trajectories/{name}")
    assert scenario.trajectory.name == name


def test_an_oscillation_is_laid_over_an_ascent_between_its_events():
    shaken, calm = build(ascent_card(oscillation=[SHAKEN])), ascent()
    events = calm.events
    assert shaken.events == events
    inside, outside = events["stage2_ignition"] + 20.0, events["stage2_cutoff"] + 5.0
    tilt = np.abs(motion(shaken, [inside]).q_b_i - motion(calm, [inside]).q_b_i)
    assert 1e-4 < np.max(tilt) < 0.01
    for one, other in zip(motion(shaken, [outside]), motion(calm, [outside]), strict=True):
        assert np.array_equal(one, other)
    assert all(before.end == after.start for before, after in pairwise(shaken.phases))


def test_the_shipped_rocket_cones_and_shakes_in_the_parts_that_its_card_names():
    card = loaded("base.trajectory=trajectories/shefex2_class").trajectory
    assert isinstance(card, SoundingFlight)
    shaken, calm = build(card), sounding()
    t = np.array([30.0, 75.0, 120.0, 170.0, 250.0])
    apart = np.linalg.norm(motion(shaken, t).f_b - motion(calm, t).f_b, axis=1)
    assert (apart > 1e-3).tolist() == [True, False, True, False, False]  # in the coasts nothing is felt of a tilt
    tilt = np.max(np.abs(motion(shaken, t).q_b_i - motion(calm, t).q_b_i), axis=1)
    assert (tilt > 1e-4).tolist() == [True, False, True, True, False]


def test_an_oscillation_that_names_no_event_is_refused():
    card = SoundingFlight.model_validate(sounding_settings(oscillation=[SHAKEN | {"start": "injection"}]))
    with pytest.raises(InputError, match="no event 'injection'"):
        build(card)


def test_named_times_are_events_and_change_nothing_else():
    named = {"minute": "60 s", "burning": "stage2_ignition + 20 s"}
    card, calm = ascent_card(named_times=named), ascent()
    found = build(card)
    assert found.events == calm.events | {"minute": 60.0, "burning": calm.events["stage2_ignition"] + 20.0}
    assert list(found.events.values()) == sorted(found.events.values())
    assert found.flight_profile.begin(60.0) == calm.flight_profile.begin(60.0)
    for one, other in zip(motion(found, [60.0]), motion(calm, [60.0]), strict=True):
        assert np.array_equal(one, other)
    assert identity(card) == identity(ascent_card())


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"minute": "stage7_cutoff + 2 s"}, "no event 'stage7_cutoff'"),
        ({"liftoff": "2 s"}, "'liftoff' is an event already"),
        ({"one minute": "60 s"}, "'one minute' is an event already, or no name for one"),
        ({"late": "5 h"}, "'5 h' (18000 s) is outside the flight"),
    ],
)
def test_a_named_time_that_cannot_be_is_refused_with_its_name(named, message):
    with pytest.raises(InputError) as caught:
        build(ascent_card(named_times=named))
    (record,) = caught.value.records
    assert message in record.message
    assert record.path == f"trajectory.named_times.{next(iter(named))}"


def test_a_named_time_without_a_unit_is_refused_by_the_card():
    with pytest.raises(ValueError, match="'60' is not a time: '60' has no unit"):
        ascent_card(named_times={"minute": "60"})
