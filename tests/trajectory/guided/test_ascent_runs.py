"""Guided runs against limits, closed forms, and an independent simulation of each source."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lvnav_trade.kernels.earth import GM, OMEGA, gravity_j4
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.quantities.frames import earth_angle, elements_from_state, geodetic_from_ecef, gmst
from lvnav_trade.trajectory.ascent.legs import pad_state
from lvnav_trade.trajectory.guided.ascent_runs import inject
from lvnav_trade.trajectory.guided.draws import WIND_STEP, deviations, draw, numbers, run_vehicle
from lvnav_trade.trajectory.guided.guidance_plan import plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors
from lvnav_trade.trajectory.guided.pilots import ADRIFT, DEPLETED, INJECTED
from tests.trajectory.guided.cases import constant_error, guided, plan

ONE_BY_ONE = [
    "thrust", "specific_impulse", "propellant", "dry_mass", "drag", "density", "wind", "thrust_misalignment",
    "separation_impulse", "ignition_delay", "tail_off",
]  # fmt: skip


@pytest.mark.parametrize("name", ["two_stage_leo", "electron_leo", "churchill_sso", "pslv_polar"])
@pytest.mark.parametrize("cutoff", ["energy", "time"])
def test_an_open_loop_without_errors_is_the_nominal_flight(name, cutoff):
    known = plan(name, "open_loop", cutoff)
    found = inject(known, {})
    assert found.outcome == INJECTED
    assert np.linalg.norm(found.y[:3] - known.nominal[:3]) < 1.0
    assert np.linalg.norm(found.y[3:6] - known.nominal[3:6]) < 1e-3
    assert found.y[6] == pytest.approx(known.nominal[6], abs=1e-3)


@pytest.mark.parametrize("name", ["two_stage_leo", "electron_leo", "churchill_sso", "pslv_polar"])
def test_explicit_guidance_without_errors_reaches_the_target(name):
    known = plan(name)
    found = inject(known, {})
    achieved, wanted = (elements_from_state(y[:3], y[3:6]) for y in (found.y, known.nominal))
    assert abs(float(achieved.semi_major_axis - wanted.semi_major_axis)) < 1.0
    assert abs(float(achieved.eccentricity - wanted.eccentricity)) * 7e6 < 300.0
    assert abs(float(achieved.inclination - wanted.inclination)) < 1e-6


@pytest.mark.parametrize("name", ["two_stage_leo", "electron_leo", "churchill_sso", "pslv_polar"])
def test_the_schuler_approximation_reaches_the_same_orbit_for_more_propellant(name):
    """It does not know of the flattening of the Earth, which pulls sideways while the law is kept: 10 to 11 s."""
    integrated, known = inject(plan(name), {}), plan(name, "schuler")
    found = inject(known, {})
    achieved, wanted = (elements_from_state(y[:3], y[3:6]) for y in (found.y, known.nominal))
    assert found.outcome == INJECTED
    assert abs(float(achieved.semi_major_axis - wanted.semi_major_axis)) < 1.0
    assert abs(float(achieved.eccentricity - wanted.eccentricity)) * 7e6 < 300.0
    sideways = 1.5 * 1.0826e-3 * 9.8  # m/s^2, the most of it
    speed = np.linalg.norm(known.nominal[3:6])
    assert 1e-7 < abs(float(achieved.inclination - wanted.inclination)) < 11.0 * sideways / speed
    # an ascent that climbs over most of its last burn pays for it; one that lights high up does not
    assert -0.1 < integrated.propellant_left - found.propellant_left < 2.0
    assert integrated.propellant_left != found.propellant_left


def test_explicit_guidance_takes_out_what_the_open_loop_leaves():
    spread = {}
    for guidance in ("open_loop", "explicit"):
        known = plan("two_stage_leo", guidance)
        flown = [inject(known, draw(known.card, 5, run)).y for run in range(30)]
        spread[guidance] = np.std([np.linalg.norm(y[:3]) for y in flown])
    assert spread["explicit"] < 0.1 * spread["open_loop"]


def test_with_perfect_guidance_the_injection_error_is_plus_the_navigation_error():
    """An error of the navigated state, truth less estimate, that lasts is the error of the achieved state."""
    velocity, position = np.array([0.4, -0.3, 0.5]), np.array([300.0, -200.0, 250.0])
    known = plan()
    reference, found = inject(known, {}), inject(known, {}, constant_error(velocity=velocity, position=position))
    radial, normal = known.nominal[:3] / np.linalg.norm(known.nominal[:3]), known.target.normal
    track, speed, radius = (
        np.cross(normal, radial),
        np.linalg.norm(known.nominal[3:6]),
        np.linalg.norm(known.nominal[:3]),
    )
    moved = found.y - reference.y
    # The place along the track is free, so heights and climbs are compared. The law is kept for its last 10 s, in
    # which a speed that the navigation does not know of moves the place by some metres.
    heights, climbs = zip(*(_height_and_climb(y) for y in (found.y, reference.y)), strict=True)
    assert heights[0] - heights[1] == pytest.approx(radial @ position, abs=7.0)
    # the navigated vertical is off by the navigated place along the track
    wanted = radial @ velocity + speed * (track @ position) / radius
    assert climbs[0] - climbs[1] == pytest.approx(wanted, abs=0.02)
    assert normal @ moved[:3] == pytest.approx(normal @ position, abs=7.0)
    assert normal @ moved[3:6] == pytest.approx(normal @ velocity, abs=0.02)
    gained = [0.5 * y[3:6] @ y[3:6] - GM / np.linalg.norm(y[:3]) for y in (found.y, reference.y)]
    slope = known.nominal[3:6] @ velocity + GM / np.linalg.norm(known.nominal[:3]) ** 2 * (radial @ position)
    assert gained[0] - gained[1] == pytest.approx(slope, rel=2e-3)


def _height_and_climb(y):
    length = np.linalg.norm(y[:3])
    return length, y[3:6] @ y[:3] / length


def test_a_tilt_of_the_reference_turns_an_open_loop_sideways_by_the_integrated_thrust():
    """Out of the plane gravity and air pull back little: lateral speed is the tilt times what the thrust gives upward.

    The tilt is about the vertical at cut-off, so that the plane's lateral axis sees the horizontal thrust.
    """
    known, tilt = plan("two_stage_leo", "open_loop", "time"), 1e-4
    stage = known.card.vehicle.stages[1]
    up, normal = known.nominal[:3] / np.linalg.norm(known.nominal[:3]), known.target.normal
    # the tilt begins with the last stage: before it, none
    start = 200.0
    error = np.zeros((4, 9))
    error[2:, :3] = tilt * up
    tilted = NavigationErrors(np.array([-60.0, start, start + 1e-6, 600.0]), error)
    moved = inject(known, {}, tilted).y - inject(known, {}).y
    t = np.linspace(start, known.cutoff, 20001)
    flow = stage.thrust / stage.exhaust_speed
    mass = known.nominal[6] + flow * (known.cutoff - t)
    # the fairing has left before
    u = np.stack(
        [np.interp(t, known.programme.step * np.arange(len(known.programme.u)), one) for one in known.programme.u.T]
    ).T
    wanted = tilt * np.trapezoid((stage.thrust / mass)[:, None] * np.cross(up, u), t, axis=0)
    # gravity turns the lateral speed back by the angle flown, some 20 deg of it: bound by its cosine
    assert normal @ moved[3:6] == pytest.approx(normal @ wanted, rel=0.06)


def test_an_empty_stage_is_an_outcome():
    card = guided("electron_leo", dispersion={"sigmas": {"specific_impulse": -4.0, "propellant": -4.0}})
    known = plan_ascent(card)
    found = inject(known, draw(card, 1, 0))
    assert (found.outcome, found.propellant_left) == (DEPLETED, 0.0)
    speed = np.linalg.norm(found.y[3:6])
    assert speed < np.linalg.norm(known.nominal[3:6]) - 20.0


def test_a_navigation_that_failed_injects_nothing():
    lost = constant_error(velocity=(np.nan, 0.0, 0.0))
    assert inject(plan(), {}, lost).outcome == ADRIFT


def test_propellant_left_follows_the_rocket_equation():
    """More specific impulse of the last stage alone leaves more: the speed to be gained hardly changes."""
    known = plan()
    n, spreads = len(known.card.vehicle.stages), known.card.vehicle.dispersions
    sigmas = {"specific_impulse": np.array([0.0] * (n - 1) + [3.0])}
    more, before = inject(known, sigmas), inject(known, {})
    stage = known.card.vehicle.stages[-1]
    empty = stage.dry + known.card.vehicle.payload
    start = empty + stage.propellant
    gain = stage.exhaust_speed * math.log(start / (empty + before.propellant_left))  # fairing and losses alike in both
    left = start * math.exp(-gain / (stage.exhaust_speed * (1.0 + 3.0 * spreads.specific_impulse))) - empty
    assert more.propellant_left - before.propellant_left == pytest.approx(left - before.propellant_left, rel=0.05)


def _independent(known, sigmas):
    """Return position and velocity (frame i) at the nominal cut-off time: electron, open loop, in the turning frame.

    Mass and thrust are functions of time alone, written out from the card; steps by DOP853 between the jumps.
    """
    card, differs = run_vehicle(known.card, sigmas), deviations(known.card, sigmas)
    first, second = card.vehicle.stages
    fairing = card.vehicle.fairing
    out1 = first.full_burn
    apart = out1 + first.separation_delay
    lit = apart + second.ignition_delay
    above = second.dry + second.propellant + card.vehicle.payload + fairing.mass

    def level(stage, s):
        part, thrust = np.array(stage.profile.part), np.array(stage.profile.thrust)
        mean = np.trapezoid(thrust, part)
        return stage.full_thrust / mean * np.interp(s / stage.full_burn, part, thrust)

    def burnt(stage, s):
        part, thrust = np.array(stage.profile.part), np.array(stage.profile.thrust)
        x = np.unique(np.append(part[part < s / stage.full_burn], s / stage.full_burn))
        return stage.propellant * np.trapezoid(np.interp(x, part, thrust), x) / np.trapezoid(thrust, part)

    def thrust_mass(t, k):
        if k == 0:
            return level(first, t), above + first.dry + first.propellant - burnt(first, t), first.exit_area
        if k == 1:
            return 0.0, above + first.dry, 0.0
        if k == 2:
            return 0.0, above, 0.0
        gone = fairing.mass if k == 4 else 0.0
        return level(second, t - lit), above - gone - burnt(second, t - lit), 0.0

    spin = np.array([0.0, 0.0, OMEGA])

    def turn(t):
        c, s = math.cos(OMEGA * t), math.sin(OMEGA * t)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # frame i to one that turns, alike at lift-off

    table = known.programme.u
    grid = known.programme.step * np.arange(len(table))

    def direction(t, r_i, k):
        u = np.array([np.interp(t, grid, one) for one in table.T])
        u /= np.linalg.norm(u)
        down, right = differs.misalignment[0 if k < 3 else 1]
        side = np.cross(u, r_i)
        side /= np.linalg.norm(side)
        u = u + right * side - down * np.cross(side, u)
        return u / np.linalg.norm(u)

    def slope(t, y, k):
        r, w = y[:3], y[3:]
        to = turn(t)
        thrust, mass, exit_area = thrust_mass(t, k)
        height = float(geodetic_from_ecef(r)[2])
        density, pressure, _, sound = atmosphere(height)
        x = height / WIND_STEP
        air = np.zeros(3)
        if len(differs.wind.speed) > 1 and 0.0 <= x < len(differs.wind.speed) - 1:
            east, north = (np.interp(x, np.arange(len(differs.wind.speed)), one) for one in differs.wind.speed.T)
            e = np.cross([0.0, 0.0, 1.0], r)
            e /= np.linalg.norm(e)
            air = east * e + north * np.cross(r / np.linalg.norm(r), e)
        past = w - air
        speed = np.linalg.norm(past)
        coefficient = np.interp(speed / sound, card.vehicle.mach, card.vehicle.drag_coefficient)
        force = -0.5 * density * speed * coefficient * card.vehicle.reference_area * past
        if thrust > 0.0:
            force = force + (thrust - pressure * exit_area) * (to @ direction(t, to.T @ r, k))
        pull = to @ np.array(gravity_j4(*(to.T @ r)))
        return np.concatenate([w, pull + force / mass - 2.0 * np.cross(spin, w) - np.cross(spin, np.cross(spin, r))])

    theta0 = gmst(card.epoch)
    r, v = pad_state(card.site, float(earth_angle(theta0, 0.0)))
    y = np.concatenate([r, v - np.cross(spin, r)])
    bends = [part * out1 for part in first.profile.part[1:-1]]
    marks = [(0.0, 0)] + [(t, 0) for t in bends] + [(out1, 1), (apart, 2), (lit, 3)]
    after = [(lit + part * second.full_burn, 4) for part in second.profile.part[1:-1]]
    marks += [(lit + fairing.after_ignition, 4), *after, (known.cutoff, None)]
    for (begin, k), (end, _) in pairwise(marks):
        if k == 2:  # the separation gives a speed along the thrust
            y[3:] += float(differs.separation[0]) * (turn(begin) @ direction(begin, turn(begin).T @ y[:3], -1))
        y = solve_ivp(slope, (begin, end), y, args=(k,), method="DOP853", rtol=1e-10, atol=1e-7, max_step=2.0).y[:, -1]
    to = turn(known.cutoff)
    r, v = to.T @ y[:3], to.T @ (y[3:] + np.cross(spin, y[:3]))
    if differs.tail_off:
        u = np.array([np.interp(known.cutoff, grid, one) for one in table.T])
        v = v + differs.tail_off * u / np.linalg.norm(u)
    return np.concatenate([r, v])


@pytest.fixture(scope="module")
def undisturbed():
    known = plan("electron_leo", "open_loop", "time")
    return _independent(known, {})


@pytest.mark.parametrize("source", ONE_BY_ONE)
def test_an_independent_simulation_agrees_source_by_source(source, undisturbed):
    """What one sigma of every number of a source moves at the cut-off, by both; the vehicle has no throttle."""
    known = plan("electron_leo", "open_loop", "time")
    n = numbers(known.card)[source]
    # signs that leave the last stage propellant until the time of the cut-off
    sign = -1.0 if source in ("thrust",) else 1.0
    sigmas = {source: sign * np.where(np.arange(n) % 3 == 1, 0.5, 1.0)}
    mine, theirs = inject(known, sigmas), _independent(known, sigmas)
    assert mine.outcome == INJECTED
    moved, wanted = mine.y[:6] - inject(known, {}).y[:6], theirs - undisturbed
    assert np.linalg.norm(wanted[3:]) > 0.05
    assert np.linalg.norm(moved[:3] - wanted[:3]) < 1.0 + 3e-3 * np.linalg.norm(wanted[:3])
    assert np.linalg.norm(moved[3:] - wanted[3:]) < 2e-3 + 3e-3 * np.linalg.norm(wanted[3:])


def test_the_independent_simulation_is_the_nominal_flight_without_sources(undisturbed):
    known = plan("electron_leo", "open_loop", "time")
    assert np.linalg.norm(undisturbed[:3] - known.nominal[:3]) < 100.0
    assert np.linalg.norm(undisturbed[3:] - known.nominal[3:6]) < 0.3
