"""The family of sensors: one tuple gives the union of the cards, the measurements and the filter's models."""

from __future__ import annotations

import pytest
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.observables.altitude import AltimeterCard, AltimeterModel
from lvnav_trade.observables.sensors import MEASUREMENTS, SENSORS, Sensor, SensorModels, model_of

RADAR = {"kind": "altimeter", "name": "a", "source": "b", "sigma": "1 m", "share": "1 percent", "highest": "5 km"}


def test_the_members_give_the_measurements_and_the_models():
    assert {card.measurement for card in SENSORS} == set(SensorModels.model_fields)
    assert set(MEASUREMENTS) == {
        *("position", "velocity", "pseudorange", "range_rate", "carrier_phase", "tdcp", "delta_pseudorange", "imu"),
        *(card.measurement for card in SENSORS),
    }


def test_a_card_is_read_by_its_kind():
    assert isinstance(TypeAdapter(Sensor).validate_python(RADAR), AltimeterCard)
    with pytest.raises(ValidationError, match="altimeter"):
        TypeAdapter(Sensor).validate_python({**RADAR, "kind": "sextant"})


def test_a_matched_model_is_the_sensors_and_a_stated_one_the_filters_own():
    radar = AltimeterCard.model_validate(RADAR)
    assert model_of(SensorModels(), radar) == AltimeterModel.model_construct(sigma=1.0, share=0.01)
    assert model_of(SensorModels(altitude={"sigma": "3 m"}), radar).sigma == 3.0
