"""The orbit is reached, or the shortfall is named."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.world.ascent import fly_ascent
from lvnav_trade.world.launch import achieved
from lvnav_trade.world.targeting import propellant_left, solve
from tests.world.flights import ascent_card, ascent_settings


def orbit(perigee, apogee, inclination, direction="ascending"):
    return {"perigee": perigee, "apogee": apogee, "inclination": inclination, "direction": direction}


@pytest.mark.parametrize(
    ("perigee", "apogee", "inclination", "direction"),
    [(350.0, 350.0, 45.0, "ascending"), (250.0, 400.0, 60.0, "descending")],
)
def test_the_orbit_is_reached_within_1_km_and_a_hundredth_of_a_degree(perigee, apogee, inclination, direction):
    card = ascent_card(target=orbit(f"{perigee} km", f"{apogee} km", f"{inclination} deg", direction))
    aim = solve(card)
    flight = fly_ascent(card, aim, final_coast=False)
    low, high, tilt = achieved(flight.legs[-1].y[-1])
    assert low == pytest.approx(1000.0 * perigee, abs=1000.0)
    assert high == pytest.approx(1000.0 * apogee, abs=1000.0)
    assert math.degrees(tilt) == pytest.approx(inclination, abs=0.01)
    assert propellant_left(card, aim) > 0.0
    assert (aim.azimuth > math.pi / 2) == (direction == "descending")


def test_a_parking_orbit_is_left_by_a_second_burn():
    card = ascent_card(target=orbit("500 km", "500 km", "45 deg"), parking={"perigee": "200 km"}, kick_angle="3 deg")
    aim = solve(card)
    flight = fly_ascent(card, aim, final_coast=False)
    low, high, tilt = achieved(flight.legs[-1].y[-1])
    assert (low, high) == pytest.approx((500e3, 500e3), abs=1000.0)
    assert math.degrees(tilt) == pytest.approx(45.0, abs=0.01)
    names = ["stage2_ignition", "fairing_separation", "stage2_cutoff", "stage2_ignition_2", "stage2_cutoff_2"]
    assert [name for name in flight.events if name in names] == names
    assert flight.events["stage2_ignition_2"] - flight.events["stage2_cutoff"] > 2000.0  # nearly half a revolution


def test_too_heavy_a_payload_is_refused_with_the_missing_delta_v():
    settings = ascent_settings()["vehicle"]
    with pytest.raises(InputError, match=r"lacks \d+ m/s of delta-v .* kg more propellant"):
        solve(ascent_card(vehicle={**settings, "payload": "1600 kg"}, kick_angle="3 deg"))


def test_a_vehicle_too_heavy_to_lift_off_is_refused():
    settings = ascent_settings()["vehicle"]
    with pytest.raises(InputError, match=r"does not lift off: .* kN less than the weight"):
        solve(ascent_card(vehicle={**settings, "payload": "40 t"}))


def test_an_inclination_below_the_latitude_is_refused_with_the_difference():
    with pytest.raises(InputError, match=r"30\.00 deg cannot be reached .* misses by 8\.60 deg"):
        solve(ascent_card(target=orbit("350 km", "350 km", "30 deg")))


def test_an_orbit_out_of_reach_of_any_steering_is_refused_with_the_miss():
    with pytest.raises(InputError, match=r"no steering reaches the orbit|lacks \d+ m/s"):
        solve(ascent_card(target=orbit("3000 km", "3000 km", "45 deg"), kick_angle="1 deg"))


def test_a_second_stage_may_light_the_moment_the_first_is_dropped():
    settings = ascent_settings()["vehicle"]
    settings["stages"][1]["ignition_delay"] = "0 s"
    card = ascent_card(vehicle=settings)
    aim = solve(card)
    flight = fly_ascent(card, aim)
    assert flight.events["stage2_ignition"] == flight.events["stage1_separation"]
    low, _, _ = achieved(flight.legs[-1].y[0])
    assert low == pytest.approx(card.target.perigee, abs=1000.0)
