"""A launch under wind and control is a trajectory of its own, and moves as the controlled loop does."""

from __future__ import annotations

import json
from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.simulation.preparation.vehicle_model import walks
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.flight import build, identity, motion, reference
from lvnav_trade.trajectory.guided import autopilot
from lvnav_trade.trajectory.guided.controlled_flight import fly_launch, steered_launch
from lvnav_trade.trajectory.guided.course import ascend
from lvnav_trade.trajectory.guided.missions import fly_missions
from tests.building import loaded
from tests.trajectory.guided.launches import settings


def card(**changes):
    """The three-motor ascent under control, fed with the raw rate of the published unit."""
    given = settings("trajectories/churchill_sso")
    given["vehicle"] = settings(given["vehicle"])
    given["control"] = {
        "rotation": settings("rotation/three_motor"), "controller": settings("controllers/three_motor"),
        "wind": settings("wind/moderate"), "imu": settings("imu/kvh1750_003_published"), "feedback": {"rate": "raw"},
    } | changes  # fmt: skip
    return VehicleAscent.model_validate(given)


@lru_cache(maxsize=1)
def ascent():
    return ascend(card())


@lru_cache(maxsize=4)
def controlled_launch(realisation=3):
    steered = card(realisation=realisation).control
    return fly_launch(ascent(), steered_launch(ascent(), steered), steered)


@lru_cache(maxsize=1)
def looped():
    """The loop's own records of the same launch."""
    steered = card(realisation=3).control
    return fly_missions(steered_launch(ascent(), steered), steered.feedback, 1, 0, record_interval=1, first_run=3)


@pytest.mark.parametrize("span", [(30.0, 60.0), (100.0, 140.0), (200.0, 260.0), (420.0, 500.0)])
def test_rate_is_the_derivative_of_attitude_and_force_that_of_speed_less_gravity(span):
    step = 1e-4
    t = np.linspace(*span, 400)
    before, at, after = (motion(controlled_launch(), t + shift) for shift in (-step, 0.0, step))
    turn = np.einsum("kji,kjl->kil", matrices(before.q_b_i), matrices(after.q_b_i))
    rate = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]).T
    np.testing.assert_allclose(0.5 * rate / (2.0 * step), at.w_ib_b, atol=2e-6)
    np.testing.assert_allclose((after.r_i - before.r_i) / (2.0 * step), at.v_i, atol=1e-4)
    force = (after.v_i - before.v_i) / (2.0 * step) - gravity_along(at.r_i)
    np.testing.assert_allclose(np.einsum("kji,kj->ki", matrices(at.q_b_i), force), at.f_b, atol=2e-3)


def test_the_increments_of_an_ideal_unit_add_up_to_the_turn_and_the_speed():
    ref = reference(controlled_launch(), 200.0)
    inside = (ref.t[:-1] > 100.0) & (ref.t[1:] < 110.0)
    turn = np.zeros((3, 3)) + np.eye(3)
    push = np.zeros(3)
    for k in np.flatnonzero(inside):
        angle = np.linalg.norm(ref.dtheta[k])
        x, y, z = ref.dtheta[k] / angle
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        push += turn @ ref.dvel[k]
        turn = turn @ (np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)
    first, last = np.flatnonzero(inside)[[0, -1]]
    start, end = motion(controlled_launch(), ref.t[[first]]), motion(controlled_launch(), ref.t[[last + 1]])
    found = matrices(start.q_b_i)[0].T @ matrices(end.q_b_i)[0]
    np.testing.assert_allclose(turn, found, atol=1e-8)
    pulled = gravity_along(motion(controlled_launch(), ref.t[first : last + 2]).r_i)
    speed = (end.v_i - start.v_i)[0] - np.trapezoid(pulled, ref.t[first : last + 2], axis=0)
    np.testing.assert_allclose(matrices(start.q_b_i)[0] @ push, speed, atol=5e-3)  # the force turns within a tick


def _per_load(launch, t):
    """Return by how much a rod of each stage's length answers to an angle, per specific force of its thrust."""
    events = ascent().trajectory.events
    stage = np.searchsorted([events["stage1_separation"], events["stage2_separation"]], t, side="right")
    per_stage = [
        6.0 * gains.attitude / stack.length
        for gains, stack in zip(launch.controller.gains, launch.rotation.stacks, strict=True)
    ]
    return np.array(per_stage)[stage]


def test_without_wind_and_errors_the_launch_is_the_ascent():
    body = settings("rotation/three_motor")
    body["nozzle"]["misalignment"] = "0 deg"
    body["stacks"] = [stack | {"normal_force": 0.0} for stack in body["stacks"]]
    controller = settings("controllers/three_motor") | {"guidance": None}
    feedback = {"rate": "true", "attitude": "true", "noise": "none"}
    steered = card(wind=None, rotation=body, controller=controller, feedback=feedback)
    calm, launch = build(steered), steered_launch(ascent(), steered.control)
    t = launch.course.t[::20]
    found, nominal = motion(calm, t), motion(ascent().trajectory, t)
    turned = np.einsum("kji,kjl->kil", matrices(nominal.q_b_i), matrices(found.q_b_i))
    away = np.abs(np.stack([turned[:, 0, 2], turned[:, 0, 1]], axis=1))
    # Of a loop that holds an attitude the lag is that of a spring: angular acceleration over its stiffness.
    nominal_path = motion(ascent().trajectory, launch.course.t)
    stiffness = np.linalg.norm(nominal_path.f_b, axis=1) * _per_load(launch, launch.course.t)
    turning = np.abs(np.gradient(launch.course.rate, launch.course.t, axis=0))
    for start, end in ((0.5, 84.0), (110.0, 164.0), (440.0, 500.0)):
        inside = (launch.course.t > start) & (launch.course.t < end)
        lag = (turning[inside] / stiffness[inside, np.newaxis]).max()
        assert away[(t > start) & (t < end)].max() < 2.0 * lag + 2e-4, (start, lag)
    first = t < 85.0  # between two motors nothing turns the vehicle as the ascent slews
    assert np.linalg.norm(found.v_i - nominal.v_i, axis=1)[first].max() < 0.5
    assert np.linalg.norm(motion(controlled_launch(), t).v_i - nominal.v_i, axis=1)[first].max() > 10.0


def test_the_motion_between_the_ticks_is_that_of_the_loop():
    rows, t = looped().history[0], looped().t
    ref = reference(controlled_launch(), 200.0)
    at = np.searchsorted(ref.t, t[0] - 1e-9)
    every = 4  # ticks: thrusters switch from tick to tick, a spline does so a little later
    turning = (ref.w_ib_b[at + every :, 1:] - ref.w_ib_b[at:-every, 1:]) * 200.0 / every
    for start, end in ((30.0, 80.0), (105.0, 160.0), (200.0, 400.0), (430.0, 500.0)):
        inside = (t > start) & (t < end)
        loops = np.apply_along_axis(
            np.convolve, 0, rows[inside][:, :, autopilot.TURNING], np.ones(every) / every, "valid"
        )
        np.testing.assert_allclose(turning[: t.size][inside[: len(turning)]].std(axis=0), loops.std(axis=0), rtol=0.05)
        lateral = np.stack([-ref.f_b[at:][: t.size][inside, 2], ref.f_b[at:][: t.size][inside, 1]], axis=1)
        apart = lateral - rows[inside][:, :, autopilot.FORCE]
        assert np.all(apart.std(axis=0) < 0.005)  # a spline bends where nozzle and gusts jump from tick to tick
        assert np.abs(apart).max() < 0.03
        assert np.abs(apart.mean(axis=0)).max() < 1e-4


def test_phases_meet_and_the_orbit_is_that_of_the_launch():
    one, other = controlled_launch(), controlled_launch(4)
    for before, after in zip(one.phases, one.phases[1:], strict=False):
        assert before.end == after.start
        np.testing.assert_allclose(before.position(before.end), after.position(before.end), atol=1e-6)
        np.testing.assert_allclose(before.position(before.end, 1), after.position(before.end, 1), atol=1e-6)
        np.testing.assert_allclose(np.abs(np.sum(before.attitude(before.end) * after.attitude(before.end))), 1.0)
    assert one.events == ascent().trajectory.events
    assert one.facts["perigee_m"] != other.facts["perigee_m"] != ascent().trajectory.facts["perigee_m"]


def test_a_filter_of_the_vehicle_assumes_the_envelope_that_the_autopilot():
    rows, ref = looped().history[0], reference(controlled_launch(), 200.0)
    found = np.sqrt(walks(EnvelopeCard(), controlled_launch(), ref)) * 200.0
    at = int(np.searchsorted(ref.t, -1e-9))
    n = min(len(rows), len(found) - at)
    turning, jerk = rows[:n, :, autopilot.TURNING_BOUND], rows[:n, :, autopilot.JERK_BOUND]
    np.testing.assert_allclose(found[at + 1 : at + n, 1:3], turning[1:], rtol=1e-6)
    cutoffs = [t for name, t in controlled_launch().events.items() if name.endswith("cutoff")]
    past = ref.t[at + 1 : at + n, np.newaxis] - cutoffs  # a nozzle that is let go is a step here, in the loop none
    apart = ~((past > -0.01) & (past < 0.7)).any(axis=1)
    np.testing.assert_allclose(found[at + 1 : at + n, 4:][apart], jerk[1:, ::-1][apart], rtol=1e-6)
    assert jerk.mean() > 10.05  # equations 9 and 10: the nozzle moves


def test_the_identity_of_a_launch_is_its_own():
    assert len({identity(card(realisation=number)) for number in range(3)}) == 3


def test_an_envelope_of_a_rate_that_is_not_filtered_is_refused():
    with pytest.raises(ValueError, match="envelope has no effect: the controller takes the"):
        card(envelope={"burn": "0.01 rad/s^2"})
    body = settings("rotation/three_motor")
    short = body | {"stacks": body["stacks"][:2]}
    with pytest.raises(ValueError, match=r"rotation\.stacks: 2 of them, the vehicle has 3 stages"):
        card(rotation=short)


def test_an_ascent_is_steered_once():
    steering = {"rotation": "rotation/three_motor", "controller": "controllers/three_motor", "wind": "wind/moderate"}
    flight = {"card": "trajectories/churchill_sso", "control": {**steering, "imu": "imu/kvh1750_003_published"}}
    with pytest.raises(InputError, match=r"flies under trajectory\.control already; state one of them"):
        loaded(
            f"base.trajectory={json.dumps(flight)}", f"base.control={json.dumps(steering)}",
            "base.sensors={attitude_reference: attitude_references/magnetometer_003}",
        )  # fmt: skip
