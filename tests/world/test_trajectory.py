"""Both kinds of card become a flight."""

from __future__ import annotations

import pytest

from lvnav_trade.frames import gmst
from tests.world.flights import ascent, recorded


@pytest.mark.parametrize("flight", [ascent, recorded])
def test_a_card_becomes_a_flight_from_pad_to_coast(flight):
    built = flight()
    assert built.theta0 == gmst(built.epoch)
    assert (built.phases[0].name, built.phases[-1].name) == ("pad", "final coast")
    assert built.events["liftoff"] == 0.0
    assert list(built.events.values()) == sorted(built.events.values())
    assert built.phases[-1].start == pytest.approx(built.events["injection"])
