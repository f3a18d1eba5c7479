"""Sensors, measurements and states without effect are input errors; where only cases differ there is a warning."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading import flights
from lvnav_trade.campaign.reading.load import load

EVENTS = {"liftoff": 0.0, "stage1_cutoff": 150.0, "injection": 540.0}  # the climb holds 60 s and coasts 20 s
STAR = "sensors={star: {kind: attitude_reference, name: a, source: b, sigma: 20 arcsec}}"
RADAR = "sensors.radar=altimeters/radar_004"
LISTED = "filter.measurements=[pseudorange, range_rate, altitude]"
SOLUTION = "filter.measurements=[position, velocity]"


def reported(*sets: str) -> list[str]:
    campaign = load("campaign.yaml", sets)
    found = cases(campaign)
    return [str(one) for one in flights.mistakes(campaign, found, {case.id: EVENTS for case in found})]


def warned(*sets: str) -> list[str]:
    return flights.warnings(cases(load("campaign.yaml", sets)))


def test_a_sensor_that_no_filter_uses_is_refused(study) -> None:
    assert reported() == []
    assert reported(STAR) == [
        "--set: base.sensors.star: no effect: attitude is not among the measurements of any filter"
    ]
    assert reported(RADAR, LISTED) == []


def test_a_sensor_that_some_cases_use_is_a_warning(study) -> None:
    study.append("axes:\n  - {path: filter, cards: [filters/near, filters/low]}\n")
    study.edit("campaign.yaml", "  imu: imu/good", "  imu: imu/good\n  sensors: {radar: altimeters/radar_004}")
    study.write("configs/filters/low.yaml", "name: low\nsource: test\nmeasurements: [position, velocity, altitude]\n")
    assert reported() == []
    assert warned() == ["sensors.radar: no measurement of the filter uses it in filter=near"]


def test_a_measurement_whose_sensor_is_null_in_every_case_is_refused(study) -> None:
    (line,) = reported("sensors={radar: null}", LISTED)
    assert line.endswith("base.filter.measurements: no sensor of the scenario measures altitude in any case")


@pytest.mark.parametrize(
    ("sets", "path"),
    [
        (("filter.extra_states=[position_bias]",), "extra_states: position_bias"),
        (("filter.consider=[velocity_bias]",), "consider: velocity_bias"),
        (("filter.extra_states=[range_bias]", SOLUTION), "extra_states: range_bias"),
        (("filter.extra_states=[time_offset]",), "extra_states: time_offset"),
        (("filter.extra_states=[timing]", "filter.measurements=[]"), "extra_states: timing"),
    ],
)
def test_a_state_that_no_measurement_depends_on_is_refused(study, sets: tuple[str, ...], path: str) -> None:
    assert reported(*sets) == [f"--set: base.filter.{path}: no measurement of the filter depends on it"]


@pytest.mark.parametrize(
    "sets",
    [
        ("filter.extra_states=[position_bias]", SOLUTION),
        ("filter.extra_states=[range_bias, timing, gyro_scale_factor]",),
        ("filter.extra_states=[gyro_scale_factor]", "filter.measurements=[]"),
    ],
)
def test_a_state_with_an_effect_is_accepted(study, sets: tuple[str, ...]) -> None:
    assert reported(*sets) == []


def test_a_state_of_a_sensor_needs_a_sensor_with_such_an_error_or_one_that_is_null(study) -> None:
    state = "filter.extra_states=[altitude_bias]"
    missing = ["--set: base.filter.extra_states: altitude_bias: no sensor has such an error"]
    assert reported(state) == missing
    study.edit("campaign.yaml", "  imu: imu/good", "  imu: imu/good\n  sensors: {radar: altimeters/radar_004}")
    assert reported(LISTED, state) == []
    assert reported(LISTED, state, "sensors.radar.bias=0 m") == missing
    assert not any("altitude_bias" in line for line in reported(LISTED, state, "sensors={radar: null}"))


def test_a_magnetometer_needs_a_flight_of_a_year_that_the_field_covers(study) -> None:
    compass = ("sensors={compass: magnetometers/hmr2300}", "filter.measurements=[position, velocity, magnetic_field]")
    assert reported(*compass) == []
    (line,) = reported(*compass, "trajectory.epoch=2031-01-01T00:00:00Z")
    assert line.startswith("--set: base.sensors.compass: a flight of 2031-01-01T00:00:00Z has no field: IGRF-14 covers")


def test_stored_gains_of_another_flight_are_a_warning(study) -> None:
    found = load("campaigns/gains/scheduled_gain.yaml")
    lines = flights.warnings(cases(found))
    assert len(lines) == 4  # two schedules on two flights that are not the nominal one
    assert all(line.endswith("used on 'recovery_polar' with other numbers") for line in lines)
    assert not any("trajectory=nominal" in line for line in lines)
    unknown = next(case for case in cases(found) if case.scenario.filter.gains is not None)
    gains = unknown.scenario.filter.gains.model_copy(update={"flight_digest": ""})
    card = unknown.scenario.filter.model_copy(update={"gains": gains})
    unknown = unknown._replace(scenario=unknown.scenario.model_copy(update={"filter": card}))
    assert "does not say for which flight" in flights.warnings([unknown])[0]
