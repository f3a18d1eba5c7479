"""Unified powered-flight guidance: its thrust integrals by quadrature, its free fall, and a burn flown by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.trajectory.guided.explicit import (
    LAMBDA,
    N_LAW_STATE,
    REFERENCE,
    TGO,
    TURN,
    Target,
    integrals,
    schuler_coast,
    steer,
)


def test_thrust_integrals_are_those_of_quadrature():
    start, exhaust, span = 8.0, 3200.0, 250.0

    def a(t):
        return start / (1.0 - start * t / exhaust)

    once = [quad(lambda t, k=k: a(t) * t**k, 0.0, span)[0] for k in range(3)]
    twice = [quad(lambda t, k=k: (span - t) * a(t) * t**k, 0.0, span)[0] for k in range(3)]
    np.testing.assert_allclose(integrals(start, exhaust, span), [*once, *twice], rtol=1e-9)


def test_free_fall_by_the_schuler_approximation_is_a_circle_at_the_schuler_frequency():
    """A satellite of speed w r stays on its circle, and is back after 2 pi / w (85 min at this height)."""
    r = np.array([0.0, 0.0, 6378137.0 + 200e3])
    w = np.sqrt(np.linalg.norm(gravity_j4(*r)) / r[2])
    v = np.array([w * r[2], 0.0, 0.0])
    for part in (0.1, 0.25, 1.0):
        angle = 2.0 * np.pi * part
        place, speed = schuler_coast(r, v, angle / w)
        wanted = r[2] * np.array([np.sin(angle), 0.0, np.cos(angle)])
        np.testing.assert_allclose(place, wanted, atol=1e-6)
        np.testing.assert_allclose(speed, w * np.array([wanted[2], 0.0, -wanted[0]]), atol=1e-9)
    assert 2.0 * np.pi / w == pytest.approx(88.2 * 60.0, rel=5e-3)


def test_free_fall_by_the_schuler_approximation_is_the_solution_of_its_equation():
    r, v, span = np.array([4.1e6, -3.9e6, 3.5e6]), np.array([3e3, 5.1e3, 2.2e3]), 400.0
    square = np.linalg.norm(gravity_j4(*r)) / np.linalg.norm(r)
    found = solve_ivp(
        lambda _, y: np.concatenate([y[3:], -square * y[:3]]),
        (0.0, span),
        np.concatenate([r, v]),
        rtol=1e-12,
        atol=1e-6,
        method="DOP853",
    ).y[:, -1]
    np.testing.assert_allclose(np.concatenate(schuler_coast(r, v, span)), found, rtol=1e-10, atol=1e-3)


def test_the_schuler_approximation_misses_the_gradient_of_gravity_along_the_radius():
    """Gravity falls with the height by 2 w^2, the approximation lets it grow by w^2: a climb misses 3 w^2 v t."""
    r, climb, span = np.array([6.8e6, 0.0, 0.0]), 100.0, 20.0
    v = np.array([climb, 7600.0, 0.0])
    square = np.linalg.norm(gravity_j4(*r)) / r[0]
    true = solve_ivp(
        lambda _, y: np.concatenate([y[3:], gravity_j4(*y[:3])]),
        (0.0, span),
        np.concatenate([r, v]),
        rtol=1e-12,
        atol=1e-6,
        method="DOP853",
    ).y[:, -1]
    off = schuler_coast(r, v, span)[0][0] - true[0]
    assert off == pytest.approx(-0.5 * square * climb * span**3, rel=0.01)


def _burn(thrust, exhaust, mass, y, target, schuler):
    """Fly a burn second by second with scipy, steering anew at each; return the state at the end of the time to go."""
    kept, t = np.zeros(N_LAW_STATE), 0.0
    for _ in range(2000):
        if t == 0.0 or kept[TGO] > 10.0:
            assert steer(kept, t, y[:3].copy(), y[3:6].copy(), thrust / mass, exhaust, target, schuler)
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


@pytest.mark.parametrize("schuler", [False, True])
@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), (3e3, -8e3, 4e3)])
def test_a_burn_reaches_radius_speed_climb_and_plane(off, schuler):
    radius, speed = 6378137.0 + 250e3, 7760.0
    place = radius * np.array([np.cos(0.35), 0.0, np.sin(0.35)])
    target = Target(radius, speed, 0.002, np.array([0.0, -1.0, 0.0]), place)
    begin = np.array([6378137.0 + 130e3, 0.0, 0.0, 900.0, 0.0, 4200.0]) + np.array([*off, 0.0, 30.0, 0.0])
    y = _burn(70e3, 3200.0, 9000.0, begin, target, schuler)
    r, v = np.linalg.norm(y[:3]), np.linalg.norm(y[3:])
    assert abs(r - radius) < 30.0
    assert abs(v - speed) < 0.1
    assert abs(np.arcsin(y[:3] @ y[3:] / (r * v)) - 0.002) < 2e-5
    assert abs(y[1]) < 30.0
    assert abs(y[4]) < 0.1


def test_a_burn_that_cannot_reach_its_target_says_so():
    place = np.array([0.0, 0.0, 42e6])
    target = Target(42e6, 3000.0, 0.0, np.array([0.0, -1.0, 0.0]), place)
    kept = np.zeros(N_LAW_STATE)
    r, v = np.array([6.5e6, 0.0, 0.0]), np.array([0.0, 7e3, 0.0])
    assert not steer(kept, 0.0, r, v, 0.5, 2500.0, target)
