"""Late measurements: the state that they are met with, and what carrying them on adds to their covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.policies.delay import (
    EARLY,
    ERROR,
    KNOWN,
    LAST,
    N_PAST,
    NAV,
    DelayProcessing,
    channel_ring_index,
    correct_stored_errors,
    correct_stored_states,
    extrapolate_solution,
    prediction_change,
    repeat_extrapolation,
    ring_index,
    store_state,
)
from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import J4, Q, R, V
from lvnav_trade.kernels.transition import ATT, POS, VEL

R_I, V_I = np.array([4.05e6, -3.10e6, -4.12e6]), np.array([2900.0, 3300.0, 700.0])
DT = 0.005


def delays(**fields):
    """A window in which an epoch's velocity before is kept, one in which its state is, and one in which nothing is."""
    settings = {
        "is_extrapolated": True, "receiver_line": 0,
        "line": np.array([0]), "sensor_line": np.array([-1]), "n_ring": np.array([1]),
        "first": np.array([0]), "state_epochs": np.array([[[0, 0], [0, 1], [1, 1]]]),
        "velocity_epochs": np.array([[[0, 1], [1, 1], [1, 1]]]), "delay": np.array([0.3]), "offset": np.array([[0.0]]),
        "base": np.array([0.1]), "interval": 1.0, "delay_variance": 0.0, "acceleration_variance": 0.0,
    } | fields  # fmt: skip
    n_place = int(np.sum(settings["n_ring"]))
    return DelayProcessing(**{"is_buffered": np.full(n_place, not settings["is_extrapolated"])} | settings)


@jit
def kept_after(state_history, nav, previous, x, settings, window):
    store_state(state_history, nav, previous, x, settings, window, DT, J4)


def state():
    nav = np.concatenate([[1.0, 0.0, 0.0, 0.0], V_I, R_I])
    return nav, np.array([0.0, 0.0, 0.0, 0.1, -0.2, 0.05])


def test_state_and_earlier_velocity_are_kept_at_their_windows_only():
    nav, previous = state()
    state_history, none = np.zeros((2, N_PAST)), np.zeros(9)
    kept = state_history[0]
    kept_after(state_history, nav, previous, none, delays(), 2)
    assert not state_history.any()
    kept_after(state_history, nav, previous, none, delays(), 0)
    np.testing.assert_array_equal(kept[EARLY : EARLY + 3], V_I)
    assert not kept[:EARLY].any()
    kept_after(state_history, nav, previous, none, delays(), 1)
    np.testing.assert_array_equal(kept[NAV : NAV + 10], nav)
    np.testing.assert_array_equal(kept[LAST : LAST + 6], previous)
    kept_after(state_history, 2.0 * nav, previous, none, None, 1)
    np.testing.assert_array_equal(kept[NAV : NAV + 10], nav)
    assert not state_history[1].any()


def test_between_two_ticks_the_state_moves_with_its_own_acceleration():
    nav, previous = state()
    state_history = np.zeros((2, N_PAST))
    kept = state_history[0]
    kept_after(state_history, nav, previous, np.zeros(9), delays(offset=np.array([[0.002]])), 1)
    force = previous[3:] / DT + np.array(gravity_j4(*R_I))
    np.testing.assert_allclose(kept[NAV + R : NAV + R + 3], R_I + 0.002 * V_I + 0.5 * 0.002**2 * force, atol=1e-9)
    np.testing.assert_allclose(kept[NAV + V : NAV + V + 3], V_I + 0.002 * force, atol=1e-12)
    np.testing.assert_array_equal(kept[NAV + Q : NAV + Q + 4], nav[:4])


def test_an_extrapolated_solution_is_an_euler_step_with_the_covariance_of_equation_7_20():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((9, 9))
    P, base = root @ root.T, np.diag([4.0] * 3 + [0.01] * 3)
    slope, before = np.array([30.0, -10.0, 5.0]), np.array([29.0, -10.0, 4.0])
    state_history = np.zeros((2, N_PAST))
    kept, last = state_history
    kept[NAV + V : NAV + V + 3], kept[EARLY : EARLY + 3] = V_I, V_I - 0.1 * slope
    last[:3], last[KNOWN] = before, 1.0
    z, reported = np.zeros(6), base.copy()
    extrapolate_solution(z, reported, state_history, P, delays(delay_variance=1e-6, acceleration_variance=0.04), 0)
    moves = np.concatenate([V_I, slope])
    np.testing.assert_allclose(z, 0.3 * moves, rtol=1e-10)
    left = 0.5 * 0.3**2 * np.concatenate([slope, slope - before])
    expected = base + 1e-6 * np.outer(moves, moves) + np.outer(left, left)
    expected[:3, :3] += 0.09 * P[VEL : VEL + 3, VEL : VEL + 3]
    expected[3:, 3:] += 0.09 * 0.04 * np.eye(3)
    np.testing.assert_allclose(reported, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(last[:3], slope, rtol=1e-10)


def test_the_first_epoch_knows_no_change_of_the_acceleration():
    state_history = np.zeros((2, N_PAST))
    state_history[0, NAV + V : NAV + V + 3], state_history[0, EARLY : EARLY + 3] = V_I, V_I - 3.0
    reported = np.zeros((6, 6))
    extrapolate_solution(np.zeros(6), reported, state_history, np.zeros((9, 9)), delays(), 0)
    assert not reported[3:, :].any()
    assert reported[0, 0] == pytest.approx((0.5 * 0.09 * 30.0) ** 2)
    assert state_history[1, KNOWN] == 1.0


def test_an_epoch_that_is_extrapolated_again_gets_the_same_covariance():
    state_history = np.zeros((2, N_PAST))
    state_history[0, NAV + V : NAV + V + 3], state_history[0, EARLY : EARLY + 3] = V_I, V_I - 3.0
    state_history[1, :3], state_history[1, KNOWN] = 25.0, 1.0
    found = np.zeros((2, 6, 6))
    extrapolate_solution(np.zeros(6), found[0], state_history, np.zeros((9, 9)), delays(), 0)
    repeat_extrapolation(state_history, delays())
    extrapolate_solution(np.zeros(6), found[1], state_history, np.zeros((9, 9)), delays(), 0)
    np.testing.assert_array_equal(found[1], found[0])
    assert found[0, 3, 3] == pytest.approx((0.5 * 0.09 * 5.0) ** 2)
    repeat_extrapolation(state_history, None)


def test_a_delay_of_several_epochs_stores_several_states_at_once_each_in_its_place():
    """Epochs 0 to 4 are of the ends of windows 0 to 4 and three states are stored at once: the fourth replaces the
    first.
    """
    ends = np.array([[k, k + 1] for k in range(5)])
    settings = delays(
        n_ring=np.array([3]), state_epochs=ends[None], velocity_epochs=ends[None], offset=np.zeros((1, 5))
    )
    nav, previous = state()
    state_history = np.zeros((4, N_PAST))
    for window in range(5):
        kept_after(state_history, (window + 1.0) * nav, previous, np.full(9, float(window)), settings, window)
    for epoch in (2, 3, 4):
        np.testing.assert_array_equal(state_history[epoch % 3, NAV : NAV + 10], (epoch + 1.0) * nav)
        np.testing.assert_array_equal(state_history[epoch % 3, ERROR : ERROR + 9], epoch)
    assert not state_history[3].any()


def test_the_stored_attitude_of_a_sensor_is_turned_by_less_than_a_tick_and_that_of_a_receiver_is_not():
    nav, previous = state()
    previous[:3] = 1e-3, -2e-3, 5e-4  # rad in a tick
    offset = np.array([[0.4 * DT]])
    own, receivers = (delays(offset=offset, receiver_line=line) for line in (-1, 0))
    for settings, expected in ((own, 0.4 * previous[:3]), (receivers, np.zeros(3))):
        state_history = np.zeros((2, N_PAST))
        kept_after(state_history, nav, previous, np.zeros(9), settings, 1)
        np.testing.assert_allclose(2.0 * state_history[0, NAV + Q + 1 : NAV + Q + 4], expected, atol=1e-9)


def test_lines_have_places_of_their_own_one_behind_the_other():
    settings = delays(n_ring=np.array([2, 3]), first=np.array([0, 2]), line=np.array([0, 0, 1, -1]))
    assert [ring_index(settings, 0, epoch) for epoch in range(4)] == [0, 1, 0, 1]
    assert [ring_index(settings, 1, epoch) for epoch in range(4)] == [2, 3, 4, 2]
    assert [channel_ring_index(settings, channel, 3) for channel in range(4)] == [1, 1, 2, 0]
    assert channel_ring_index(None, 0, 3) == 0


def test_what_is_fed_back_corrects_every_stored_state_of_a_buffered_filter_and_none_of_an_extrapolated_one():
    nav, x = state()[0], 1e-3 * np.arange(1.0, 10.0)
    state_history = np.zeros((3, N_PAST))
    state_history[:2, NAV : NAV + 10] = nav
    untouched = state_history.copy()
    correct_stored_states(state_history, delays(n_ring=np.array([2])), x)
    np.testing.assert_array_equal(state_history, untouched)
    correct_stored_states(state_history, delays(n_ring=np.array([2]), is_extrapolated=False), x)
    for stored in state_history[:2]:
        np.testing.assert_allclose(stored[NAV + V : NAV + V + 3] - V_I, x[VEL : VEL + 3], rtol=1e-9)
        np.testing.assert_allclose(stored[NAV + R : NAV + R + 3] - R_I, x[POS : POS + 3], atol=1e-9)
        np.testing.assert_allclose(2.0 * stored[NAV + Q + 1 : NAV + Q + 4], x[ATT : ATT + 3], rtol=1e-5)
    assert not state_history[2].any()


def test_an_open_loop_compares_a_late_measurement_with_the_error_state_of_its_time():
    rng = np.random.default_rng(3)
    settings, state_history = delays(n_ring=np.array([2]), is_extrapolated=False), rng.standard_normal((3, N_PAST))
    stored = state_history.copy()
    x, before, h = rng.standard_normal(12), rng.standard_normal(12), rng.standard_normal(5)
    correct_stored_errors(state_history, settings, x, before)
    np.testing.assert_allclose(state_history[:2, ERROR : ERROR + 9], stored[:2, ERROR : ERROR + 9] + (x - before)[:9])
    np.testing.assert_array_equal(state_history[2], stored[2])
    # a parameter is not stored: what the error state says of it is that of now
    entries, columns = np.array([0, 2, 4]), np.array([POS, VEL + 1, 10])
    found = prediction_change(state_history, ring_index(settings, 0, 3), h, entries, columns, x)
    then = state_history[1, ERROR : ERROR + 9]
    assert found == pytest.approx(h[0] * (then[POS] - x[POS]) + h[2] * (then[VEL + 1] - x[VEL + 1]), rel=1e-12)
