"""Motors: propulsion between the points of a burn, and the ideal velocity gain."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.trajectory.ascent.equations_of_motion import unthrottled_thrust
from lvnav_trade.trajectory.ascent.motors import cuts, engine, impulse_speed
from lvnav_trade.trajectory.ascent.vehicle_cards import STANDARD_GRAVITY, VehicleCard
from tests.trajectory.flight_cases import ascent_card, launcher_settings


def vehicle(name):
    return VehicleCard.model_validate(launcher_settings(name)["vehicle"])


def boosted(**changes):
    """The throttled two-stage launcher with a pair of boosters."""
    pair = {
        "name": "pair", "number": 2, "propellant": "3000 kg", "dry": "500 kg", "burn_time": "60 s",
        "specific_impulse": "260 s", "ignition": "10 s", "separation_delay": "2 s",
    }  # fmt: skip
    settings = {**ascent_card().vehicle.model_dump(mode="json"), "boosters": [{**pair, **changes}]}
    return VehicleCard.model_validate(settings)


def integrals(card, number, ends):
    """Impulse (N s) in vacuum and mass (kg) of a stage's burn until `ends`, from its pieces, straight each."""
    points = [0.0, *(cut.time_from_ignition for cut in cuts(card, number) if cut.time_from_ignition < ends), ends]
    impulse = mass = 0.0
    for begin, end in pairwise(points):
        if end > begin:
            push = engine(card, number, 0.0, begin, end)
            forces, flows = zip(
                *(unthrottled_thrust(t, 0.0, push.unthrottled_motors) for t in (begin, end)), strict=True
            )
            impulse += (push.thrust + 0.5 * sum(forces)) * (end - begin)
            mass += (push.mass_flow + 0.5 * sum(flows)) * (end - begin)
    return impulse, mass


def test_thrust_follows_from_propellant_impulse_and_burn_time():
    # P80 of Vega: 88,365 kg, 280 s, 105 s give a mean of 2311 kN (worked by hand).
    stage = vehicle("vega_polar").stages[0]
    assert stage.full_thrust == pytest.approx(2311e3, rel=1e-3)
    assert stage.full_burn == 105.0


@pytest.mark.parametrize("number", [1, 2, 3])
def test_whatever_its_profile_a_motor_burns_its_propellant_at_its_specific_impulse(number):
    card = vehicle("vega_polar")
    stage = card.stages[number - 1]
    impulse, mass = integrals(card, number, stage.full_burn)
    assert mass == pytest.approx(stage.propellant, rel=1e-12)
    assert impulse == pytest.approx(stage.propellant * STANDARD_GRAVITY * stage.specific_impulse, rel=1e-12)


def test_the_peak_of_the_first_motor_of_vega_is_the_published_one():
    # 683,000 lbf = 3038 kN (timeline of VV01).
    card = vehicle("vega_polar")
    times = [cut.time_from_ignition for cut in cuts(card, 1)]
    peak = max(unthrottled_thrust(t, 0.0, engine(card, 1, 0.0, t, t + 1.0).unthrottled_motors)[0] for t in times)
    assert peak == pytest.approx(3038e3, rel=0.03)


def test_boosters_burn_beside_the_core():
    card = vehicle("pslv_sub_gto")
    ends = card.stages[0].full_burn
    impulse, mass = integrals(card, 1, ends)
    motors = [(card.stages[0], 1), *((group, group.number) for group in card.boosters)]
    assert mass == pytest.approx(sum(n * m.propellant for m, n in motors), rel=1e-12)
    assert impulse == pytest.approx(sum(n * m.propellant * m.exhaust_speed for m, n in motors), rel=1e-12)


def test_boosters_are_lit_burn_out_and_are_dropped_in_this_order():
    found = [(cut.event, cut.time_from_ignition, cut.dropped_mass) for cut in cuts(boosted(), 1) if cut.event]
    assert found == [("pair_ignition", 10.0, 0.0), ("pair_cutoff", 70.0, 0.0), ("pair_separation", 72.0, 1000.0)]


def test_the_fairing_is_dropped_in_its_stage_alone():
    card = boosted()
    assert [cut.event for cut in cuts(card, 2)] == ["fairing_separation"]
    assert "fairing_separation" not in [cut.event for cut in cuts(card, 1)]


def test_boosters_push_only_between_ignition_and_cutoff():
    card = boosted()
    beside = [engine(card, 1, 0.0, *span).unthrottled_motors for span in ((0.0, 10.0), (10.0, 70.0), (70.0, math.inf))]
    mean = 2.0 * 3000.0 * STANDARD_GRAVITY * 260.0 / 60.0
    assert [motors.thrust for motors in beside] == pytest.approx([0.0, mean, 0.0], rel=1e-12)


def test_a_vehicle_without_a_limit_of_load_is_not_throttled():
    card = vehicle("pslv_sub_gto")
    assert engine(card, 4, 0.0, 0.0, 10.0).max_load == math.inf


def test_the_ideal_speed_of_two_stages_is_that_of_the_rocket_equation():
    card = ascent_card().vehicle
    upper = 325.0 * STANDARD_GRAVITY * math.log((700 + 250 + 850 + 9000) / (700 + 250 + 850))
    lower = 300.0 * STANDARD_GRAVITY * math.log((10800 + 4600 + 54000) / (10800 + 4600))
    assert impulse_speed(card, 700.0) == pytest.approx(upper + lower, rel=1e-12)


def test_the_ideal_speed_with_boosters_is_the_integral_of_thrust_over_mass():
    card = boosted()
    t, h, first = 0.0, 0.01, card.stages[0]
    mass, gain = 1000.0 + 9000.0 + 850.0 + 250.0 + 54000.0 + 4600.0 + 2.0 * 3500.0, 0.0
    drops = {round(cut.time_from_ignition, 2): cut.dropped_mass for cut in cuts(card, 1) if cut.dropped_mass}
    while t < first.full_burn - 1e-6:
        push = engine(card, 1, 0.0, t, t + h)
        flow = push.mass_flow + push.unthrottled_motors.mass_flow
        gain += (push.thrust + push.unthrottled_motors.thrust) * h / (mass - 0.5 * flow * h)
        mass -= flow * h
        t += h
        mass -= drops.get(round(t, 2), 0.0)
    upper = card.stages[1].exhaust_speed * math.log((2100.0 + 9000.0) / 2100.0)
    # The ideal speed lights the boosters at once; here they are lit 10 s later.
    assert impulse_speed(card, 1000.0) == pytest.approx(gain + upper, rel=3e-3)


def test_beyond_its_burn_time_a_stage_that_guidance_cuts_off_keeps_the_thrust_of_its_end():
    card = vehicle("electron_leo")
    stage = card.stages[1]
    push = engine(card, 2, 0.0, stage.full_burn, stage.full_burn + 10.0)
    assert push.unthrottled_motors.thrust_slope == 0.0
    before = engine(card, 2, 0.0, cuts(card, 2)[-2].time_from_ignition, stage.full_burn)
    assert push.unthrottled_motors.thrust == pytest.approx(
        unthrottled_thrust(stage.full_burn, 0.0, before.unthrottled_motors)[0], rel=1e-12
    )
    assert np.isfinite(push.unthrottled_motors.thrust)
