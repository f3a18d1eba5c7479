"""An ascent as the turning vehicle meets it: thrust, moment, wind and rate against the truth's own formulas."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_velocity, matrices
from lvnav_trade.world.control.ascent import PITCH, YAW, ascend, body_along, changes
from lvnav_trade.world.control_cards import ControllerCard, RotationCard, WindCard
from lvnav_trade.world.flight.trajectory import motion
from tests.world.flights import _load, ascent_card

RATE = 20.0


@cache
def ascent():
    return ascend(ascent_card())


def rotation(stacks: int = 2) -> RotationCard:
    given = _load("rotation/three_motor")
    return RotationCard.model_validate(given | {"stacks": given["stacks"][:stacks]})


def controller(stages: int = 2, **changed: Any) -> ControllerCard:
    given = _load("controllers/three_motor")
    return ControllerCard.model_validate(given | {"gains": given["gains"][:stages]} | changed)


def body(**changed: Any):
    return body_along(
        ascent(), rotation(), controller(**changed), WindCard.model_validate(_load("wind/moderate")), RATE
    )


def test_thrust_over_mass_is_the_specific_force_of_the_truth_in_vacuum():
    table = body()
    high = np.flatnonzero((table.motor == 2) & (table.force < 1e-9))[10:-10]
    assert high.size > 1000
    felt = np.linalg.norm(motion(ascent().trajectory, table.t[high]).f_b, axis=1)
    np.testing.assert_allclose(table.thrust_load[high], felt, rtol=1e-4)


def test_effectiveness_is_thrust_times_arm_over_inertia_of_a_rod():
    # T (L / 2) / (m L^2 / 12) = 6 T / (m L)
    table = body()
    for stage, length in ((1, 15.0), (2, 7.5)):
        burning = table.motor == stage
        np.testing.assert_allclose(table.effectiveness[burning], 6.0 * table.thrust_load[burning] / length, rtol=1e-12)
    assert not table.effectiveness[table.motor == 0].any()


def test_a_stage_burns_between_its_events_and_the_stack_changes_at_separation():
    table, events = body(), ascent().trajectory.events
    inside = table.t[table.motor == 1]
    assert inside[0] == 0.0
    assert inside[-1] == pytest.approx(events["stage1_cutoff"], abs=1.0 / RATE)
    assert table.t[table.motor == 2][0] == pytest.approx(events["stage2_ignition"], abs=1.0 / RATE)
    assert table.t[table.stack == 2][0] == pytest.approx(events["stage1_separation"], abs=1.0 / RATE)
    found = changes(ascent().trajectory)
    named = ("liftoff", "stage1_cutoff", "stage1_separation", "stage2_ignition", "stage2_cutoff")
    np.testing.assert_allclose(found, sorted(events[name] for name in named))


def test_the_aerodynamic_moment_is_dynamic_pressure_times_area_slope_and_arm():
    table, card = body(), ascent().card
    k = int(ascent().trajectory.events["max_q"] * RATE)
    stack = rotation().stacks[0]
    ratio = table.moment[k] / table.force[k]  # arm over the square of the radius of gyration
    assert ratio == pytest.approx(stack.pressure_arm * stack.length / (stack.length**2 / 12.0), rel=1e-9)
    peak = float(ascent().trajectory.facts["max_dynamic_pressure_pa"])
    per_mass = table.force[k] * table.airspeed[k] / (card.vehicle.reference_area * stack.normal_force)
    masses = np.interp(table.t[k], *_mass())
    assert per_mass * masses == pytest.approx(peak, rel=2e-3)


def _mass():
    t = np.concatenate([leg.t for leg in ascent().legs])
    return t, np.concatenate([leg.y[:, 6] for leg in ascent().legs])


def test_wind_and_slip_are_components_along_the_way_of_the_nose():
    table = body()
    k = int(60.0 * RATE)
    at = motion(ascent().trajectory, table.t[k : k + 1])
    C_b_i = matrices(at.q_b_i)[0]
    v_i = earth_velocity(at.r_i, at.v_i)[0]
    assert table.slip[k, PITCH] == pytest.approx(-C_b_i[:, 2] @ v_i, abs=1e-6)
    assert table.slip[k, YAW] == pytest.approx(C_b_i[:, 1] @ v_i, abs=1e-6)
    assert table.airspeed[k] == pytest.approx(float(np.linalg.norm(v_i)))
    # The steady wind's part along the body is not counted: what is left of it is at most its speed.
    speed = np.linalg.norm(table.wind[k], axis=0)
    assert np.all(speed <= 33.0)
    assert np.all(speed > 1.0)


def test_pitch_and_yaw_rates_of_the_command_are_those_of_the_truth():
    table = body()
    np.testing.assert_array_equal(table.rate, motion(ascent().trajectory, table.t).w_ib_b[:, 1:])


def test_a_manoeuvre_turns_by_its_angle_in_its_time():
    turn = {"start": "stage2_ignition + 20 s", "axis": "yaw", "angle": "2 deg", "duration": "5 s"}
    table = body(turns=[turn])
    begin = ascent().trajectory.events["stage2_ignition"] + 20.0
    assert not table.turn[:, PITCH].any()
    assert not table.turn[table.t <= begin, YAW].any()
    np.testing.assert_allclose(table.turn[table.t >= begin + 5.0, YAW], math.radians(2.0))
    np.testing.assert_allclose(np.gradient(table.turn[:, YAW], 1.0 / RATE), table.turn_rate[:, YAW], atol=2e-4)
    with pytest.raises(InputError, match="no event 'stage9'"):
        body(turns=[turn | {"start": "stage9"}])


def test_cards_for_another_number_of_stages_are_refused():
    wind = WindCard.model_validate(_load("wind/moderate"))
    with pytest.raises(InputError, match=r"three_motor: 3 stacks, .* has 2 stages"):
        body_along(ascent(), rotation(3), controller(), wind, RATE)
    with pytest.raises(InputError, match="three_motor: 1 gains"):
        body_along(ascent(), rotation(), controller(1), wind, RATE)
