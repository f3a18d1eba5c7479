"""Marks of plain data: found at any depth, left out of what is computed, gone with what is replaced."""

from __future__ import annotations

from lvnav_trade.quantities.marks import marks_in, without_field_marks, without_marks

DATA = {
    "imu": {"name": "a", "assumed": {"gyro.bias": "a guess"}, "second_hand": {}, "gyro": {"bias": "1.0 rad/s"}},
    "receiver": {"antennas": [{"name": "up", "second_hand": {"gain": "a handbook"}, "gain": 3.0}]},
    "sensors": {"assumed": {"name": "a sensor of that name", "rate": 1.0}},
}


def test_marks_are_found_in_mappings_and_lists() -> None:
    found = [(one.card, one.name, one.field, one.mark, one.value, one.reason) for one in marks_in(DATA)]
    assert found == [
        ("imu", "a", "gyro.bias", "assumed", "1.0 rad/s", "a guess"),
        ("receiver.antennas.0", "up", "gain", "second hand", 3.0, "a handbook"),
    ]


def test_settings_without_marks_keep_a_name_of_the_users_own() -> None:
    assert without_marks(DATA) == {
        "imu": {"name": "a", "gyro": {"bias": "1.0 rad/s"}},
        "receiver": {"antennas": [{"name": "up", "gain": 3.0}]},
        "sensors": DATA["sensors"],
    }


def test_a_replaced_value_takes_its_marks_along() -> None:
    assert without_field_marks(DATA["imu"], ["gyro", "bias"])["assumed"] == {}
    assert without_field_marks(DATA["imu"], ["gyro"])["assumed"] == {}
    assert without_field_marks(DATA["imu"], ["gyro", "noise"]) == DATA["imu"]
