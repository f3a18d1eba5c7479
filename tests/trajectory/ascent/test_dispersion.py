"""Off-nominal missions: the nominal one without a dispersion, the rocket equation with one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.ascent.dispersion import dispersed_ascent, fly_dispersed, raise_pitch
from lvnav_trade.trajectory.ascent.dispersion_card import Dispersion
from lvnav_trade.trajectory.ascent.legs import TargetingUnknowns, fly_ascent
from lvnav_trade.trajectory.ascent.targeting import flight_propellant_left, solve
from lvnav_trade.trajectory.flight import build
from lvnav_trade.trajectory.truth import motion
from tests.trajectory.flight_cases import ascent_card

PARKING = {
    "target": {"perigee": "350 km", "apogee": "600 km", "inclination": "45 deg"},
    "parking": {"perigee": "200 km"},
}


@pytest.mark.parametrize("changes", [{}, PARKING])
def test_no_dispersion_is_the_nominal_flight_to_the_last_bit(changes):
    card = ascent_card(**changes)
    aim = solve(card)
    nominal, (_, same, flight) = fly_ascent(card, aim), fly_dispersed(card, aim, Dispersion.model_construct())
    assert same == aim
    assert flight.events == nominal.events
    for one, other in zip(flight.legs, nominal.legs, strict=True):
        np.testing.assert_array_equal(one.y, other.y)


@pytest.mark.parametrize(("thrust", "impulse", "mass"), [(1.03, 1.0, 1.0), (1.0, 0.99, 1.0), (1.0, 1.01, 1.03)])
def test_in_vacuum_the_speed_gained_is_that_of_the_rocket_equation(thrust, impulse, mass):
    card = ascent_card(dispersion={"thrust": thrust, "specific_impulse": impulse, "mass": mass})
    truth, stage = build(card), card.vehicle.stages[1]
    start, end = truth.events["fairing_separation"] + 1e-6, truth.events["stage2_cutoff"] - 1e-6
    t = np.linspace(start, end, 20001)
    force = np.linalg.norm(motion(truth, t).f_b, axis=1)
    exhaust = 9.80665 * stage.specific_impulse * impulse
    flow = stage.thrust * thrust / exhaust
    full = mass * (stage.dry + card.vehicle.payload) + stage.propellant
    before, after = (full - flow * (when - truth.events["stage2_ignition"]) for when in (start, end))
    # air at the release of the fairing takes some millimetres a second
    assert np.trapezoid(force, t) == pytest.approx(exhaust * math.log(before / after), rel=2e-4)


def test_a_motor_of_more_thrust_and_less_impulse_burns_shorter_and_an_empty_stage_is_cut_off():
    card = ascent_card(dispersion={"thrust": 1.1, "specific_impulse": 0.93})
    nominal = fly_ascent(card, solve(card))
    vehicle, aim, flight = dispersed_ascent(card)
    stage = card.vehicle.stages[1]
    assert flight.events["stage1_cutoff"] < nominal.events["stage1_cutoff"]
    assert flight_propellant_left(vehicle, flight, 2) == pytest.approx(0.0, abs=1e-5)
    assert aim.burn == pytest.approx(stage.full_burn * 0.93 / 1.1, rel=1e-6)


def test_a_pitch_programme_is_moved_by_the_angle():
    aim = raise_pitch(TargetingUnknowns(1.0, 0.1, 0.4, -0.2, 100.0), 0.01)
    assert aim.kick == pytest.approx(0.09)
    assert math.atan(aim.tangent) - math.atan(0.4) == pytest.approx(0.01)
    assert math.atan(aim.tangent_end) - math.atan(-0.2) == pytest.approx(0.01)
    up, down = (build(ascent_card(dispersion={"pitch_program": f"{angle} deg"})) for angle in (0.2, -0.2))
    heights = [np.linalg.norm(motion(one, [one.events["stage1_cutoff"]]).r_i) for one in (up, down)]
    assert heights[0] - heights[1] > 500.0


def test_a_dispersion_that_changes_nothing_is_refused():
    with pytest.raises(ValueError, match="changes nothing"):
        Dispersion(thrust=1.0)


def test_a_vehicle_that_cannot_be_flown_is_refused_by_name():
    card = ascent_card(dispersion={"thrust": 1.9, "specific_impulse": 0.55})
    late = card.vehicle.fairing.model_copy(update={"after_ignition": 1e4})
    broken = card.model_copy(
        update={
            "vehicle": card.vehicle.model_copy(
                update={"fairing": late, "stages": (*card.vehicle.stages, card.vehicle.stages[-1])}
            )
        }
    )
    with pytest.raises(InputError) as caught:
        fly_dispersed(broken, TargetingUnknowns(1.0, 0.1, 0.4, -0.2, 100.0), card.dispersion)
    assert caught.value.records[0].path == "trajectory.dispersion"


@pytest.mark.parametrize(("thrust", "message"), [("0.6", "does not lift off"), ("0.85", "falls to the ground")])
def test_a_vehicle_too_weak_is_refused(thrust, message):
    with pytest.raises(InputError, match=message):
        build(ascent_card(dispersion={"thrust": thrust}))
