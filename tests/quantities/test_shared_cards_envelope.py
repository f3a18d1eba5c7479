"""The envelope card: the numbers of Beaudoin et al. unless stated otherwise, and which filters have one."""

from __future__ import annotations

import pytest

from lvnav_trade.filter.card import FilterCard
from lvnav_trade.quantities.shared_cards import EnvelopeCard

BASE = {"name": "n", "source": "s"}
MODELLED = ["position", "velocity", "attitude", "imu"]


def test_the_defaults_are_those_of_section_2_3():
    card = EnvelopeCard()
    assert (card.roll, card.burn, card.coast) == (0.002, 0.02, 0.002)
    assert (card.axial_burn, card.axial_coast, card.axial_change, card.lateral) == (15.0, 10.0, 15000.0, 10.0)
    assert (card.turn_gain, card.turn_time, card.nozzle_gain, card.nozzle_time) == (5.0, 2.0, 30.0, 0.035)
    assert (card.before_change, card.after_change) == (1.0, 2.0)


def test_an_envelope_changes_what_it_names():
    assert FilterCard(measurements=MODELLED, envelope={"burn": "1 rad/s^2"}, **BASE).envelope.burn == 1.0


def test_a_filter_that_measures_every_sample_has_no_strapdown_rate():
    with pytest.raises(ValueError, match=r"strapdown\.ratio: a filter with imu among its .* every sample"):
        FilterCard(measurements=MODELLED, strapdown={"ratio": 2}, **BASE)
