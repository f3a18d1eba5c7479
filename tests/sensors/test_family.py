"""The family of sensors: the modules of its folder give cards, measurements, the filter's models and the kernels."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.sensors import family
from lvnav_trade.sensors.altimeter import AltimeterCard, AltimeterModel
from lvnav_trade.sensors.family import (
    FAMILY,
    MEASUREMENTS,
    SENSORS,
    Sensor,
    SensorModels,
    card_kind,
    sensor_filter_model,
)

RADAR = {"kind": "altimeter", "name": "a", "source": "b", "sigma": "1 m", "share": "1 percent", "highest": "5 km"}
EARLIER = (
    "altimeter", "attitude_reference", "zero_velocity", "pad_position", "azimuth", "angle_difference",
    "velocity_difference", "star_tracker", "magnetometer", "barometer", "ground_station", "zero_rotation",
)  # fmt: skip


def test_every_card_with_a_kind_in_the_folder_is_registered():
    stated = set()
    for path in Path(family.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "kind" and node.value is not None:
                stated.add(ast.literal_eval(node.value))
    assert stated == {card_kind(card) for card in SENSORS}
    assert len(stated) == len(SENSORS)


def test_sensors_of_earlier_versions_keep_their_places_and_others_follow_by_name():
    kinds = [card_kind(card) for card in SENSORS]
    assert tuple(kinds[: len(EARLIER)]) == EARLIER
    assert kinds[len(EARLIER) :] == sorted(kinds[len(EARLIER) :])
    assert all(one.order < other.order for one, other in pairwise(FAMILY[: len(EARLIER)]))


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
    assert sensor_filter_model(SensorModels(), radar) == AltimeterModel.model_construct(sigma=1.0, share=0.01)
    assert sensor_filter_model(SensorModels(altitude={"sigma": "3 m"}), radar).sigma == 3.0
