"""One field is changed from the command line, or the assignment is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load, resolved_text
from lvnav_trade.quantities.errors import InputError

AXES = "axes: [{path: imu, cards: [imu/good, imu/poor]}, {path: filter.gate, values: [5, null]}]\n"


@pytest.mark.parametrize(
    ("assignment", "get", "value"),
    [
        ("seed=8", lambda c: c.seed, 8),
        ("monte_carlo.runs=500", lambda c: c.monte_carlo.runs, 500),
        ("imu=imu/poor", lambda c: c.base.imu.name, "poor"),
        ("base.imu=imu/poor", lambda c: c.base.imu.name, "poor"),
        ("imu.rate=400 Hz", lambda c: c.base.imu.rate, 400.0),
        ("filter.gate=5", lambda c: c.base.filter.gate, 5.0),
        ("filter.measurements=[velocity, position]", lambda c: c.base.filter.measurements, ("position", "velocity")),
        ("trajectory.vehicle.payload=0.4 t", lambda c: c.base.trajectory.vehicle.payload, 400.0),
        ("trajectory.vehicle.stages.0.dry=4 t", lambda c: c.base.trajectory.vehicle.stages[0].dry, 4000.0),
        ("base.constellation={almanac: my.alm}", lambda c: Path(c.base.constellation.almanac).name, "my.alm"),
        ("constellation.almanac=my.alm", lambda c: Path(c.base.constellation.almanac).name, "my.alm"),
        ("initial.tilt=1 mrad", lambda c: c.base.initial.tilt, 1e-3),
        ("faults=[{start: 100 s, duration: 30 s, kind: satellite_outage}]", lambda c: c.base.faults[0].duration, 30.0),
        ("frame=ecef", lambda c: c.base.frame, "ecef"),
    ],
)
def test_set_changes_one_thing(study, assignment: str, get, value: object) -> None:
    study.write("my.alm", "almanac\n")
    assert get(load(study.path, [assignment])) == value


def test_set_reaches_an_axis_by_its_index(study) -> None:
    study.append(AXES)
    campaign = load(study.path, ["axes.0.cards=[imu/poor]", "axes.1.values.0=7"])
    assert [case.label for case in cases(campaign)] == ["imu=poor, gate=7", "imu=poor, gate=none"]


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("seed", "--set 'seed': should be path=value, such as monte_carlo.runs=500"),
        ("=8", "--set '=8': should be path=value, such as monte_carlo.runs=500"),
        ("seed=", "--set: seed: has no value after '='"),
        ("sead=8", "--set: sead: unknown path (did you mean 'seed'?)"),
        ("imu.gyroo.random_walk=1", "--set: base.imu.gyroo: unknown path (did you mean 'gyro'?)"),
        ("filter.gatt=5", "--set: base.filter.gatt: unknown path (did you mean 'gate'?)"),
        ("filter.gate=-5", "--set: base.filter.gate: should be greater than 0, not -5"),
        ("imu.rate=400 Hzz",
         "--set: base.imu.rate: '400 Hzz' has no unit that is known ('Hzz'); expected frequency (Hz)"
         " (did you mean 'Hz'?)"),
        ("faults.0.keep=1", "--set: base.faults: '0' is not an item of a list of 0 (0 is the first)"),
        ("seed=[1", "--set: seed: '[1': is not YAML: expected ',' or ']', but got '<stream end>'"),
        ("constellation.almanac=my.alm", "--set: base.constellation.almanac: no such file: 'my.alm'"),
    ],
)  # fmt: skip
def test_a_bad_assignment_is_reported_in_one_line(study, assignment: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(study.path, [assignment])
    assert str(caught.value) == message


def test_what_an_axis_varies_cannot_be_set(study) -> None:
    study.append(AXES)
    with pytest.raises(InputError, match=r"^--set: base\.imu\.rate: is varied by axis 0 \(imu\); set axes\.0 instead$"):
        load(study.path, ["imu.rate=400 Hz"])


def test_assignments_are_laid_one_on_the_other_in_their_order(study) -> None:
    campaign = load(study.path, ["imu=imu/poor", "imu.rate=100 Hz", "imu.rate=400 Hz"])
    assert (campaign.base.imu.name, campaign.base.imu.rate) == ("poor", 400.0)


def test_a_value_may_hold_an_equals_sign_and_a_unit_with_brackets(study) -> None:
    campaign = load(study.path, ["description=a=b", "imu.gyro.random_walk=1 deg/sqrt(h)"])
    assert campaign.description == "a=b"
    assert campaign.base.imu.gyro.random_walk > 0.0


def test_what_is_set_is_part_of_the_frozen_campaign(study) -> None:
    study.write("frozen.yaml", resolved_text(load(study.path, ["seed=99"])))
    assert load("frozen.yaml").seed == 99
