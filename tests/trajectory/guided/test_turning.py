"""How the attitude answers in guided runs: a lag against closed forms, a controlled body against scipy, and limits."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from lvnav_trade.kernels.earth import OMEGA, gravity_j4
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities.frames import elements_from_state
from lvnav_trade.trajectory.ascent.equations_of_motion import height_above, interpolate_drag
from lvnav_trade.trajectory.ascent.legs import COASTING
from lvnav_trade.trajectory.guided import autopilot, axis_state
from lvnav_trade.trajectory.guided.ascent_runs import inject
from lvnav_trade.trajectory.guided.course import ascend
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import PERFECT, AttitudeProgramme, fly_piece
from lvnav_trade.trajectory.guided.missions import attitude_control, steered_launch
from lvnav_trade.trajectory.guided.pilots import INJECTED, GuidedPilot, TurningPilot
from lvnav_trade.trajectory.guided.turning import NEVER, turn_piece
from tests.trajectory.guided.cases import constant_error, guided
from tests.trajectory.guided.launches import settings


def under_control(guidance: str = "explicit", calm: str = "", **changes):
    """The three-motor ascent whose runs fly under attitude control.

    calm: attitude that its controller sees without wind, lift, misalignment and errors of the unit.
    """
    rotation, controller = settings("rotation/three_motor"), settings("controllers/three_motor")
    if calm:
        rotation["nozzle"]["misalignment"] = "0 deg"
        rotation["stacks"] = [stack | {"normal_force": 0.0} for stack in rotation["stacks"]]
    control = {
        "rotation": rotation, "controller": controller | {"guidance": None}, "imu": settings("imu/kvh1750_003"),
        "feedback": {"rate": "true", "attitude": calm, "noise": "none"} if calm else {},
    }  # fmt: skip
    if not calm:
        control["wind"] = settings("wind/moderate")
    return guided("churchill_sso", guidance=guidance, control=control, **changes)


@cache
def known(**how):
    return plan_ascent(under_control(**how))


def draws(run: int) -> autopilot.DrawKeys:
    return autopilot.DrawKeys(np.uint64(3), np.uint64(4), np.uint64(run))


# --- a lag ------------------------------------------------------------------------------------------------------------


def test_a_lag_follows_a_turning_command_late_by_its_time_constant():
    """u turns at a constant rate: the body, first along u, ends at the exact solution of b' = (u - b) / T."""
    rate, lag = math.radians(2.0), 0.6
    plan = plan_ascent(guided("two_stage_leo", guidance="open_loop", attitude_lag=f"{lag} s"))
    pilot = GuidedPilot(plan, plan.card, deviations(plan.card, {}), PERFECT)
    t = np.arange(0.0, 40.0, 0.05)
    u = np.stack([np.cos(rate * t), np.sin(rate * t), np.zeros(t.size)], axis=1)
    inputs = pilot.inputs._replace(programme=AttitudeProgramme(0.05, u))
    y = np.concatenate([pilot.y[:7], u[0]])
    for end in (0.7, 3.0, 20.0):
        found = fly_piece(0.0, end, pilot.longest, y, COASTING, inputs)[7:]
        wave = np.exp(1j * rate * end) / (1.0 + 1j * rate * lag)
        wave += (1.0 - 1.0 / (1.0 + 1j * rate * lag)) * np.exp(-end / lag)
        np.testing.assert_allclose(found, [wave.real, wave.imag, 0.0], atol=2e-5)


def test_an_open_loop_with_a_lag_is_that_of_a_programme_that_is_late():
    """To first order in the lag the body does at t what the programme says at t - lag."""
    lag = 0.4
    at_once = plan_ascent(guided("two_stage_leo", guidance="open_loop", cutoff="time"))
    lagged = plan_ascent(guided("two_stage_leo", guidance="open_loop", cutoff="time", attitude_lag=f"{lag} s"))
    u = at_once.programme.u
    t = at_once.programme.step * np.arange(len(u))
    late = np.stack([np.interp(t - lag, t, one) for one in u.T], axis=1)
    late /= np.linalg.norm(late, axis=1)[:, None]
    shifted = at_once._replace(programme=AttitudeProgramme(at_once.programme.step, late))
    nominal, wanted, found = (inject(one, {}).y for one in (at_once, shifted, lagged))
    moved = np.linalg.norm((wanted - nominal)[3:6])
    assert moved > 5.0  # m/s: a lag has an effect
    assert np.linalg.norm((found - wanted)[3:6]) < 0.02 * moved
    assert np.linalg.norm((found - wanted)[:3]) < 0.02 * np.linalg.norm((wanted - nominal)[:3])


def test_explicit_guidance_takes_the_effect_of_a_lag_out():
    plan = plan_ascent(guided("two_stage_leo", attitude_lag="0.5 s"))
    found = inject(plan, {})
    assert found.outcome == INJECTED
    achieved, wanted = (elements_from_state(y[:3], y[3:6]) for y in (found.y, plan.nominal))
    assert abs(float(achieved.semi_major_axis - wanted.semi_major_axis)) < 1.0
    assert abs(float(achieved.eccentricity - wanted.eccentricity)) * 7e6 < 500.0


# --- a body under control ---------------------------------------------------------------------------------------------


def test_a_body_and_its_path_follow_the_equations_of_motion_of_an_independent_integrator():
    """A burn in the wind with the nozzle centred, so that nothing holds the body: attitude and path by scipy."""
    card = under_control("open_loop")
    ascent = ascend(card)
    gains = tuple(one.model_copy(update={"attitude": 0.0, "rate": 0.0, "integral": 0.0})
                  for one in card.control.controller.gains)  # fmt: skip
    control = card.control.model_copy(
        update={"controller": card.control.controller.model_copy(update={"gains": gains}), "wind": None}
    )
    launch = steered_launch(ascent, control)
    turning = attitude_control(launch, control.feedback, draws(0))
    begin, end = 40.0, 43.0
    pilot = TurningPilot(plan_ascent(card), card, deviations(card, {}), PERFECT, turning)
    leg = next(leg for leg in ascent.legs if leg.t[0] <= begin < leg.t[-1])
    y = np.array([np.interp(begin, leg.t, column) for column in leg.y.T])
    count, memory = turning.control.counts, turning.control.memory
    count[autopilot.NEXT], count[autopilot.STACK] = round(begin * 200.0), 1
    memory[0, axis_state.ANGLE_NOW], memory[1, axis_state.ANGLE_NOW] = 0.01, -0.02
    memory[0, axis_state.RATE_NOW], memory[1, axis_state.RATE_NOW] = 0.004, 0.001
    start = memory[:, [axis_state.ANGLE_NOW, axis_state.RATE_NOW]].copy()
    _, found, _ = turn_piece(begin, end, y, leg.engine, pilot.inputs, turning, NEVER)
    misaligned = memory[:, axis_state.MISALIGNMENT_NOW].copy()
    assert np.abs(misaligned).min() > 1e-5

    stack, course = card.control.rotation.stacks[0], launch.course
    nozzle, arm = stack.nozzle_arm * stack.length, stack.pressure_arm * stack.length

    def slope(t, z):
        r, v, mass, angle, rate = z[:3], z[3:6], z[6], z[7:9], z[9:11]
        ahead, up, right = (np.array([np.interp(t, course.t, one) for one in rows.T])
                            for rows in (course.ahead, course.up, course.right))  # fmt: skip
        w = v - np.cross([0.0, 0.0, OMEGA], r)
        speed = np.linalg.norm(w)
        density, pressure, _, sound = atmosphere(height_above(*r))
        engine = leg.engine
        beside = engine.unthrottled_motors
        thrust = engine.thrust - pressure * engine.exit_area if engine.thrust else 0.0
        flow = engine.mass_flow if engine.thrust else 0.0
        if beside.thrust:
            thrust += beside.thrust + beside.thrust_slope * (t - beside.reference_time) - pressure * beside.exit_area
            flow += beside.mass_flow + beside.flow_slope * (t - beside.reference_time)
        sides = np.stack([up, right])
        direction = ahead + (angle + misaligned) @ sides
        direction /= np.linalg.norm(direction)
        area = card.vehicle.reference_area
        drag = 0.5 * density * speed * interpolate_drag(speed / sound, pilot.drag) * area
        across = speed * angle - sides @ w  # of the air against the body
        axial = drag * ((w @ ahead) * ahead + speed * (angle @ sides))
        lift = 0.5 * density * speed * area * stack.normal_force * across
        a = np.array(gravity_j4(*r)) + (thrust * direction - axial + lift @ sides) / mass
        inertia = mass * (stack.gyration * stack.length) ** 2
        k = int(t * 200.0 + 1e-6)
        alpha = (course.rate[k + 1] - course.rate[k]) * 200.0
        turn = (-thrust * nozzle * misaligned + lift * arm) / inertia - alpha
        return np.concatenate([v, a, [-flow], rate, turn])

    z = np.concatenate([y, start[:, 0], start[:, 1]])
    wanted = solve_ivp(slope, (begin, end), z, rtol=1e-10, atol=1e-9, max_step=0.005).y[:, -1]
    np.testing.assert_allclose(memory[:, axis_state.ANGLE_NOW], wanted[7:9], rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(memory[:, axis_state.RATE_NOW], wanted[9:11], rtol=2e-3, atol=1e-6)
    # its lift moves it aside by metres
    assert np.linalg.norm(found[:3] - wanted[:3]) < 5e-3
    assert np.linalg.norm(found[3:6] - wanted[3:6]) < 0.01
    assert np.abs(wanted[7:9] - start[:, 0]).max() > 0.02  # it falls over
    assert found[6] == pytest.approx(wanted[6], abs=1e-6)


@pytest.mark.parametrize("guidance", ["open_loop", "explicit"])
def test_a_calm_launch_with_an_ideal_controller_is_that_of_a_body_that_follows_at_once(guidance):
    control = inject(known(guidance=guidance, calm="true"), {}, draws=draws(0))
    at_once = inject(plan_ascent(guided("churchill_sso", guidance=guidance)), {})
    assert control.outcome == at_once.outcome == INJECTED
    one, other = (elements_from_state(y[:3], y[3:6]) for y in (control.y, at_once.y))
    assert abs(float(one.semi_major_axis - other.semi_major_axis)) < 5.0
    near = {"open_loop": 20e3, "explicit": 1e3}[guidance]  # in the coasts nothing turns the vehicle as its course slews
    assert abs(float(one.eccentricity - other.eccentricity)) * 7e6 < near


def test_the_attitude_error_of_the_runs_navigation_tilts_a_body_under_control():
    tilt = np.array([2e-4, -1e-4, 3e-4])
    moved = []
    calm = known(guidance="open_loop", calm="navigation")
    for plan in (calm, plan_ascent(guided("churchill_sso", guidance="open_loop"))):
        flown = [inject(plan, {}, constant_error(attitude=sign * tilt), draws(1)).y for sign in (1.0, -1.0)]
        moved.append(0.5 * (flown[0] - flown[1]))
    assert np.linalg.norm(moved[1][3:6]) > 0.5
    assert np.linalg.norm((moved[0] - moved[1])[3:6]) < 0.05 * np.linalg.norm(moved[1][3:6])


def test_every_run_meets_gusts_noises_and_misalignments_of_its_own_and_the_law_takes_them_out():
    flown = [inject(known(), {}, draws=draws(run)) for run in (0, 1, 2)]
    again = inject(known(), {}, draws=draws(1))
    np.testing.assert_array_equal(again.y, flown[1].y)
    assert len({one.t for one in flown}) == 3
    assert {one.outcome for one in flown} == {INJECTED}
    radius = [np.linalg.norm(one.y[:3]) - np.linalg.norm(known().nominal[:3]) for one in flown]
    assert np.abs(radius).max() < 1.5e3
    opened = [inject(known(guidance="open_loop"), {}, draws=draws(run)).y for run in (0, 1, 2)]
    assert np.std([np.linalg.norm(y[:3]) for y in opened]) > 3.0 * np.std(radius)


def test_sources_of_the_vehicle_act_on_a_body_under_control_as_on_one_that_follows_at_once():
    """Thrust of the second motor, dry mass of the first stage, and drag: three sigma, in calm air."""
    plain = plan_ascent(guided("churchill_sso", guidance="open_loop", cutoff="time"))
    turning = known(guidance="open_loop", calm="true", cutoff="time")
    for name, sigmas in (("thrust", [0.0, 3.0, 0.0]), ("dry_mass", [3.0, 0.0, 0.0]), ("drag", [3.0])):
        moved = [
            inject(plan, {name: np.array(sigmas)}, draws=draws(0)).y - inject(plan, {}, draws=draws(0)).y
            for plan in (plain, turning)
        ]
        size = np.linalg.norm(moved[0][3:6])
        assert size > 0.3, name
        assert np.linalg.norm((moved[1] - moved[0])[3:6]) < 0.1 * size, name


# --- mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "message"), [
    ({"attitude_lag": "0.5 s"}, "attitude_lag: control also states"),
    ({"oscillation": [{"start": "10 s", "end": "20 s", "coning": [{"angle": "0.1 deg", "frequency": "2 Hz"}]}]},
     "oscillation: with guidance"),
])  # fmt: skip
def test_two_ways_of_answering_a_command_are_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        under_control(**change)


@pytest.mark.parametrize(("change", "message"), [
    ({"realisation": 2}, "control.realisation has no effect with guidance: explicit, every run is a launch"),
    ({"controller": "controllers/three_motor"}, "both correct the commanded attitude"),
    ({"feedback": {"reference_sigma": "2 deg"}}, "control.feedback.reference_sigma has no effect with guidance"),
])  # fmt: skip
def test_what_a_guided_run_does_not_read_is_refused(change, message):
    given = under_control().model_dump(mode="json")["control"]
    change = {name: settings(value) if isinstance(value, str) else value for name, value in change.items()}
    with pytest.raises(ValidationError, match=message):
        guided("churchill_sso", control=given | change)
