"""Combinations that are refused: each by its reason, and by nothing else."""

from __future__ import annotations

import pytest

from lvnav_trade.scenario.rules import REFUSALS, first_refusal
from tests.both_engines.modelled import SETTINGS
from tests.building import INERTIAL, LOOSE, loaded, with_fields, with_units

TIGHT = "base.filter=filters/tight"
MODELLED = (*SETTINGS, "base.imu=imu/kvh1750_003_published", "base.filter=filters/vehicle_model_003")
LATE, PROPAGATED = {"kind": "buffered"}, {"kind": "extrapolated"}
STANDING = {"kind": "zero_velocity", "name": "a", "source": "b", "sigma": "1 cm/s"}
CASES = [
    ((INERTIAL,), {"filter.delay_compensation": LATE}, "uses neither the receiver nor a sensor with latency"),
    (
        (INERTIAL,),
        {"filter.delay_compensation": PROPAGATED, "filter.measurements": ["altitude"],
         "sensors": {"radar": {"kind": "altimeter", "name": "a", "source": "b", "sigma": "1 m", "highest": "5 km",
                               "latency": "0.1 s"}}},
        "does not take both of them",
    ),
    ((TIGHT,), {"filter.delay_compensation": PROPAGATED}, "does not take both of them"),
    (
        (LOOSE,), {"filter.delay_compensation": PROPAGATED, "filter.measurements": ["position"]},
        "does not take both of them",
    ),
    ((LOOSE,), {"filter.init": "from_gnss", "filter.measurements": ["velocity"]}, "both are to be measured"),
    ((INERTIAL,), {"filter.logic": {}}, "a mode logic checks what the receiver measures"),
    (
        (INERTIAL,),
        {"filter.measurements": ["zero_rotation"],
         "sensors": {"still": STANDING | {"kind": "zero_rotation", "sigma": "1 mrad", "attitude": "1 deg"}}},
        "standing_attitude is an extra state",
    ),
    (
        (INERTIAL,),
        {"filter.measurements": ["zero_velocity"], "sensors": {"still": STANDING}, "trajectory.pad_hold": "0 s"},
        "begins with its lift-off",
    ),
    (
        (INERTIAL,),
        {"filter.measurements": ["zero_velocity"], "sensors": {"still": STANDING | {"latency": "0.1 s"}}},
        "reaches the filter at once: no latency",
    ),
    (MODELLED, {"imu.gyro.quantisation": "1 urad"}, "quantisation correlates a sample with the next one"),
    (
        (INERTIAL,), {"faults": [{"kind": "dropped_samples", "start": "5 s", "duration": "1 s", "unit": 2}]},
        "a fault is of an inertial unit that the scenario does not have",
    ),
]  # fmt: skip


DIFFERENCE = {"sensors": {"a": {"kind": "angle_difference"}}}
SETS = [
    ([{}, {"axes": [[1, 2, 3]]}], {}, DIFFERENCE, "a difference is of two inertial units that each sense along three"),
    ([{}], {}, DIFFERENCE, "a difference is of two inertial units"),
    ([{}, {}], {"weights": "equal"}, DIFFERENCE, "noise of a difference is correlated with that of fused increments"),
    ([{}, {"gyro": {"quantisation": "1 urad"}}], {}, DIFFERENCE, "quantisation correlates a difference of increments"),
    (
        [{}, {}],
        {},
        {"sensors": DIFFERENCE["sensors"] | {"b": {"kind": "angle_difference"}}},
        "two sensors measure the same",
    ),
]


@pytest.mark.parametrize(("units", "fields", "beside", "reported"), SETS, ids=[reported for *_, reported in SETS])
def test_a_difference_of_units_that_makes_no_sense_is_refused_with_its_reason(units, fields, beside, reported):
    scenario = with_units(loaded(INERTIAL, "base.imu=imu/tactical_fog"), units, **fields)
    with pytest.raises(ValueError, match=reported):
        with_fields(scenario, **beside)


@pytest.mark.parametrize(("settings", "fields", "reported"), CASES, ids=[reported for _, _, reported in CASES])
def test_a_combination_that_makes_no_sense_is_refused_with_its_reason(settings, fields, reported):
    scenario = loaded(*settings)
    assert first_refusal(scenario) is None
    with pytest.raises(ValueError, match=reported):
        with_fields(scenario, **fields)


@pytest.mark.parametrize(
    ("settings", "fields"),
    [
        ((TIGHT,), {"filter.delay_compensation": LATE, "filter.feedback": "open", "filter.logic": {}}),
        ((LOOSE,), {"filter.delay_compensation": PROPAGATED, "filter.init": "from_gnss"}),
        (MODELLED, {"filter.delay_compensation": LATE, "imu.gyro.scale_factor": "10 ppm"}),
        (MODELLED, {"filter.logic": {}, "filter.feedback": "open"}),
    ],
)
def test_policies_and_measurements_go_together_otherwise(settings, fields):
    assert first_refusal(with_fields(loaded(*settings), **fields)) is None


def test_every_refusal_names_a_field_and_a_reason_of_its_own():
    assert len({refusal.reason for refusal in REFUSALS}) == len(REFUSALS)
    assert all(refusal.path.split(".")[0] in type(loaded()).model_fields for refusal in REFUSALS)
