"""Unified powered-flight guidance: its thrust integrals by quadrature, and a burn flown by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.trajectory.guided.explicit import LAMBDA, N_KEPT, REFERENCE, TGO, TURN, Target, integrals, steer


def test_thrust_integrals_are_those_of_quadrature():
    start, exhaust, span = 8.0, 3200.0, 250.0

    def a(t):
        return start / (1.0 - start * t / exhaust)

    once = [quad(lambda t, k=k: a(t) * t**k, 0.0, span)[0] for k in range(3)]
    twice = [quad(lambda t, k=k: (span - t) * a(t) * t**k, 0.0, span)[0] for k in range(3)]
    np.testing.assert_allclose(integrals(start, exhaust, span), [*once, *twice], rtol=1e-9)


def _burn(thrust, exhaust, mass, y, target):
    """Fly a burn second by second with scipy, steering anew at each; return the state at the end of the time to go."""
    kept, t = np.zeros(N_KEPT), 0.0
    for _ in range(2000):
        if t == 0.0 or kept[TGO] > 10.0:
            assert steer(kept, t, y[:3].copy(), y[3:6].copy(), thrust / mass, exhaust, target)
            left = kept[TGO]
        h = min(1.0, left)

        def slope(time, state, begin=t, full=mass):
            u = kept[LAMBDA : LAMBDA + 3] + (time - kept[REFERENCE]) * kept[TURN : TURN + 3]
            u /= np.linalg.norm(u)
            push = thrust / (full - thrust / exhaust * (time - begin))
            return np.concatenate([state[3:], np.array(gravity_j4(*state[:3])) + push * u])

        y = solve_ivp(slope, (t, t + h), y, rtol=1e-11, atol=1e-6, method="DOP853").y[:, -1]
        t, mass, left = t + h, mass - thrust / exhaust * h, left - h
        if left <= 1e-9:
            return y
    raise AssertionError("the burn does not end")


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (3e3, -8e3, 4e3)])
def test_a_burn_reaches_radius_speed_climb_and_plane(off):
    radius, speed = 6378137.0 + 250e3, 7760.0
    place = radius * np.array([np.cos(0.35), 0.0, np.sin(0.35)])
    target = Target(radius, speed, 0.002, np.array([0.0, -1.0, 0.0]), place)
    begin = np.array([6378137.0 + 130e3, 0.0, 0.0, 900.0, 0.0, 4200.0]) + np.array([*off, 0.0, 30.0, 0.0])
    y = _burn(70e3, 3200.0, 9000.0, begin, target)
    r, v = np.linalg.norm(y[:3]), np.linalg.norm(y[3:])
    assert abs(r - radius) < 30.0
    assert abs(v - speed) < 0.1
    assert abs(np.arcsin(y[:3] @ y[3:] / (r * v)) - 0.002) < 2e-5
    assert abs(y[1]) < 30.0
    assert abs(y[4]) < 0.1


def test_a_burn_that_cannot_reach_its_target_says_so():
    place = np.array([0.0, 0.0, 42e6])
    target = Target(42e6, 3000.0, 0.0, np.array([0.0, -1.0, 0.0]), place)
    kept = np.zeros(N_KEPT)
    r, v = np.array([6.5e6, 0.0, 0.0]), np.array([0.0, 7e3, 0.0])
    assert not steer(kept, 0.0, r, v, 0.5, 2500.0, target)
