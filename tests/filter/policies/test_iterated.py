"""The iterated update against the minimum of its cost, found by another program, and the extended filter."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from lvnav_trade.covariance.history import covariance
from lvnav_trade.filter import ekf
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.epoch.process import process_receiver
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.run_arrays import new_work
from tests.building import loaded, prepare_hop, with_fields

RUNS, SEED = 24, 7


@lru_cache(maxsize=8)
def prepare_case(initial=(), *settings, **fields):
    scenario = loaded("base.filter=filters/tight", *settings)
    card = with_fields(scenario.filter, **({"algorithm": "iterated", "gate": None} | fields))
    start = with_fields(scenario.initial, **dict(initial))
    return prepare_hop(scenario.model_copy(update={"filter": card, "initial": start}))


def predicted(prepared_case, off, sigma, epoch=0):
    """Return a prediction whose position is `off` (3,) m from the truth, of covariance `sigma`^2, with filled rows."""
    work, optional_state = new_work(prepared_case, False)
    signals, model, dt = prepared_case.signals, prepared_case.model, prepared_case.unit.dt
    ref, tick = (
        prepared_case.reference,
        int(np.searchsorted(prepared_case.reference.t, prepared_case.t_epoch[epoch] - 1e-6)),
    )
    work.nav[:] = np.concatenate([ref.q_b_i[tick], ref.v_i[tick], ref.r_i[tick] + off])
    work.previous[:3] = ref.dtheta[tick - 1]
    work.P[:] = np.diag(np.diag(prepared_case.initial_state.P) + 1e-8)
    work.P[range(6, 9), range(6, 9)] = sigma**2
    for slot in range(signals.n_used[epoch]):
        s = signals.satellite_by_slot[epoch, slot]
        work.ranges[slot] = signals.range[epoch, s], signals.rate[epoch, s]
    ekf.place_antenna(work, None, None, model, dt, epoch)
    ekf.fill_receiver(work, None, None, model, signals, epoch)
    ekf.clear_epoch(work, epoch)
    return work, optional_state


def updated(prepared_case, off, sigma, epoch=0):
    """Return the arrays of an iterated update, the covariance before it, and the error state of a single update."""
    case, (once, _), (work, optional_state) = (
        case_of(prepared_case),
        *(predicted(prepared_case, off, sigma, epoch) for _ in range(2)),
    )
    P, nav = work.P.copy(), work.nav.copy()
    process_receiver(once, OptionalState(), case, None, None, epoch, np.inf, None)
    process_receiver(work, optional_state, case, None, optional_state.iteration, epoch, np.inf, None)
    assert np.array_equal(work.nav, nav)
    return work, P, once.x.copy()


def minimum(prepared_case, work, P, epoch=0):
    """Return the error state (n,) of the least cost of prediction and measurements, by scipy, its own Jacobian."""
    signals, model, dt = prepared_case.signals, prepared_case.model, prepared_case.unit.dt
    n_row = ekf.receiver_row_count(model, signals, epoch)
    sigma = np.sqrt([signals.variance[epoch, ekf.receiver_channel(model, signals, epoch, row)] for row in range(n_row)])
    root = np.linalg.inv(np.linalg.cholesky(P))
    nav = work.nav.copy()

    def cost(scaled):
        x = scaled * scale
        work.nav[:], work.x[:] = nav, x
        ekf.correct_motion(work.nav, work.x)
        work.clock_hat[:] = x[model.clock : model.clock + 2]
        ekf.place_antenna(work, None, None, model, dt, epoch)
        ekf.fill_receiver(work, None, None, model, signals, epoch)
        left = work.z[:n_row] / sigma
        return np.concatenate([root @ x, left])

    scale = np.sqrt(np.diag(P))
    found = least_squares(cost, np.zeros(P.shape[0]), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    work.nav[:], work.clock_hat[:] = nav, 0.0
    return found.x * scale


def test_passes_lead_to_the_least_cost_where_one_update_does_not():
    """A start 300 km off: the lines of sight turn by a degree, and one update is a kilometre off."""
    prepared_case = prepare_case(iterations=8)
    off = np.array([200e3, -150e3, 150e3])
    work, P, first = updated(prepared_case, off, 300e3)
    found = work.x[6:9].copy()
    least = minimum(prepared_case, work, P)[6:9]
    assert np.linalg.norm(first[6:9] - least) > 1000.0
    assert np.linalg.norm(found - least) < 0.05
    assert np.linalg.norm(found + off) < 1.0


def test_counts_are_those_of_one_update():
    prepared_case = prepare_case(iterations=8)
    work, _, _ = updated(prepared_case, np.zeros(3), 10.0)
    assert work.n_row[0] == ekf.receiver_row_count(prepared_case.model, prepared_case.signals, 0)


def test_small_errors_leave_an_extended_filter():
    again, once = (run_block(prepare_case(algorithm=name), SEED, 0, RUNS) for name in ("iterated", "extended"))
    size = np.sqrt(np.mean(once.err**2, axis=(0, 1)))
    assert np.all(np.abs(again.err - once.err).max(axis=(0, 1))[:9] < 1e-3 * size[:9])
    assert again.n_row.tolist() == once.n_row.tolist()


def test_from_far_off_the_first_epoch_is_as_good_as_from_near():
    """From 30 km off one pass leaves what the lines of sight turn by: some 50 m, and the filter does not know."""

    def after_one(distance, name):
        block = run_block(prepare_case((("position", distance),), algorithm=name), SEED, 0, RUNS)
        return math.sqrt(np.mean(np.sum(block.err[:, 1, 6:9] ** 2, axis=1)))

    near = after_one("300 m", "iterated")
    assert after_one("30 km", "iterated") == pytest.approx(near, rel=0.01)
    assert after_one("30 km", "extended") > 5.0 * near


def test_linear_covariance_is_that_of_the_extended_filter():
    again, once = (covariance(prepare_case(algorithm=name)) for name in ("iterated", "extended"))
    assert np.array_equal(again.true_sigma, once.true_sigma)
    assert np.array_equal(again.formal_sigma, once.formal_sigma)


def test_a_filter_that_linearises_at_every_scalar_is_not_iterated():
    with pytest.raises(ValueError, match="direct"):
        prepare_case(feedback="direct")
