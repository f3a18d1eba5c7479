"""A strapdown that is never corrected, and a filter of total states, against their definitions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import adjoint, covariance, source_covariances
from lvnav_trade.filter import ekf
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.epoch.process import update_receiver
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, MATCHED, loaded, prepare_hop, with_fields
from tests.filter.test_residuals import dense_rows, observed

RUNS, SEED = 24, 7
LARGE = {"position": "3 km", "velocity": "1 m/s"}


@lru_cache(maxsize=8)
def prepare_case(*settings, initial=(), **fields):
    scenario = loaded(MATCHED, *settings)
    card, start = with_fields(scenario.filter, **fields), with_fields(scenario.initial, **dict(initial))
    return prepare_hop(scenario.model_copy(update={"filter": card, "initial": start}))


@lru_cache(maxsize=8)
def simulated(*settings, initial=(), **fields):
    return run_block(prepare_case(*settings, initial=initial, **fields), SEED, 0, RUNS)


# -------------------------------------------------------------------------------------------------------------- backup


def test_a_strapdown_that_is_never_corrected_is_a_pure_inertial_system_on_the_same_draws():
    prepared_case = prepare_case(backup=True)
    at = [k for k, output in enumerate(prepared_case.outputs) if output.quantity.startswith("backup_")]
    assert [prepared_case.outputs[k].quantity for k in at[::3]] == [
        "backup_attitude",
        "backup_velocity",
        "backup_position",
    ]
    both, alone = simulated(backup=True), simulated(INERTIAL)
    scale = alone.sigma[:, :, :9]
    assert np.abs((both.err[:, :, at] - alone.err[:, :, :9]) / scale).max() < 1e-9
    # by the transition at the corrected state, so not to the last digit
    np.testing.assert_allclose(both.sigma[:, :, at], scale, rtol=5e-3)
    corrected, drifting = (np.sqrt(np.mean(err[:, -1, 6:9] ** 2, axis=0)) for err in (both.err, alone.err))
    assert np.all(drifting > 5.0 * corrected)


def test_the_closed_loop_beside_it_flies_as_without():
    both, one = simulated(backup=True), simulated()
    n = one.err.shape[2]
    np.testing.assert_allclose(both.err[:, :, :n], one.err, rtol=0, atol=1e-9)


def test_linear_covariance_gives_it_by_source_as_of_a_pure_inertial_system():
    both, alone = covariance(prepare_case(backup=True)), covariance(prepare_case(INERTIAL))
    n = both.formal_sigma.shape[1] - 9
    np.testing.assert_allclose(both.formal_sigma[:, n:], alone.formal_sigma[:, :9], rtol=1e-12)
    np.testing.assert_allclose(both.true_sigma[:, n:], alone.true_sigma[:, :9], rtol=1e-12)
    np.testing.assert_allclose(both.budget.sum(axis=1), both.true_sigma**2, rtol=1e-10)
    for k, name in enumerate(alone.sources):
        own = both.budget[:, both.sources.index(name), n:]
        np.testing.assert_allclose(
            own, alone.budget[:, k, :9], rtol=1e-9, atol=1e-12 * alone.true_sigma[-1, :9].max() ** 2
        )


def test_its_adjoint_and_its_covariances_by_source_are_those_of_linear_covariance():
    prepared_case, last = prepare_case(backup=True), 30.0
    history, back = covariance(prepared_case), adjoint(prepared_case, last)
    n = history.formal_sigma.shape[1] - 9
    assert [output.quantity for output in back.outputs[9::3]] == [o.quantity for o in prepared_case.outputs[n::3]]
    found, expected = back.contribution.sum(axis=2).T, history.budget[-1]
    for columns, part in ((slice(0, 9), slice(0, 9)), (slice(n, None), slice(9, None))):
        np.testing.assert_allclose(
            found[:, part], expected[:, columns], rtol=1e-6, atol=1e-9 * expected[:, columns].max()
        )
    alone = covariance(prepare_case(INERTIAL))
    by_source = source_covariances(prepared_case, last)
    assert by_source.shape[1:] == (6, 3, 3)
    total = np.diagonal(by_source.sum(axis=0), axis1=1, axis2=2).ravel()
    np.testing.assert_allclose(total[9:], alone.true_sigma[-1, :9] ** 2, rtol=1e-6)


# ------------------------------------------------------------------------------------------------------------- direct


def test_a_direct_filter_linearises_every_scalar_where_the_one_before_has_left_the_state():
    """One epoch from 3 km away, against a loop in numpy that fills its rows anew after every scalar."""
    prepared_case, epoch = prepare_case(feedback="direct", initial=tuple(LARGE.items())), 5
    model, signals, dt = prepared_case.model, prepared_case.signals, prepared_case.unit.dt
    n_row = 2 * signals.n_used[epoch]

    def start():
        work = observed(prepared_case, epoch, np.zeros(n_row))
        off = np.zeros(model.n_state)
        off[6:9] = [3000.0, -2000.0, 1000.0]
        correct_motion(work.nav, off)
        ekf.place_antenna(work, None, None, model, dt, epoch)
        ekf.fill_receiver(work, None, None, model, signals, epoch)
        ekf.clear_epoch(work, epoch)
        return work

    direct, closed, by_hand = start(), start(), start()
    case = case_of(prepared_case)
    update_receiver(direct, OptionalState(), case, None, True, epoch, np.inf, None)
    update_receiver(closed, OptionalState(), case, None, None, epoch, np.inf, None)
    ekf.correct(closed, None, None, model)
    P = np.array(by_hand.P)
    for row in range(n_row):
        ekf.place_antenna(by_hand, None, None, model, dt, epoch)
        ekf.fill_receiver(by_hand, None, None, model, signals, epoch)
        H, z, R = dense_rows(prepared_case, by_hand, epoch)
        gain = P @ H[row] / (H[row] @ P @ H[row] + R[row])
        P = P - np.outer(gain, H[row] @ P)
        by_hand.x[:] = gain * z[row]
        ekf.correct(by_hand, None, None, model)
    np.testing.assert_allclose(direct.nav, by_hand.nav, rtol=1e-12)
    np.testing.assert_allclose(direct.clock_hat, by_hand.clock_hat, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(direct.x, 0.0)
    assert np.abs(direct.nav - closed.nav).max() > 0.01  # the second order of a range, 3 km across the line of sight


def test_direct_and_closed_loop_are_the_same_but_for_second_order():
    """Same draws: RMS within 1 % as the filter is used, and apart when it starts 3 km off."""
    one, other = simulated(feedback="direct"), simulated()
    rms = [np.sqrt(np.mean(block.err[:, 5:, :9] ** 2, axis=(0, 1))) for block in (one, other)]
    np.testing.assert_allclose(rms[0], rms[1], rtol=0.01)
    assert np.abs(one.err - other.err).max() > 0.0
    np.testing.assert_array_equal(
        covariance(prepare_case(feedback="direct")).formal_sigma, covariance(prepare_case()).formal_sigma
    )
    far, near = (simulated(feedback=name, initial=tuple(LARGE.items())) for name in ("direct", "closed"))
    apart = np.abs(far.err[:, 1, 6:9] - near.err[:, 1, 6:9]).max()
    assert apart > 100.0 * np.abs(one.err[:, 1, 6:9] - other.err[:, 1, 6:9]).max()


@pytest.mark.parametrize("feedback", ["closed", "direct"])
def test_outputs_are_delayed_in_an_open_loop_only(feedback):
    with pytest.raises(ValueError, match="correct_after"):
        with_fields(loaded().filter, feedback=feedback, logic={"correct_after": "2 s"})
