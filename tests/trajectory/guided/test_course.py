"""An ascent as a vehicle under control meets it: thrust, moment, wind and rate against the truth's own formulas."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity, matrices
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.trajectory.control_cards import ControllerCard, FeedbackCard, RotationCard, WindCard
from lvnav_trade.trajectory.flight import motion
from lvnav_trade.trajectory.guided import autopilot, axis_state
from lvnav_trade.trajectory.guided.course import PITCH, YAW, ascend, ascent_course, stage_event_times
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.guided_dynamics import PERFECT, Wind
from lvnav_trade.trajectory.guided.missions import attitude_control, launch_wind, prepare_launch
from lvnav_trade.trajectory.guided.pilots import TurningPilot
from lvnav_trade.trajectory.guided.turning import forces_and_rates
from tests.trajectory.flight_cases import _load, ascent_card

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


FIRST = autopilot.DrawKeys(np.uint64(1), np.uint64(2), np.uint64(0))


def launch(stacks: int = 2, stages: int = 2):
    wind = WindCard.model_validate(_load("wind/moderate") | {"spread": "0 %"})
    imu = ImuCard.model_validate(_load("imu/kvh1750_003"))
    return prepare_launch(ascent(), rotation(stacks), controller(stages), wind, imu)


def met(number: int, t: float):
    """Return what the vehicle meets at a time in the nominal burn of a stage, and the time derivative of its state."""
    leg = next(
        leg for leg in ascent().legs if leg.name.startswith(f"stage {number} burn") and leg.t[0] <= t <= leg.t[-1]
    )
    y = np.array([np.interp(t, leg.t, column) for column in leg.y.T])
    at = motion(ascent().trajectory, [t])
    y[:3], y[3:6] = at.r_i[0], at.v_i[0]
    turning, known = attitude_control(launch(), FeedbackCard(), FIRST), ascent().plan
    turning.control.counts[autopilot.STACK] = number
    turning.control.counts[autopilot.NEXT] = round(t * 200.0)
    differs = deviations(known.card, {})
    differs = differs._replace(wind=launch_wind(launch(), FIRST, differs.wind))
    inputs = TurningPilot(known, ascent().card, differs, PERFECT, turning).inputs
    return forces_and_rates(t, y, leg.engine, inputs, turning), y


def test_thrust_over_mass_is_the_specific_force_of_the_truth_in_vacuum():
    events = ascent().trajectory.events
    for part in (0.4, 0.6, 0.9):
        t = events["stage2_ignition"] + part * (events["stage2_cutoff"] - events["stage2_ignition"])
        (found, slope), _ = met(2, t)
        assert found.force < 1e-6
        assert found.thrust_load == pytest.approx(np.linalg.norm(motion(ascent().trajectory, [t]).f_b), rel=1e-4)
        # nothing is deflected: the vehicle accelerates as the nominal one does
        nominal = ascent().trajectory.phases[-2].position(t, 2)
        np.testing.assert_allclose(slope[3:6], nominal, atol=2e-3)


def test_effectiveness_is_thrust_times_arm_over_inertia_of_a_rod():
    # T (L / 2) / (m L^2 / 12) = 6 T / (m L)
    events = ascent().trajectory.events
    for stage, length in ((1, 15.0), (2, 7.5)):
        t = 30.0 if stage == 1 else events["stage2_ignition"] + 50.0
        (found, _), _ = met(stage, t)
        assert found.effectiveness == pytest.approx(6.0 * found.thrust_load / length, rel=1e-12)


def test_a_burn_is_one_phase_of_the_course_and_what_changes_at_its_ends_another():
    course, events = launch().course, ascent().trajectory.events
    inside = course.t[course.phase == autopilot.BURN]
    assert inside.min() < 5.0
    for cutoff, ignition in (("stage1_cutoff", "stage2_ignition"),):
        assert not ((inside > events[cutoff]) & (inside < events[ignition])).any()
    found = stage_event_times(ascent().trajectory)
    named = ("liftoff", "stage1_cutoff", "stage1_separation", "stage2_ignition", "stage2_cutoff")
    np.testing.assert_allclose(found, sorted(events[name] for name in named))
    assert all(autopilot.CHANGE == course.phase[np.searchsorted(course.t, t + 0.1)] for t in found)


def test_the_aerodynamic_moment_is_dynamic_pressure_times_area_slope_and_arm():
    card, t = ascent().card, ascent().trajectory.events["max_q"]
    (found, _), y = met(1, t)
    stack = rotation().stacks[0]
    ratio = found.moment / found.force  # arm over the square of the radius of gyration
    assert ratio == pytest.approx(stack.pressure_arm * stack.length / (stack.length**2 / 12.0), rel=1e-9)
    peak = float(ascent().trajectory.facts["max_dynamic_pressure_pa"])
    at = motion(ascent().trajectory, [t])
    ground = np.linalg.norm(earth_velocity(at.r_i, at.v_i)[0])
    still = found.force * ground**2 / found.airspeed  # the wind is part of the airspeed
    assert still * y[6] / (card.vehicle.reference_area * stack.normal_force) == pytest.approx(peak, rel=4e-3)


def test_wind_and_slip_are_components_along_the_way_of_the_nose():
    (found, _), _ = met(1, 60.0)
    at = motion(ascent().trajectory, [60.0])
    C_b_i, v_i = matrices(at.q_b_i)[0], earth_velocity(at.r_i, at.v_i)[0]
    assert found.slip[PITCH] == pytest.approx(-C_b_i[:, 2] @ v_i, abs=1e-5)
    assert found.slip[YAW] == pytest.approx(C_b_i[:, 1] @ v_i, abs=1e-5)
    assert found.drift == pytest.approx((0.0, 0.0), abs=1e-6)
    # the steady wind's part along the body is not lateral: what is left of it is at most its speed
    assert 1.0 < math.hypot(*found.wind) <= 33.0


def test_the_wind_of_a_launch_blows_from_its_direction_with_its_speed_and_another_adds_to_it():
    one = launch()
    card = one.wind.model_copy(update={"direction": math.radians(200.0)})
    calm = Wind(500.0, np.zeros((1, 2)))
    blown = launch_wind(one._replace(wind=card), FIRST, calm)
    k = round(11000.0 / blown.step)
    speed = np.interp(11000.0, card.height, card.speed)
    np.testing.assert_allclose(blown.speed[k], [-speed * math.sin(card.direction), -speed * math.cos(card.direction)])
    more = launch_wind(one._replace(wind=card), FIRST, Wind(500.0, np.tile([3.0, -2.0], (61, 1))))
    np.testing.assert_allclose(more.speed[k] - blown.speed[k], [3.0, -2.0])
    drawn = card.model_copy(update={"spread": 0.3})
    along, across = axis_state.profile_draws(FIRST)
    found = launch_wind(one._replace(wind=drawn), FIRST, calm).speed[k]
    ahead = blown.speed[k] / speed
    assert found @ ahead == pytest.approx(speed * (1.0 + 0.3 * along))
    assert abs(ahead[0] * found[1] - ahead[1] * found[0]) == pytest.approx(abs(0.3 * across) * speed)


def test_pitch_and_yaw_rates_of_the_command_are_those_of_the_truth():
    course = launch().course
    at = motion(ascent().trajectory, course.t)
    np.testing.assert_array_equal(course.rate, at.w_ib_b[:, 1:])
    np.testing.assert_array_equal(course.velocity, at.v_i)
    np.testing.assert_allclose(np.cross(course.right, course.up), -course.ahead, atol=1e-12)


def test_a_manoeuvre_turns_by_its_angle_in_its_time():
    turn = {"start": "stage2_ignition + 20 s", "axis": "yaw", "angle": "2 deg", "duration": "5 s"}
    course = ascent_course(ascent(), controller(turns=[turn]), EnvelopeCard(), RATE)
    begin = ascent().trajectory.events["stage2_ignition"] + 20.0
    assert not course.turn[:, PITCH].any()
    assert not course.turn[course.t <= begin, YAW].any()
    np.testing.assert_allclose(course.turn[course.t >= begin + 5.0, YAW], math.radians(2.0))
    np.testing.assert_allclose(np.gradient(course.turn[:, YAW], 1.0 / RATE), course.turn_rate[:, YAW], atol=2e-4)
    with pytest.raises(InputError, match="no event 'stage9'"):
        ascent_course(ascent(), controller(turns=[turn | {"start": "stage9"}]), EnvelopeCard(), RATE)


def test_cards_for_another_number_of_stages_are_refused():
    with pytest.raises(InputError, match=r"three_motor: 3 stacks, .* has 2 stages"):
        launch(stacks=3)
    with pytest.raises(InputError, match="three_motor: 1 gains"):
        launch(stages=1)
