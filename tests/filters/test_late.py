"""Late measurements: the state that they are met with, and what carrying them on adds to their covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filters.late import EARLY, KNOWN, LAST, N_PAST, NAV, Late, carry_on, keep
from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import J4, Q, R, V
from lvnav_trade.kernels.transition import VEL

R_I, V_I = np.array([4.05e6, -3.10e6, -4.12e6]), np.array([2900.0, 3300.0, 700.0])
DT = 0.005


def late(**fields):
    """A window in which the velocity before is kept, one in which the state is, and one in which nothing is."""
    settings = {
        "extrapolated": True, "valid": np.array([-1, 0, -1]), "early": np.array([0, -1, -1]), "delay": np.array([0.3]),
        "offset": np.array([0.0]), "base": np.array([0.1]), "interval": 1.0, "jitter": 0.0, "acceleration": 0.0,
    }  # fmt: skip
    return Late(**(settings | fields))


@jit
def kept_after(kept, nav, previous, settings, window):
    keep(kept, nav, previous, settings, window, DT, J4)


def state():
    nav = np.concatenate([[1.0, 0.0, 0.0, 0.0], V_I, R_I])
    return nav, np.array([0.0, 0.0, 0.0, 0.1, -0.2, 0.05])


def test_state_and_earlier_velocity_are_kept_at_their_windows_only():
    nav, previous = state()
    kept = np.zeros(N_PAST)
    kept_after(kept, nav, previous, late(), 2)
    assert not kept.any()
    kept_after(kept, nav, previous, late(), 0)
    np.testing.assert_array_equal(kept[EARLY : EARLY + 3], V_I)
    assert not kept[:EARLY].any()
    kept_after(kept, nav, previous, late(), 1)
    np.testing.assert_array_equal(kept[NAV : NAV + 10], nav)
    np.testing.assert_array_equal(kept[LAST : LAST + 6], previous)
    kept_after(kept, 2.0 * nav, previous, None, 1)
    np.testing.assert_array_equal(kept[NAV : NAV + 10], nav)


def test_between_two_ticks_the_state_moves_with_its_own_acceleration():
    nav, previous = state()
    kept = np.zeros(N_PAST)
    kept_after(kept, nav, previous, late(offset=np.array([0.002])), 1)
    force = previous[3:] / DT + np.array(gravity_j4(*R_I))
    np.testing.assert_allclose(kept[NAV + R : NAV + R + 3], R_I + 0.002 * V_I + 0.5 * 0.002**2 * force, atol=1e-9)
    np.testing.assert_allclose(kept[NAV + V : NAV + V + 3], V_I + 0.002 * force, atol=1e-12)
    np.testing.assert_array_equal(kept[NAV + Q : NAV + Q + 4], nav[:4])


def test_a_solution_carried_on_is_an_euler_step_with_the_covariance_of_equation_7_20():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((9, 9))
    P, base = root @ root.T, np.diag([4.0] * 3 + [0.01] * 3)
    slope, before = np.array([30.0, -10.0, 5.0]), np.array([29.0, -10.0, 4.0])
    kept = np.zeros(N_PAST)
    kept[NAV + V : NAV + V + 3], kept[EARLY : EARLY + 3] = V_I, V_I - 0.1 * slope
    kept[EARLY + 3 : EARLY + 6], kept[KNOWN] = before, 1.0
    z, told = np.zeros(6), base.copy()
    carry_on(z, told, kept, P, late(jitter=1e-6, acceleration=0.04), 0)
    moves = np.concatenate([V_I, slope])
    np.testing.assert_allclose(z, 0.3 * moves, rtol=1e-10)
    left = 0.5 * 0.3**2 * np.concatenate([slope, slope - before])
    expected = base + 1e-6 * np.outer(moves, moves) + np.outer(left, left)
    expected[:3, :3] += 0.09 * P[VEL : VEL + 3, VEL : VEL + 3]
    expected[3:, 3:] += 0.09 * 0.04 * np.eye(3)
    np.testing.assert_allclose(told, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kept[EARLY + 3 : EARLY + 6], slope, rtol=1e-10)


def test_the_first_epoch_knows_no_change_of_the_acceleration():
    kept = np.zeros(N_PAST)
    kept[NAV + V : NAV + V + 3], kept[EARLY : EARLY + 3] = V_I, V_I - 3.0
    told = np.zeros((6, 6))
    carry_on(np.zeros(6), told, kept, np.zeros((9, 9)), late(), 0)
    assert not told[3:, :].any()
    assert told[0, 0] == pytest.approx((0.5 * 0.09 * 30.0) ** 2)
    assert kept[KNOWN] == 1.0
