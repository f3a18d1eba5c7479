"""Names, units and order of what a history holds."""

from __future__ import annotations

import math
from typing import get_args

import pytest

from lvnav_trade.filter.card import ExtraState, ParameterState
from lvnav_trade.quantities.state_layout import AXES, EXTRAS, OF_OBSERVABLES, PARAMETERS, outputs
from lvnav_trade.sensors.family import SENSOR_STATES
from tests.building import INERTIAL, LOOSE, case, loaded, prepare_hop, with_fields


def test_every_parameter_that_a_card_may_name_has_a_kind():
    known = (set(PARAMETERS) | set(EXTRAS) | set(SENSOR_STATES)) - set(OF_OBSERVABLES)
    assert set(get_args(ParameterState)) == known
    assert set(get_args(ExtraState)) == known - {"gyro_bias", "accel_bias"}


@pytest.mark.parametrize("settings", [(), (LOOSE,), (INERTIAL,), ("base.filter=filters/tight_extended",)])
def test_there_is_one_output_with_a_name_of_its_own_for_every_state(settings):
    prepared_case = case(*settings)
    names = [(o.quantity, o.axis) for o in prepared_case.outputs]
    assert len(set(names)) == len(names) == prepared_case.layout.n_state
    assert names[:3] == [("attitude", axis) for axis in ("roll", "pitch", "yaw")]


@pytest.mark.parametrize("frame", AXES)
def test_velocity_and_position_are_named_after_the_axes_of_the_frame(frame):
    prepared_case = prepare_hop(with_fields(loaded(), frame=frame))
    assert tuple(o.axis for o in prepared_case.outputs[3:6]) == AXES[frame]
    assert tuple(o.axis for o in prepared_case.outputs[6:9]) == AXES[frame]


def test_the_clock_stands_at_the_layouts_place():
    prepared_case = case("base.filter=filters/tight_extended")
    clock = prepared_case.layout.clock
    assert [o.quantity for o in prepared_case.outputs[clock : clock + 2]] == ["clock_bias", "clock_drift"]


def test_considered_states_are_reported_behind_the_estimated_ones():
    scenario = loaded()
    card = with_fields(scenario.filter, consider=["accel_scale_factor"])
    prepared_case = prepare_hop(scenario.model_copy(update={"filter": card}))
    assert [o.quantity for o in prepared_case.outputs[-3:]] == ["accel_scale_factor"] * 3
    assert outputs(prepared_case.layout, "ned") == prepared_case.outputs


@pytest.mark.parametrize(
    ("name", "si", "label"),
    [
        ("gyro_bias", math.radians(1.0) / 3600.0, "deg/h"),
        ("accel_bias", 9.80665e-3, "mg"),
        ("gyro_scale_factor", 1e-6, "ppm"),
        ("accel_misalignment", 1e-3, "mrad"),
        ("gyro_g_sensitivity", math.radians(1.0) / 3600.0 / 9.80665, "deg/h/g"),
    ],
)
def test_one_unit_for_people_is_this_much_in_si(name, si, label):
    kind = PARAMETERS[name]
    assert kind.label_unit == label
    assert kind.label_factor * si == pytest.approx(1.0, rel=1e-12)
