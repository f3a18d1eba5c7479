"""States behind the filter's error in the joint vector: dense matrices, forwards and backwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import build_components
from lvnav_trade.covariance.receiver_error import (
    N_SOLUTION_ENTRY,
    advance_solution,
    clone_adjoint,
    clone_error,
    clone_states,
    complete_rows,
    solution_adjoint,
)
from lvnav_trade.covariance.slots import arrange_lanes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import GROUP, grouped_zeros
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.simulation.epoch.joint import N_CLONE, N_NAV
from lvnav_trade.simulation.preparation.signals.solution import SolutionErrorModel
from tests.building import LOOSE, loaded, prepare_hop, with_fields
from tests.covariance.small import of_lanes
from tests.filter.policies.test_delay import delays as a_late

N_FILTER, M, N_ALL = 4, 3, 9  # four states of the filter, three of a solution's error, two that are cloned


class Joint(NamedTuple):
    """What is advanced of the joint state."""

    sources: np.ndarray
    cross: np.ndarray
    variance: np.ndarray
    mean: np.ndarray


class Scratch(NamedTuple):
    """Work arrays."""

    y: np.ndarray
    receiver: np.ndarray


class Truth(NamedTuple):
    """What is asked of the error components."""

    group: np.ndarray
    lane: np.ndarray
    n_slot: np.ndarray
    has_cross: np.ndarray
    solution: int
    solution_source: np.ndarray
    source: np.ndarray
    slot: np.ndarray
    first_correlated: int = 0
    clone: int = 0


class Back(NamedTuple):
    """What goes back."""

    e: np.ndarray
    c: np.ndarray
    contribution: np.ndarray


def joint_of(sources, cross, variance, mean):
    """The joint state and components of sources (n_source, N, N) with slots of their own each."""
    place = np.arange(len(sources))
    group, lane = place // GROUP, place % GROUP
    n_group, n_slot = int(group.max()) + 1, cross.shape[1]
    joint = Joint(
        arrange_lanes(sources, group, lane),
        arrange_lanes(cross, group, lane),
        arrange_lanes(variance, group, lane),
        mean.copy(),
    )
    true = Truth(
        group, lane, np.full(n_group, n_slot), np.ones((n_group, n_slot), dtype=bool), N_FILTER, np.array([0, 1]),
        np.array([1, 1]), np.array([0, 1]),
    )  # fmt: skip
    return joint, true, Scratch(grouped_zeros((N_ALL,)), np.zeros(M))


def setting():
    """Two sources and two shared components of the second one, with a full covariance of everything with everything."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((N_ALL + 2, 20))
    full = root @ root.T
    chain = SolutionErrorModel(
        rng.standard_normal((1, M, M)), rng.standard_normal((1, M, 2)), np.array([[0.5, 2.0]]), np.array([0, 1]),
        rng.standard_normal((1, M, 2)), rng.standard_normal((1, M)), np.arange(6), np.zeros((1, 6, 6)),
        np.ones(1, dtype=bool), np.zeros((1, 6)),
    )  # fmt: skip
    full[N_ALL, N_ALL + 1] = full[N_ALL + 1, N_ALL] = 0.0  # components are independent of each other
    cross, variance = np.zeros((2, 2, N_ALL)), np.zeros((2, 2, 1))
    cross[1], variance[1, :, 0] = full[N_ALL:, :N_ALL], np.diag(full)[N_ALL:]
    sources = np.stack([np.eye(N_ALL), full[:N_ALL, :N_ALL]])
    return chain, *joint_of(sources, cross, variance, rng.standard_normal(N_ALL)), full


def dense(chain):
    """The same step in one matrix of the joint vector and the two components."""
    step = np.eye(N_ALL + 2)
    s = slice(N_FILTER, N_FILTER + M)
    step[s, s], step[s, N_ALL:] = chain.transition[0], chain.correlated_input[0]
    return step, chain.noise_input[0]


def test_a_solutions_error_advances_as_in_dense_matrices():
    chain, joint, true, scratch, full = setting()
    step, white = dense(chain)
    mean = step[:N_ALL, :N_ALL] @ joint.mean
    mean[N_FILTER : N_FILTER + M] += chain.deterministic_error[0]
    advance_solution(joint, scratch, chain, true, 0)
    expected = step @ full @ step.T
    s = slice(N_FILTER, N_FILTER + M)
    expected[s, s] += 2.0 * np.outer(white[:, 1], white[:, 1])
    np.testing.assert_allclose(of_lanes(joint.sources, 1), expected[:N_ALL, :N_ALL], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(of_lanes(joint.cross, 1), expected[N_ALL:, :N_ALL], rtol=1e-12, atol=1e-12)
    other = step[:N_ALL, :N_ALL] @ step[:N_ALL, :N_ALL].T
    other[s, s] += 0.5 * np.outer(white[:, 0], white[:, 0])
    np.testing.assert_allclose(of_lanes(joint.sources, 0), other, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(joint.mean, mean, rtol=1e-12)


def test_backwards_multipliers_see_what_goes_in_forwards():
    chain, _, true, _, _ = setting()
    step, white = dense(chain)
    rows = np.random.default_rng(5).standard_normal((2, N_ALL))
    back = Back(rows.copy(), np.zeros((2, 2)), np.zeros((2, 2, 1)))
    solution_adjoint(back, np.zeros(N_ALL), chain, true, 0, 0)
    before = np.hstack([rows, np.zeros((2, 2))]) @ step
    np.testing.assert_allclose(back.e, before[:, :N_ALL], rtol=1e-12)
    np.testing.assert_allclose(back.c, before[:, N_ALL:], rtol=1e-12)
    through = rows[:, N_FILTER : N_FILTER + M] @ white
    np.testing.assert_allclose(back.contribution[:, :, 0], through**2 * chain.variance[0], rtol=1e-12)


def test_a_clone_is_a_copy_with_all_its_correlations():
    _, joint, true, _, full = setting()
    mean = joint.mean.copy()
    clone_states(joint, true, 7, 1, 2)
    copy = np.eye(N_ALL + 2)
    copy[7:9] = 0.0
    copy[7, 1] = copy[8, 2] = 1.0
    expected = copy @ full @ copy.T
    np.testing.assert_allclose(of_lanes(joint.sources, 1), expected[:N_ALL, :N_ALL])
    np.testing.assert_allclose(of_lanes(joint.cross, 1), expected[N_ALL:, :N_ALL])
    np.testing.assert_allclose(joint.mean, copy[:N_ALL, :N_ALL] @ mean)


@jit
def cloned(joint, true, delays, window):
    clone_error(joint, true, delays, window)


@jit
def cloned_back(back, true, delays, window):
    clone_adjoint(back, true, delays, window)


def test_epochs_on_their_way_have_clones_of_their_own_and_go_back_to_the_states_of_their_time():
    """Two epochs at once: the error is cloned at the windows that `delays` names, in the ring place of each epoch."""
    rng, n = np.random.default_rng(6), N_NAV + 2 * N_CLONE
    root = rng.standard_normal((n, n))
    start = root @ root.T
    joint, true, _ = joint_of(start[None], np.zeros((1, 1, n)), np.zeros((1, 1, 1)), rng.standard_normal(n))
    true = true._replace(clone=N_NAV)
    valid, early = np.array([[4, 5], [5, 6]]), np.array([[5, 5], [4, 4]])
    delays = a_late(
        is_extrapolated=False, n_ring=np.array([2]), state_epochs=valid[None],
        velocity_epochs=early[None], delay=np.zeros(6), offset=np.zeros((1, 6)), base=np.ones(6),
    )  # fmt: skip
    copies = []
    for window in range(2):
        copy, at = np.eye(n), N_NAV + N_CLONE * (valid[window, 0] % 2)
        copy[at : at + N_NAV] = 0.0
        copy[at : at + N_NAV, :N_NAV] = np.eye(N_NAV)
        copies.append(copy)
        cloned(joint, true, delays, window)
    whole = copies[1] @ copies[0]
    np.testing.assert_allclose(of_lanes(joint.sources, 0), whole @ start @ whole.T)
    rows = rng.standard_normal((2, n))
    back = Back(rows.copy(), np.zeros((2, 1)), np.zeros((2, 1, 1)))
    for window in (1, 0):
        cloned_back(back, true, delays, window)
    np.testing.assert_allclose(back.e, rows @ whole)


def tables(kind, **settings):
    scenario = loaded(LOOSE)
    card = with_fields(scenario.filter, delay_compensation={"kind": kind, **settings})
    prepared_case = prepare_hop(scenario.model_copy(update={"filter": card}))
    return prepared_case, build_components(prepared_case)


def test_only_navigation_errors_of_a_buffered_measurement_are_those_of_its_time():
    prepared_case, true = tables("buffered")
    model = prepared_case.model
    assert prepared_case.options.delay_processing.is_buffered.all()
    assert true.clone == prepared_case.layout.n_state
    for channel in range(6):
        n = model.n_entry[channel]
        own, found = model.column[channel, :n], true.column[0, channel, :n]
        np.testing.assert_array_equal(found, np.where(own < N_NAV, true.clone + own, own))
        assert {ATT, VEL, POS} & set(own.tolist())
    extrapolated, other = tables("extrapolated")
    assert not extrapolated.options.delay_processing.is_buffered.any()
    assert other.column[0, 0].min() < N_NAV


def test_a_late_solutions_rows_take_its_own_error_off_and_the_velocities_that_it_is_extrapolated_with():
    H = np.zeros((6, 10 + N_SOLUTION_ENTRY))
    complete_rows(H, a_late(), 0)
    np.testing.assert_array_equal(H[:, 10:16], -np.eye(6))
    expected = np.zeros((6, 6))
    expected[:3, :3] = -0.3 * np.eye(3)  # position moves on with the velocity of its time
    expected[3:, :3], expected[3:, 3:] = (
        -3.0 * np.eye(3),
        3.0 * np.eye(3),
    )  # velocity by the difference to the one before
    np.testing.assert_allclose(H[:, 16:], expected)
