"""What a vehicle card and an ascent card refuse."""

from __future__ import annotations

import copy
import math

import pytest
from pydantic import ValidationError

from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent, sun_synchronous
from tests.trajectory.flight_cases import ascent_card, ascent_settings


def changed(path, value):
    settings = copy.deepcopy(ascent_settings())
    inner = settings
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return settings


@pytest.mark.parametrize(
    ("path", "value", "fault"),
    [
        (("vehicle", "stages", 0, "thrust"), "0 N", "greater than 0"),
        (("vehicle", "stages", 1, "ignition_delay"), "-1 s", "greater than or equal to 0"),
        (("vehicle", "stages", 0, "ignition_delay"), "3 s", "of the first stage has no effect: it ignites at lift-off"),
        (("vehicle", "mach"), [0.0, 1.0], "2 Mach numbers but 9 drag coefficients"),
        (("vehicle", "mach"), [0.0, 0.6, 0.6, 1.1, 1.3, 2.0, 3.0, 5.0, 10.0], "mach must rise"),
        (("vehicle", "fairing", "stage"), 3, "released in stage 3 of 2"),
        (("vehicle", "max_load"), "0 g", "greater than 0"),
        (("target", "apogee"), "300 km", "apogee lies below perigee"),
        (("parking",), {"perigee": "360 km"}, "perigee of the parking orbit lies above"),
        (("steered_from",), 3, "steered_from is 3, the vehicle has 2 stages"),
        (("site", "latitude"), "-91 deg", "greater than or equal"),
        (("pad_hold",), "-1 s", "greater than or equal"),
        (("vehicle", "stages", 0, "burn_time"), "150 s", "give the thrust or the burn time"),
        (("vehicle", "stages", 0, "thrust"), None, "give the thrust or the burn time"),
        (("vehicle", "stages", 0, "profile"), {"part": [0, 1], "thrust": [1, 1]}, "profile needs the burn time"),
        (("vehicle", "stages", 0, "profile"), {"part": [0, 0.5], "thrust": [1, 1]}, "part must rise from 0 to 1"),
        (("vehicle", "stages", 0, "profile"), {"part": [0, 1], "thrust": [1]}, "2 parts of the burn but 1 thrusts"),
        (("vehicle", "fairing"), {"mass": "1 kg", "stage": 1, "after_ignition": "200 s"}, "'first' burns out after"),
        (("parking",), {"perigee": "200 km", "stage": 3}, "must be one of the last two"),
        (("parking",), {"perigee": "200 km", "stage": 1}, "greater than or equal to 2"),
        (("target", "anomaly"), "95 deg", "less than"),
        (("target", "anomaly"), "-1 deg", "greater than or equal"),
        (
            ("target",),
            {"perigee": "350 km", "apogee": "350 km", "inclination": "45 deg", "anomaly": "10 deg"},
            "anomaly has no effect: a circular target",
        ),
        (("vehicle", "stages", 1, "separation_delay"), "2 s", "has no effect: the last stage does not separate"),
        (("roll",), {"start": "8 s", "rate": "2 deg/s"}, "start and rate: no effect: pad and flight"),
        (("target",), {"perigee": "350 km", "apogee": "350 km", "inclination": "sun-synchron"}, "not a quantity"),
        (("target",), {"apogee": "350 km", "inclination": "sun-synchronous"}, "perigee"),
        (
            ("target",),
            {"perigee": "300 km", "apogee": "20000 km", "inclination": "sun-synchronous"},
            "no orbit of 300 x 20000 km is sun-synchronous",
        ),
    ],
)
def test_a_card_that_cannot_be_is_refused(path, value, fault):
    with pytest.raises(ValidationError, match=fault):
        VehicleAscent.model_validate(changed(path, value))


def test_a_vehicle_of_one_stage_is_refused():
    settings = ascent_settings()
    settings["vehicle"]["stages"] = settings["vehicle"]["stages"][:1]
    settings["vehicle"] |= {"fairing": None, "assumed": {}, "second_hand": {}}
    with pytest.raises(ValidationError, match="two stages or more"):
        VehicleAscent.model_validate(settings)


def test_a_card_survives_being_written_and_read():
    card = ascent_card()
    assert VehicleAscent.model_validate(card.model_dump(mode="json")) == card


BOOSTERS = {
    "name": "strap_on",
    "number": 2,
    "propellant": "3000 kg",
    "dry": "500 kg",
    "burn_time": "60 s",
    "specific_impulse": "260 s",
}


@pytest.mark.parametrize(
    ("groups", "fault"),
    [
        (
            [{**BOOSTERS, "ignition": "100 s"}],
            "dropped 160.0 s after lift-off, the first stage burns out after 149.9 s",
        ),
        ([BOOSTERS, BOOSTERS], "two groups of boosters share a name"),
        ([{**BOOSTERS, "name": "Strap on"}], "should match pattern"),
        ([{**BOOSTERS, "number": 0}], "greater than or equal to 1"),
    ],
)
def test_boosters_that_cannot_be_are_refused(groups, fault):
    with pytest.raises(ValidationError, match=fault):
        VehicleAscent.model_validate(changed(("vehicle", "boosters"), groups))


def test_a_parking_orbit_leaves_no_choice_of_the_point_of_injection():
    settings = changed(("parking",), {"perigee": "200 km"})
    settings["target"] = {**settings["target"], "anomaly": "10 deg"}
    with pytest.raises(ValidationError, match="its anomaly cannot be chosen"):
        VehicleAscent.model_validate(settings)


def test_thrust_and_burn_time_follow_from_one_another():
    by_thrust = ascent_card().vehicle.stages[0]
    settings = changed(("vehicle", "stages", 0, "thrust"), None)
    settings["vehicle"]["stages"][0]["burn_time"] = f"{by_thrust.full_burn!r} s"
    by_time = VehicleAscent.model_validate(settings).vehicle.stages[0]
    assert by_time.full_thrust == pytest.approx(1060e3, rel=1e-12)
    assert by_thrust.full_burn == pytest.approx(54000.0 * 9.80665 * 300.0 / 1060e3)


def test_the_word_sun_synchronous_becomes_an_angle_that_is_read_back():
    target = {"perigee": "500 km", "apogee": "500 km", "inclination": "sun-synchronous"}
    card = ascent_card(target=target)
    # By hand: n = 1.10678e-3 rad/s, (a_e/a)^2 = 0.85985; 1.99106e-7 = -1.5 J2 n (a_e/a)^2 cos i.
    assert math.cos(card.target.inclination) == pytest.approx(-0.12884, abs=2e-5)
    assert VehicleAscent.model_validate(card.model_dump(mode="json")) == card


def test_sun_synchronous_of_an_ellipse_counts_its_semilatus_rectum():
    # Precession goes with (1 - e^2)^-2 a^-7/2.
    circle, ellipse = sun_synchronous(1000e3, 1000e3), sun_synchronous(700e3, 1300e3)
    e = 300e3 / (6378137.0 + 1000e3)
    assert math.cos(ellipse) == pytest.approx(math.cos(circle) * (1.0 - e**2) ** 2, rel=1e-12)
