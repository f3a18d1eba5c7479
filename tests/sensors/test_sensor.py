"""The base classes of the sensors: what every card has, and how its window is written."""

from __future__ import annotations

import pytest

from lvnav_trade.sensors.family import SENSORS
from lvnav_trade.sensors.sensor import SensorCard, SensorModel

DATA = {"name": "a", "source": "b", "kind": "attitude_reference", "sigma": "1 deg"}


def test_a_card_without_a_window_measures_at_every_update():
    card = next(one for one in SENSORS if one.measurement == "attitude").model_validate(DATA)
    assert (card.rate, card.from_, card.until) == (None, None, None)


def test_the_window_is_written_with_from_and_read_back():
    card = next(one for one in SENSORS if one.measurement == "attitude")
    one = card.model_validate({**DATA, "rate": "0.5 Hz", "from": "liftoff + 10 s", "until": "300 s"})
    assert (one.rate, one.from_, one.until) == (0.5, "liftoff + 10 s", "300 s")
    assert one.model_dump(mode="json")["from"] == "liftoff + 10 s"
    assert card.model_validate(one.model_dump(mode="json")) == one


@pytest.mark.parametrize("card", SENSORS)
def test_every_member_states_kind_measurement_and_model(card):
    assert issubclass(card, SensorCard)
    assert issubclass(card.model, SensorModel)
    assert card.model_fields["kind"].default


def test_the_base_class_itself_is_no_sensor():
    with pytest.raises(TypeError, match="abstract"):
        SensorCard(name="a", source="b")
