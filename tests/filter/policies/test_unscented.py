"""The unscented filter against a dense one in numpy, closed forms of large rotations, and the extended filter."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lvnav_trade.filter.ekf import place_antenna
from lvnav_trade.filter.policies.linearise import fill_receiver_rows, propagate_estimate
from lvnav_trade.filter.policies.unscented import factorise, rotation_between, store_window_start
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.run_arrays import new_work
from tests.building import LOOSE, loaded, prepare_hop, with_fields

RUNS, SEED = 24, 7
SCALE = "base.filter.extra_states=[gyro_scale_factor, accel_scale_factor, range_bias]"
ARM = 'base.receiver.lever_b=["0 m", "4 m", "3 m"]'
WIDE = math.radians(20.0)
MEAN = (
    1.0 + 2.0 * (1.0 - WIDE**2) * math.exp(-0.5 * WIDE**2)
) / 3.0  # E[C] of a rotation vector of that sigma per axis
SLOPE = (1.0 - WIDE**2 / 3.0) * math.exp(-0.5 * WIDE**2)  # Cov(C l, rotation vector) over that of a small one


@lru_cache(maxsize=8)
def prepare_case(*settings, initial=(), **fields):
    scenario = loaded(*settings)
    card = with_fields(scenario.filter, **({"algorithm": "unscented"} | fields))
    start = with_fields(scenario.initial, **dict(initial))
    return prepare_hop(scenario.model_copy(update={"filter": card, "initial": start}))


def random_covariance(n, sigma):
    root = np.random.default_rng(3).standard_normal((n, n)) / math.sqrt(n)
    P = root @ root.T + 0.2 * np.eye(n)
    return P * np.outer(sigma, sigma) / np.sqrt(np.outer(np.diag(P), np.diag(P)))


def windowed(prepared_case, P):
    """Return the arrays at the start of the first window that has ticks, with its increments, and its number."""
    work, optional_state = new_work(prepared_case, False)
    w = int(np.flatnonzero(prepared_case.schedule.n_tick > 0)[0])
    first, n_tick = prepared_case.schedule.first_tick[w], prepared_case.schedule.n_tick[w]
    work.nav[:], work.P[:] = prepared_case.initial_state.nav, P
    work.increments[:n_tick, :3] = prepared_case.unit.dtheta[first : first + n_tick]
    work.increments[:n_tick, 3:] = prepared_case.unit.dvel[first : first + n_tick]
    return work, optional_state.sigma_points, w


def propagated(prepared_case, P):
    """Return the arrays after the window: a filter's, as `flight_loop.fly` calls it."""
    work, sigma_points, w = windowed(prepared_case, P)
    first, n_tick, unit, model = (
        prepared_case.schedule.first_tick[w], prepared_case.schedule.n_tick[w], prepared_case.unit, prepared_case.model
    )  # fmt: skip
    store_window_start(sigma_points, work, n_tick)
    processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], model.biases_only, unit.dt)
    mechanise(work.nav, work.sums, work.previous, work.increments, n_tick, unit.dt, model.strapdown, unit.dt * first)
    before = np.array(work.nav)
    propagate_estimate(work, case_of(prepared_case), sigma_points, None, w)
    return work, before


def moved(nav, x):
    """Return a navigation state with an error added, by rotations of scipy; quaternions have the scalar first."""
    turned = Rotation.from_rotvec(x[:3]) * Rotation.from_quat(nav[:4], scalar_first=True)
    return np.concatenate([turned.as_quat(scalar_first=True), nav[4:7] + x[3:6], nav[7:10] + x[6:9]])


def apart(one, other):
    """Return the error (9,) by which a navigation state exceeds another."""
    turn = Rotation.from_quat(one[:4], scalar_first=True) * Rotation.from_quat(other[:4], scalar_first=True).inv()
    return np.concatenate([turn.as_rotvec(), one[4:7] - other[4:7], one[7:10] - other[7:10]])


def dense(prepared_case, P):
    """Return covariance and mean error after the window by points over all states at once."""
    model, unit, layout = prepared_case.model, prepared_case.unit, prepared_case.layout
    moving = [*range(9), *(b.offset + i for b in layout.parameters for i in range(3))]
    order = [*moving, *(i for i in range(layout.n_state) if i not in moving)]
    length_index = prepared_case.schedule.length_index[windowed(prepared_case, P)[2]]
    half = np.diag(0.5 * model.noise[length_index])
    root = np.zeros_like(P)
    root[np.ix_(order, order)] = np.linalg.cholesky((P + half)[np.ix_(order, order)])

    def flight(x):
        work, _, w = windowed(prepared_case, P)
        first, n_tick = prepared_case.schedule.first_tick[w], prepared_case.schedule.n_tick[w]
        work.nav[:] = moved(work.nav, x)
        for b, block in enumerate(layout.parameters):
            work.par[b] = x[block.offset : block.offset + 3]
        processes.gather(work.tables, work.par, model.par_sensor, model.par_driver)
        processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], model.biases_only, unit.dt)
        how = model.strapdown
        mechanise(work.nav, work.sums, work.previous, work.increments, n_tick, unit.dt, how, unit.dt * first)
        return np.array(work.nav)

    def after(x):
        rest = model.decay[length_index] * x
        if model.clock >= 0:
            rest[model.clock] += model.seconds[length_index] * x[model.clock + 1]
        rest[:9] = apart(flight(x), centre)
        return rest

    centre = flight(np.zeros(layout.n_state))
    reach = math.sqrt(3.0)
    found = np.array([after(sign * reach * column) for column in root.T for sign in (1.0, -1.0)])
    return found.T @ found / 6.0 + half, found.sum(axis=0) / 6.0


def spread(prepared_case, **blocks):
    """Return one-sigmas of the states: of those named as given, of the others as the filter starts."""
    sigma = np.sqrt(np.diag(prepared_case.initial_state.P))
    sigma[sigma == 0.0] = 1e-3
    for name, value in blocks.items():
        sigma[{"attitude": slice(0, 3), "velocity": slice(3, 6), "position": slice(6, 9)}[name]] = value
    return sigma


# ------------------------------------------------------------------------------------------------------------ algebra


def test_the_factor_has_every_state_and_one_that_others_fix_has_none():
    prepared_case = prepare_case(SCALE)
    n = prepared_case.layout.n_state
    P = random_covariance(n, spread(prepared_case))
    P[8], P[:, 8] = 2.0 * P[3], 2.0 * P[:, 3]  # a position that is known by a velocity
    P[8, 8] = 4.0 * P[3, 3]
    root = np.zeros((n, 9 + 3 * len(prepared_case.layout.parameters)))
    factorise(root, P, prepared_case.model, root.shape[1])
    moving = [*range(9), *(b.offset + i for b in prepared_case.layout.parameters for i in range(3))]
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose(
        (root @ root[moving].T / scale[:, None]) / scale[moving],
        P[:, moving] / scale[:, None] / scale[moving],
        atol=1e-12,
    )
    np.testing.assert_array_equal(root[:, 8], 0.0)


@pytest.mark.parametrize("degrees", [0.001, 10.0, 60.0])
def test_a_rotation_between_attitudes_is_that_of_scipy(degrees):
    rng = np.random.default_rng(1)
    one, turn = (
        Rotation.random(random_state=2),
        Rotation.from_rotvec(np.radians(degrees) * rng.standard_normal(3) / 3.0),
    )
    p, q = (turn * one).as_quat(scalar_first=True), one.as_quat(scalar_first=True)
    np.testing.assert_allclose(rotation_between(-p, q), turn.as_rotvec(), rtol=0, atol=2e-6)


def test_a_window_is_that_of_a_dense_filter_with_points_over_all_states():
    prepared_case = prepare_case(SCALE)
    P = random_covariance(prepared_case.layout.n_state, spread(prepared_case, attitude=WIDE, position=300.0))
    work, before = propagated(prepared_case, P)
    wanted, mean = dense(prepared_case, P)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(work.P / np.outer(scale, scale), wanted / np.outer(scale, scale), rtol=0, atol=1e-6)
    np.testing.assert_allclose(apart(work.nav, before) / scale[:9], mean[:9] / scale[:9], rtol=0, atol=1e-6)
    assert np.abs(mean[3:6]).max() > 1e-3


# ------------------------------------------------------------------------------------- closed forms of large rotations


def test_with_an_attitude_that_is_hardly_known_the_mean_of_the_velocity_gained_is_the_closed_forms():
    """Of a rotation vector of equal sigma on each axis E[C] is a multiple of the identity."""
    prepared_case = prepare_case(LOOSE)
    P = np.diag(spread(prepared_case, attitude=WIDE) ** 2)
    work, before = propagated(prepared_case, P)
    gained = np.array(work.sums[9:12])
    found = apart(work.nav, before)[3:6]
    np.testing.assert_allclose(found, (MEAN - 1.0) * gained, rtol=0, atol=0.03 * (1.0 - MEAN) * np.linalg.norm(gained))
    across = math.sqrt(np.trace(work.P[3:6, 3:6] - P[3:6, 3:6]))
    tangent = math.sqrt(2.0) * WIDE * np.linalg.norm(gained)
    drawn = Rotation.from_rotvec(WIDE * np.random.default_rng(5).standard_normal((200_000, 3))).apply(gained) - gained
    wanted = math.sqrt(np.mean(np.sum(drawn**2, axis=1)))
    assert abs(across / wanted - 1.0) < 0.02 < abs(tangent / wanted - 1.0)


def test_a_lever_arm_that_hardly_has_a_direction_shortens_by_the_closed_form():
    prepared_case, epoch = prepare_case(LOOSE, ARM), 3
    model, dt = prepared_case.model, prepared_case.unit.dt
    P = np.diag(spread(prepared_case, attitude=WIDE) ** 2)
    work, sigma_points, _ = windowed(prepared_case, P)
    place_antenna(work, None, None, model, dt, epoch)
    arm = np.array(work.antenna[0, 6:9])
    work.solution[:] = np.concatenate([work.antenna[0, :3], work.antenna[0, 3:6]])
    nav = np.array(work.nav)
    fill_receiver_rows(work, OptionalState(), case_of(prepared_case), sigma_points, None, epoch)
    np.testing.assert_array_equal(work.nav, nav)
    np.testing.assert_allclose(work.z[:3], (1.0 - MEAN) * arm, rtol=0, atol=0.03 * (1.0 - MEAN) * 5.0)
    reach = math.sqrt(3.0) * WIDE
    x, y, z = arm
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # of a rotation vector with the arm
    np.testing.assert_allclose(work.H[:3, 3:6], math.sin(reach) / reach * cross, rtol=0, atol=1e-6)
    assert abs(math.sin(reach) / reach - SLOPE) < 0.5 * (1.0 - SLOPE)  # nearer to the regression than the tangent
    # along each axis the arm shortens by 1 - cos: sum over the axes of a third of its square
    shortened = (1.0 - math.cos(reach)) * np.array([[0.0, x, x], [y, 0.0, y], [z, z, 0.0]])
    np.testing.assert_allclose(
        sigma_points.residual_variance[:3], np.sum(shortened**2, axis=1) / 3.0, rtol=1e-5, atol=1e-9
    )


# ------------------------------------------------------------------------------------------------------------ flights


def test_for_small_errors_it_is_the_extended_filter():
    one, other = (run_block(prepare_case(algorithm=name), SEED, 0, RUNS) for name in ("unscented", "extended"))
    np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-4)
    assert 0.0 < np.abs((one.err - other.err) / other.sigma).max() < 0.02


@pytest.mark.slow  # the kernel of one run by itself
def test_a_run_is_the_same_alone_and_among_eight():
    prepared_case = prepare_case()
    one, eight = run_block(prepared_case, SEED, 0, 2, uses_lanes=False), run_block(prepared_case, SEED, 0, 2)
    np.testing.assert_allclose(one.err / eight.sigma, eight.err / eight.sigma, rtol=0, atol=1e-6)


def test_an_open_loop_by_points_is_the_closed_one_where_that_by_jacobians_no_longer_is():
    start = (("heading", "8 deg"), ("tilt", "2 deg"))
    closed = run_block(prepare_case(initial=start), SEED, 0, RUNS)
    apart_by = {}
    for name in ("unscented", "extended"):
        opened = run_block(prepare_case(initial=start, feedback="open", algorithm=name), SEED, 0, RUNS)
        apart_by[name] = np.sqrt(np.mean(((opened.err - closed.err) / closed.sigma)[:, -1, :9] ** 2))
    assert apart_by["unscented"] < 0.2 * apart_by["extended"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"transition_order": 1}, "no transition, whose rate or order"),
        ({"transition_rate": "1 Hz"}, "no transition, whose rate or order"),
        ({"measurements": ["pseudorange", "imu"]}, "with imu among its measurements has none"),
    ],
)
def test_settings_that_an_unscented_filter_has_no_use_for_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        with_fields(loaded().filter, algorithm="unscented", **fields)
