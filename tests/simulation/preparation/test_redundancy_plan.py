"""Redundant inertial units on the nominal flight: variances of a test, exclusion, and what the middle reading does."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.fault_cards import DeadAxis, DroppedSamples, GyroBiasStep
from tests.building import loaded, prepare_hop, with_units


def units_of(*faults, units=({}, {}, {}), **fields):
    scenario = with_units(loaded("base.imu=imu/tactical_fog_matched"), list(units), **fields)
    prepared_case = prepare_hop(scenario.model_copy(update={"faults": faults}))
    return prepared_case, prepared_case.options.imu_array


def left_out(units, dt):
    """Return when a stage other than the flown one begins, and how the gyros of each unit enter its x axis."""
    tick = int(np.argmax(units.stage != units.stage_without_exclusion))
    return dt * tick, units.axis_weights[units.stage[tick], :, 0, 0, 0]


def test_the_weight_of_a_test_is_the_inverse_variance_of_the_cards():
    prepared_case, units = units_of(parity={"window": "2 s"})
    gyro, start = prepared_case.scenario.imu.units[0].gyro, prepared_case.unit.start
    for window in (0, 3):
        grown = gyro.bias_repeatability**2 + gyro.rate_random_walk**2 * 2.0 * (window + 1)
        variance = gyro.random_walk**2 * 2.0 + grown * 4.0
        assert units.redundant.weight[window, 0] == pytest.approx(np.full((3, 3), 1.0 / variance), rel=1e-9)
    assert start == 0.0
    n_test = 2 * len(units.redundant.weight)
    assert np.exp(-0.5 * units.redundant.limits[2]) == pytest.approx(1e-3 / n_test, rel=1e-9)  # chi-square of two


@pytest.mark.parametrize(
    "fault",
    [
        GyroBiasStep(unit=2, size=["60 deg/h", "0 deg/h", "0 deg/h"], **{"from": "10 s"}),
        DeadAxis(unit=2, sensor="accelerometer", axis=1, **{"from": "10 s"}),
        DroppedSamples(unit=2, instead="nothing", **{"from": "10 s"}),
    ],
    ids=lambda fault: fault.kind,
)
def test_a_failed_unit_is_left_out_at_the_end_of_a_window(fault):
    prepared_case, units = units_of(fault, parity={"window": "1 s"})
    when, entering = left_out(units, prepared_case.unit.dt)
    assert when == pytest.approx(11.0)
    assert entering == pytest.approx([0.5, 0.0, 0.5])


def test_two_of_four_units_are_left_out_one_after_the_other():
    faults = [
        GyroBiasStep(unit=1, size=["100 deg/h", "0 deg/h", "0 deg/h"], **{"from": "5 s"}),
        GyroBiasStep(unit=4, size=["0 deg/h", "300 deg/h", "0 deg/h"], **{"from": "15 s"}),
    ]
    _, units = units_of(*faults, units=({}, {}, {}, {}), parity={})
    assert units.axis_weights[units.stage[-1], :, 0, 0, 0] == pytest.approx([0.0, 0.5, 0.5, 0.0])
    assert len(units.axis_weights) == 3


def test_nothing_is_left_out_of_sound_units_and_a_set_without_test_has_one_stage():
    _, tested = units_of(parity={})
    _, plain = units_of()
    assert len(tested.axis_weights) == len(plain.axis_weights) == 1
    assert np.array_equal(tested.axis_weights, plain.axis_weights)
    assert plain.redundant is None


def test_skewed_single_axes_are_units_that_can_be_left_out():
    axes = [(1, 1, 1), (1, -1, 1), (-1, 1, 1), (-1, -1, 1), (1, 0, 0), (0, 1, 0)]
    fault = GyroBiasStep(unit=3, size=["200 deg/h", "0 deg/h", "0 deg/h"], **{"from": "10 s"})
    _, units = units_of(fault, units=[{"axes": [axis]} for axis in axes], parity={})
    last = units.axis_weights[units.stage[-1]]
    assert np.all(last[2] == 0.0)
    directions = units.frames[:, 0, 0]
    assert last[:, 0, :, 0].T @ directions == pytest.approx(np.eye(3), abs=1e-9)
