"""What a vehicle card and an ascent card refuse."""

from __future__ import annotations

import copy

import pytest
from pydantic import ValidationError

from lvnav_trade.world.vehicle import VehicleAscent
from tests.world.flights import ascent_card, ascent_settings


def changed(path, value):
    settings = copy.deepcopy(ascent_settings())
    inner = settings
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return settings


@pytest.mark.parametrize(
    ("path", "value", "fault"),
    [
        (("vehicle", "stages", 0, "thrust"), "0 N", "greater than 0"),
        (("vehicle", "stages", 1, "ignition_delay"), "-1 s", "greater than or equal to 0"),
        (("vehicle", "mach"), [0.0, 1.0], "2 Mach numbers but 9 drag coefficients"),
        (("vehicle", "mach"), [0.0, 0.6, 0.6, 1.1, 1.3, 2.0, 3.0, 5.0, 10.0], "mach must rise"),
        (("vehicle", "fairing", "stage"), 3, "released in stage 3 of 2"),
        (("vehicle", "max_load"), "0 g", "greater than 0"),
        (("target", "apogee"), "300 km", "apogee lies below perigee"),
        (("parking",), {"perigee": "360 km"}, "perigee of the parking orbit lies above"),
        (("steered_from",), 3, "steered_from is 3, the vehicle has 2 stages"),
        (("site", "latitude"), "-91 deg", "greater than or equal"),
        (("pad_hold",), "-1 s", "greater than or equal"),
    ],
)
def test_a_card_that_cannot_be_is_refused(path, value, fault):
    with pytest.raises(ValidationError, match=fault):
        VehicleAscent.model_validate(changed(path, value))


def test_a_vehicle_of_one_stage_is_refused():
    settings = ascent_settings()
    settings["vehicle"]["stages"] = settings["vehicle"]["stages"][:1]
    settings["vehicle"]["fairing"] = None
    with pytest.raises(ValidationError, match="two stages or more"):
        VehicleAscent.model_validate(settings)


def test_a_card_survives_being_written_and_read():
    card = ascent_card()
    assert VehicleAscent.model_validate(card.model_dump(mode="json")) == card
