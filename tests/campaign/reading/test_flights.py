"""Measurements that no sensor gives are input errors; where only cases differ there is a warning."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading import flights, switched
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.conditions import FlightProfile

EVENTS = {"liftoff": 0.0, "stage1_cutoff": 150.0, "injection": 540.0}  # the climb holds 60 s and coasts 20 s
LISTED = "filter.measurements=[pseudorange, range_rate, altitude]"


def reported(*sets: str) -> list[str]:
    campaign = load("campaign.yaml", sets)
    found = cases(campaign)
    return [str(one) for one in flights.mistakes(campaign, found, {case.id: EVENTS for case in found})]


def warned(*sets: str) -> list[str]:
    return flights.warnings(cases(load("campaign.yaml", sets)))


def test_a_sensor_that_some_cases_use_is_a_warning(study, monkeypatch) -> None:
    # the study's vehicle does not reach its orbit
    monkeypatch.setattr(switched, "_capability_errors", lambda *_: iter(()))
    study.append("axes:\n  - {path: filter, cards: [filters/near, filters/low]}\n")
    study.edit("campaign.yaml", "  imu: imu/good", "  imu: imu/good\n  sensors: {radar: altimeters/radar_004}")
    study.write("configs/filters/low.yaml", "name: low\nsource: test\nmeasurements: [position, velocity, altitude]\n")
    assert reported() == []
    assert warned() == ["sensors.radar: no measurement of the filter uses it in filter=near"]


def test_a_measurement_whose_sensor_is_null_in_every_case_is_refused(study) -> None:
    (line,) = reported("sensors={radar: null}", LISTED)
    assert line.endswith("base.filter.measurements: no sensor of the scenario measures altitude in any case")


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


def _sky(tracked):
    """Return a stand-in for the sky of a flight of 560 s at one epoch a second: A1 is received as stated."""
    return lambda scenario, flight, t, start: SimpleNamespace(
        names=("A1", "A2"), is_tracked=np.stack([tracked(t, scenario), np.ones(t.size, dtype=bool)], axis=1)
    )


def _fly(monkeypatch, tracked):
    course = FlightProfile({"start": -60.0, "end": 560.0, **EVENTS})
    flight = SimpleNamespace(flight_profile=course, start=-60.0, end=560.0)
    monkeypatch.setattr(switched, "trajectory_of", lambda _: flight)
    monkeypatch.setattr(switched, "_capability_errors", lambda *_: iter(()))
    monkeypatch.setattr(switched, "cached_sky", _sky(tracked))


BIAS = "faults=[{kind: range_bias, size: 5 m, satellites: [A1, A2], start: 100 s, duration: 50 s}]"
SLIP = "faults=[{kind: cycle_slip, size: 1, satellites: [A1], start: 149.5 s}]"


@pytest.mark.parametrize("fault", [BIAS, SLIP])
def test_a_satellite_that_is_not_received_while_its_fault_holds_is_refused(study, monkeypatch, fault) -> None:
    _fly(monkeypatch, lambda t, _: t > 150.5)
    (line,) = reported(fault)
    assert line.endswith("base.faults.0.satellites: A1 is received at no time of the flight while the fault holds")
    _fly(monkeypatch, lambda t, _: t > 148.5)
    assert reported(fault) == []


def test_a_satellite_that_some_cases_receive_is_a_warning(study, monkeypatch) -> None:
    study.append("axes:\n  - {path: receiver.mask, values: [5 deg, 30 deg]}\n")
    _fly(monkeypatch, lambda t, scenario: np.full(t.size, scenario.receiver.mask < 0.2))
    assert reported(BIAS) == []
    (line,) = warned(BIAS)
    assert line.startswith("faults.0.satellites: A1 is received at no time of the flight while the fault holds in ")
    assert "30 deg" in line
    assert "; " not in line


IMU = "imu/tactical_fog"
LASTING = "base.faults=[{kind: gyro_bias_step, size: [60 deg/h, 0 deg/h, 0 deg/h], from: 100 s}]"
BRIEF = "base.faults=[{kind: dropped_samples, from: 100 s, until: 102 s}]"
TESTED = "base.filter.integrity={}"


@pytest.mark.parametrize(
    ("sets", "warns"),
    [
        ((TESTED, LASTING), True),
        ((LASTING,), False),
        ((TESTED, BRIEF), False),
        ((TESTED, LASTING, f"base.imu={{units: [{IMU}, {IMU}], parity: {{after_detection: report}}}}"), True),
        ((TESTED, LASTING, f"base.imu={{units: [{IMU}, {IMU}, {IMU}], parity: {{}}}}"), False),
        ((TESTED, LASTING, f"base.imu={{units: [{IMU}, {IMU}, {IMU}], selection: mid_value}}"), False),
    ],
    ids=["one IMU", "no tests", "brief", "two that report", "three tested", "three, middle reading"],
)
def test_tests_of_innovations_with_a_persistent_fault_of_an_imu_that_nothing_excludes_are_a_warning(sets, warns):
    lines = flights.warnings(cases(load("campaigns/smoke.yaml", sets)))
    assert len(lines) == warns
    if warns:
        assert "faults.0 (gyro_bias_step) persists and nothing excludes the IMU" in lines[0]
