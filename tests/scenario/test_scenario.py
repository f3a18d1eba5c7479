"""A resolved design point."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.scenario.scenario import Scenario
from tests.building import loaded, with_fields


def test_a_scenario_written_as_text_reads_back_to_the_same_numbers():
    scenario = loaded("base.filter=filters/tight_extended")
    assert Scenario.model_validate(scenario.model_dump(mode="json")) == scenario
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


@pytest.mark.parametrize(
    "wrong", [{"frame": "moon"}, {"diverged": 3.0}, {"colour": "red"}, {"faults": [{"kind": "rain"}]}]
)
def test_what_a_scenario_does_not_know_is_refused(wrong):
    with pytest.raises(ValidationError):
        Scenario.model_validate(loaded().model_dump(mode="json") | wrong)


def test_a_scenario_cannot_be_changed():
    with pytest.raises(ValidationError):
        loaded().frame = "ecef"


LOOSE = {"filter.measurements": ["position", "velocity"]}
POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}
SOLVING = {**LOOSE, "receiver.solution": POINT}
LATE = "filter.delay_compensation"
STAR = {"kind": "attitude_reference", "name": "a", "source": "b", "sigma": "20 arcsec"}
REFERENCED = {
    "sensors": {"star": STAR},
    "filter.measurements": ["position", "velocity", "attitude"],
    "filter.report_imu_samples": True,
    "imu": loaded("base.imu=imu/kvh1750_003").imu.model_dump(mode="json"),
}
FROZEN = [{"kind": "frozen_output", "start": "2 s", "duration": "3 s"}]
FAIRLY = {"kind": "extrapolated", "delay": "300 ms"}


@pytest.mark.parametrize(
    "fields",
    [SOLVING, {**SOLVING, "filter.extra_states": ["accel_scale_factor"]}, {**LOOSE, LATE: FAIRLY},
     {LATE: {"kind": "buffered", "delay": "999 ms"}}, {"faults": FROZEN}, REFERENCED,
     {**SOLVING, "filter.extra_states": ["position_bias"]}, {**LOOSE, LATE: FAIRLY, "filter.extra_states": ["timing"]},
     {**REFERENCED, LATE: {"kind": "buffered", "delay": "100 ms"}}, {**REFERENCED, "filter.report_imu_samples": False},
     {**REFERENCED, "filter.logic": {}}, {**REFERENCED, "filter.measurements": ["pseudorange", "attitude"]},
     {"filter.measurements": ["pseudorange"]}, {**REFERENCED, "sensors": {"a": STAR, "b": STAR}},
     {**SOLVING, "faults": FROZEN}, {LATE: {"kind": "buffered"}, "receiver.latency": "1.2 s"},
     {**LOOSE, LATE: {**FAIRLY, "delay": "950 ms"}}, {**LOOSE, "filter.init": "from_gnss", LATE: FAIRLY}],
)  # fmt: skip
def test_what_goes_together_is_accepted(fields):
    with_fields(loaded(), **fields)


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"filter.measurements": [], LATE: {"kind": "buffered"}}, "neither the receiver nor a sensor with latency"),
        ({LATE: {"kind": "extrapolated"}}, "does not take both of them"),
        ({**LOOSE, LATE: FAIRLY, "filter.measurements": ["position"]}, "does not take both of them"),
        ({"filter.init": "from_gnss"}, "both are to be measured"),
        ({"filter.measurements": [], "filter.logic": {}}, "takes nothing of it"),
        ({"filter.measurements": ["position", "pseudorange"]}, "information would be counted twice"),
    ],
)
def test_what_cannot_be_had_together_is_refused_before_anything_runs(fields, reported):
    with pytest.raises(ValueError, match=reported):
        with_fields(loaded(), **fields)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"imu.gyro.random_walk": "2e7 deg/sqrt(h)"}, "at most 1000 deg/sqrt"),
        ({"imu.accel.random_walk": "20 g/sqrt(Hz)"}, "at most 1 g/sqrt"),
        ({"initial.position": "1e9 m"}, "less than or equal to 1000000"),
        ({"receiver.pseudorange_sigma": "2e9 m"}, "less than or equal to 1000000"),
        ({"filter.gate": 5e15}, "less than or equal to 1000"),
    ],
)
def test_sizes_that_no_device_has_are_refused(fields, said):
    with pytest.raises(ValueError, match=said):
        with_fields(loaded(), **fields)
