"""Cards of a filter's tuning: what they refuse."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from tests.building import loaded, with_fields

BOUNDED = {"time": "60 s", "velocity": "0.1 m/s"}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"underweighting": [{"from": "0 s"}]}, "changes nothing"),
        ({"measurements": [], "underweighting": [{"beta": 0.2}]}, "underweighting: the filter has no measurement"),
        ({"underweighting": [{"beta": 0.2, "measurements": ["position"]}]}, "position is not among"),
        ({"region_noise": [{"velocity": "1 m/s"}]}, "force_change: is missing"),
        ({"transition_rate": "20 Hz"}, "transition_rate: exceeds covariance_rate"),
        ({"fading_memory": "0 s"}, "fading_memory"),
        ({"h_infinity": {"time": "60 s"}}, "time: of no error; give one of attitude, velocity, position"),
        ({"h_infinity": {"time": "60 s", "velocity": "0 m/s"}}, "h_infinity.velocity"),
        ({"h_infinity": BOUNDED, "measurements": []}, "h_infinity: bounds errors by measurements"),
        ({"h_infinity": BOUNDED, "consider": ["accel_bias"]}, "h_infinity: would change the covariance of accel_bias"),
        ({"h_infinity": BOUNDED, "backup": True}, "h_infinity: the backup is measured by nothing"),
        (
            {"h_infinity": BOUNDED, "measurements": ["pseudorange", "tdcp"], "delayed_state": "back_propagated"},
            "h_infinity: its covariance cannot be propagated back",
        ),
    ],
)
def test_a_tuning_that_cannot_be_meant_is_an_input_error(fields, message):
    with pytest.raises(ValidationError, match=message):
        with_fields(loaded().filter, **fields)
