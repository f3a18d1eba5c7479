import pytest
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.gnss.fault_cards import Fault

JAMMER = {"kind": "jamming", "power": "0 dBW", "latitude": "40 deg", "longitude": "5 deg"}
DEAD = {"kind": "dead_axis", "sensor": "gyro", "axis": 1}
STEP = {"kind": "accel_scale_factor_step", "size": ["-1 %", "300 ppm", "0 ppm"]}


def read(fields, **changes):
    return TypeAdapter(Fault).validate_python({"start": "9 s", "duration": "5 s"} | fields | changes)


def test_steps_of_a_scale_factor_have_a_sign():
    assert read(STEP).size == pytest.approx((-0.01, 3e-4, 0.0))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "spoofing", "velocity": ["0 m/s"] * 3}, "velocity: is zero, so the false position is the true one"),
        (JAMMER | {"elevation": "30 deg"}, "elevation: without a pattern the antenna radiates alike"),
        (JAMMER | {"latitude": "100 deg"}, "less than or equal to 1.57"),
        (JAMMER | {"quality": 0.0}, "greater than 0"),
        (DEAD | {"axis": 0}, "greater than or equal to 1"),
        (DEAD | {"sensor": "magnetometer"}, "'gyro' or 'accelerometer'"),
        ({"kind": "clock_drift", "rate": "3 m"}, "m/s"),
        ({"kind": "clock_drift", "rate": "3 m/s", "duration": None}, "duration: is missing"),
    ],
)
def test_what_has_no_effect_or_is_out_of_range_is_refused(fields, message):
    with pytest.raises(ValidationError, match=message):
        read(fields)
