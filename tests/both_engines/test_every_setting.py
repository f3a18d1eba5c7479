"""Every field of every fault and sensor changes what the engines compute, or its other value is refused.

The fields are found in the schema, their other values are made by rule: a new member of either family is walked without
a line here, once the table of members names it. IMU, receiver and filter: test_fields.py; sky, air, flights and
control: test_every_card.py.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, get_args

import pytest
from ruamel.yaml import YAML

from lvnav_trade.gnss.fault_cards import AnyFault
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import SENSORS, card_kind
from tests.building import ROOT, loaded, prepare_hop, shipped_sensors, with_fields
from tests.walking import LABELS, digest, others

WHEN = {"start": "8 s", "duration": "9 s"}
ONCE = {"start": "8 s"}
STEP = ["2 deg/h", "1 deg/h", "3 deg/h"]
LINK = {"link": {}, "antennas": [{"lever": ["1 m", "0 m", "0 m"]}, {"lever": ["0 m", "1 m", "0 m"]}]}
FAULTS = {
    "satellite_outage": WHEN | {"keep": 3, "elevation_below": "80 deg"},
    "degraded_noise": WHEN | {"factor": 3.0, "elevation_below": "80 deg"},
    "range_bias": WHEN | {"size": "3 m", "drift": "1 m/s", "elevation_above": "52 deg"},
    "clock_jump": ONCE | {"size": "3 m"},
    "clock_drift": WHEN | {"rate": "3 m/s"},
    "wild_samples": WHEN | {"sigma": "30 m", "elevation_below": "80 deg"},
    "frozen_output": WHEN,
    "spoofing": WHEN | {"velocity": ["1 m/s", "2 m/s", "3 m/s"]},
    "latency_change": WHEN | {"by": "50 ms"},
    "gyro_bias_step": WHEN | {"size": STEP},
    "accel_bias_step": WHEN | {"size": ["1 mg", "2 mg", "3 mg"]},
    "gyro_scale_factor_step": WHEN | {"size": ["100 ppm", "200 ppm", "300 ppm"]},
    "accel_scale_factor_step": WHEN | {"size": ["100 ppm", "200 ppm", "300 ppm"]},
    "dead_axis": WHEN | {"sensor": "gyro", "axis": 1},
    "dropped_samples": WHEN,
}
"""A fault of each kind during the short flight, all that its kind has."""
ELSEWHERE = {
    "antenna_failure": "tests/gnss/test_visibility.py: it needs antennas",
    "jamming": "tests/world/receiver/test_jamming.py: it needs a link budget",
    "cycle_slip": "tests/simulation/preparation/signals/test_phases_and_differences.py: it needs a carrier phase",
    "invalid_output": "tests/filter/policies/test_mode_logic.py: it needs a mode logic",
}

HEAD = {"name": "a sensor", "source": "a test", "until": "25 s", "rate": "0.5 Hz"}
SENSOR_FIELDS = {
    "altimeter": {"sigma": "1 m", "share": "1 percent", "bias": "2 m", "bias_time": "40 s", "highest": "900 km"},
    "attitude_reference": {"sigma": "1 mrad"},
    "star_tracker": {
        "across": "1 mrad",
        "about": "3 mrad",
        "misalignment": "2 mrad",
        "low_frequency": "1 mrad",
        "low_frequency_time": "40 s",
        "boresight": [0.0, 0.6, 0.8],
    },
    "magnetometer": {"sigma": "50 nT", "hard_iron": "90 nT", "soft_iron": "1 percent"},
}
"""Sensors that measure throughout the short flight, at 200 km, with all of their fields."""
NOT_THERE = {
    "zero_velocity": "tests/observables/sensors/pad", "pad_position": "tests/observables/sensors/pad",
    "azimuth": "tests/observables/sensors/pad", "zero_rotation": "tests/observables/sensors/pad",
    "angle_difference": "tests/sensors/test_imu_difference.py",
    "velocity_difference": "tests/sensors/test_imu_difference.py",
    "barometer": "tests/sensors/test_barometer.py",
    "ground_station": "tests/sensors/test_ground_station.py",
}  # fmt: skip
"""Sensors that do not measure there, and where their fields are tested."""


def stated_of(kind: str) -> dict[str, Any]:
    """Return the fields of a sensor of a kind; one that nothing above names is walked as it is shipped."""
    if kind in SENSOR_FIELDS:
        return SENSOR_FIELDS[kind]
    card = YAML(typ="safe").load(ROOT / f"configs/{shipped_sensors()[kind]}.yaml")
    return {name: value for name, value in card.items() if name not in LABELS}


@lru_cache(maxsize=1)
def base() -> Scenario:
    return loaded()


def prepared_case(**fields: Any) -> str:
    found = prepare_hop(with_fields(base(), **fields))
    return digest(*(part for name, part in found._asdict().items() if name not in {"scenario", "trajectory"}))


def acts(of: Callable[[dict[str, Any]], str], name: str, stated: dict[str, Any], itself: str) -> bool:
    """Whether another value of a field changes what is computed, or is refused."""
    for other in others(stated[name]):
        try:
            if of({name: other}) != itself:
                return True
        except (ValueError, InputError):
            return True
    return not list(others(stated[name]))  # a word: its other values are other kinds of fault


KINDS = {member.model_fields["kind"].default: member for member in get_args(AnyFault)}


def test_every_kind_of_fault_is_walked_here_or_elsewhere() -> None:
    assert {*FAULTS, *ELSEWHERE} == {*KINDS}


@pytest.mark.parametrize("kind", FAULTS)
def test_every_field_of_a_fault_changes_what_is_computed(kind: str) -> None:
    stated = KINDS[kind].model_validate({"kind": kind, **FAULTS[kind]}).model_dump(mode="json")
    without, itself = prepared_case(), prepared_case(faults=[{"kind": kind, **FAULTS[kind]}])
    assert itself != without
    for name in FAULTS[kind]:
        assert acts(
            lambda other: prepared_case(faults=[{"kind": kind, **FAULTS[kind], **other}]), name, stated, itself
        ), name


SENSOR_KINDS = {card_kind(card): card for card in SENSORS}


def test_what_is_walked_here_or_elsewhere_are_sensors() -> None:
    assert {*SENSOR_FIELDS, *NOT_THERE} <= {*SENSOR_KINDS}


@pytest.mark.parametrize("kind", sorted(SENSOR_KINDS.keys() - NOT_THERE.keys()))
def test_every_field_of_a_sensor_changes_what_is_computed(kind: str) -> None:
    stated = HEAD | stated_of(kind)
    card = SENSOR_KINDS[kind]
    resolved = card.model_validate({"kind": kind, **stated}).model_dump(mode="json", by_alias=True)

    def of(**more: Any) -> str:
        measurements = ["pseudorange", card.measurement]
        return prepared_case(
            **{"sensors": {"s": {"kind": kind, **stated, **more}}, "filter.measurements": measurements}
        )

    itself = of()
    for name in stated.keys() - {"name", "source"}:
        assert acts(lambda other: of(**other), name, resolved, itself), name
