"""The envelope card: the numbers of Beaudoin et al. unless stated otherwise, and which filters have one."""

from __future__ import annotations

import pytest

from lvnav_trade.filters.base import FilterCard
from lvnav_trade.filters.envelope import EnvelopeCard

BASE = {"name": "n", "source": "s"}


def test_the_defaults_are_those_of_section_2_3():
    card = EnvelopeCard()
    assert (card.roll, card.burn, card.coast) == (0.002, 0.02, 0.002)
    assert (card.axial_burn, card.axial_coast, card.axial_change, card.lateral) == (15.0, 10.0, 15000.0, 10.0)
    assert (card.turn_gain, card.turn_time, card.nozzle_gain, card.nozzle_time) == (5.0, 2.0, 30.0, 0.035)
    assert (card.before_change, card.after_change) == (1.0, 2.0)


def test_only_a_filter_with_a_model_of_the_vehicle_has_an_envelope():
    assert FilterCard(kind="vehicle_model", envelope={"burn": "1 rad/s^2"}, **BASE).envelope.burn == 1.0
    with pytest.raises(ValueError, match="envelope: a loose filter has no model of the vehicle"):
        FilterCard(kind="loose", envelope={}, **BASE)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"neglect": ["gyro_bias"]}, "neglect: a vehicle_model filter estimates the biases"),
        ({"consider": ["accel_bias"]}, "consider: a vehicle_model filter estimates the biases"),
        ({"extra_states": ["gyro_scale_factor"]}, "extra_states: a vehicle_model filter"),
        ({"strapdown_rate": "100 Hz"}, "strapdown_rate: a vehicle_model filter takes every sample"),
    ],
)
def test_what_a_filter_with_a_model_cannot_do_is_refused(fields, told):
    with pytest.raises(ValueError, match=told):
        FilterCard(kind="vehicle_model", **fields, **BASE)
