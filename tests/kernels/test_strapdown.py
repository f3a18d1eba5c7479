"""Strapdown against closed forms: coning, sculling, spin under constant force, free fall."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import j1

from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.earth import GM
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import J4, N_SUM, POINT, SUM_C, SUM_F, SUM_TH, SUM_V, Q, R, V, full_rate

DEG_H = math.pi / 180.0 / 3600.0
FAR = 1e15  # m; gravitation is 4e-16 m/s^2 there


def start(q=(1.0, 0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), r=(FAR, 0.0, 0.0)):
    return np.array([*q, *v, *r], dtype=float)


def fly(nav, increments, dt, kind=POINT, previous=None, forget=False):
    """Mechanise all increments tick by tick; `forget` drops the tick before, which makes a one-sample algorithm."""
    nav, sums = nav.copy(), np.zeros(N_SUM)
    previous = np.zeros(6) if previous is None else previous.copy()
    gained = np.zeros(3)
    for k in range(len(increments)):
        if forget:
            previous[:] = 0.0
        mechanise(nav, sums, previous, increments[k : k + 1], 1, dt, full_rate(kind), 0.0)
        gained += sums[SUM_V : SUM_V + 3]
    return nav, gained


def coning_increments(amplitude, frequency, T, n):
    """Exact increments of q = (cos A/2, sin A/2 cos wt, sin A/2 sin wt, 0): n ticks after one ending at t = 0."""
    w, t = 2.0 * math.pi * frequency, T * np.arange(-1, n + 1)
    out = np.zeros((n + 1, 6))
    out[:, 0], out[:, 1] = np.diff(math.sin(amplitude) * np.cos(w * t)), np.diff(math.sin(amplitude) * np.sin(w * t))
    out[:, 2] = -2.0 * w * math.sin(0.5 * amplitude) ** 2 * T
    return out


CONING = [  # amplitude deg, frequency Hz, tick s, theory rad/s, one sample deg/h, with the previous tick deg/h
    (1.0, 10.0, 0.005, 1.566266e-4, 32.30, 0.633),
    (0.1, 50.0, 0.0025, 4.769779e-5, 9.838, 1.163),
    (1.0, 5.0, 0.010, 7.831331e-5, 16.151, 0.3166),
]


@pytest.mark.parametrize(("amplitude", "frequency", "T", "theory", "one_sample", "two_sample"), CONING)
def test_coning_drifts_as_the_closed_form_says(amplitude, frequency, T, theory, one_sample, two_sample):
    a, seconds = math.radians(amplitude), 10.0  # whole cycles, so that the wobble is back where it began
    w = 2.0 * math.pi * frequency
    assert 0.5 * w * math.sin(a) ** 2 * (1.0 - math.sin(w * T) / (w * T)) == pytest.approx(theory, rel=1e-6)
    q0 = (math.cos(0.5 * a), math.sin(0.5 * a), 0.0, 0.0)
    increments = coning_increments(a, frequency, T, round(seconds / T))
    before = increments[0]

    def drift(forget):
        nav, _ = fly(start(q0), increments[1:], T, previous=before, forget=forget)
        return np.linalg.norm(small_rotation(*q0, *nav[Q : Q + 4])) / seconds / DEG_H

    # the closed form leaves out sixth powers of the amplitude and keeps the printed four digits
    assert drift(forget=True) == pytest.approx(one_sample, rel=1e-3)
    assert drift(forget=False) == pytest.approx(two_sample, rel=5e-3)


def sculling_increments(angle, force, frequency, T, n):
    """Increments of a body that rocks about x by angle * sin wt under a force along y of force * sin wt."""
    w, t = 2.0 * math.pi * frequency, T * np.arange(-1, n + 1)
    out = np.zeros((n + 1, 6))
    out[:, 0] = np.diff(angle * np.sin(w * t))
    out[:, 4] = np.diff(-force / w * np.cos(w * t))
    return out


def test_sculling_gains_the_velocity_of_the_closed_form():
    # mean of force * sin wt * sin(angle * sin wt) over a cycle is force * J1(angle), along z
    angle, force, frequency, T, seconds = math.radians(1.0), 10.0, 10.0, 0.005, 10.0
    x = 2.0 * math.pi * frequency * T
    increments = sculling_increments(angle, force, frequency, T, round(seconds / T))
    errors = []
    for forget in (True, False):
        _, gained = fly(start(), increments[1:], T, previous=increments[0], forget=forget)
        errors.append(force * j1(angle) - gained[2] / seconds)
    one = 0.5 * angle * force * (1.0 - math.sin(x) / x)
    two = one - 0.5 * angle * force * 2.0 * math.sin(0.5 * x) ** 2 * math.sin(x) / (3.0 * x)
    # the same bracket as coning's; corrections are of the square of the amplitude, 3e-4
    assert errors[0] == pytest.approx(one, rel=1e-3)
    assert errors[1] == pytest.approx(two, rel=2e-2)


def spin(rate, force, t):
    """Attitude angle, velocity and position after t of a spin about x under a force along body y, from rest."""
    s, c = math.sin(rate * t), math.cos(rate * t)
    velocity = force / rate * np.array([0.0, s, 1.0 - c])
    position = force / rate**2 * np.array([0.0, 1.0 - c, rate * t - s])
    return velocity, position


def spin_increments(rate, force, T, n):
    return np.tile([rate * T, 0.0, 0.0, 0.0, force * T, 0.0], (n, 1))


def test_a_constant_rate_is_integrated_exactly():
    rate, T, n = 0.5, 0.005, 2000
    nav, _ = fly(start(), spin_increments(rate, 0.0, T, n), T)
    exact = (math.cos(0.5 * rate * n * T), math.sin(0.5 * rate * n * T), 0.0, 0.0)
    # rounding of 2000 products, a random walk of 1e-16 each, with a margin of ten
    np.testing.assert_allclose(nav[Q : Q + 4], exact, rtol=0, atol=5e-14)


def test_a_force_along_the_spin_axis_is_integrated_exactly():
    increments = np.tile([0.5 * 0.005, 0.0, 0.0, 30.0 * 0.005, 0.0, 0.0], (2000, 1))
    nav, _ = fly(start(), increments, 0.005)
    assert nav[V] == pytest.approx(300.0, rel=1e-12)
    assert nav[R] - FAR == pytest.approx(1500.0, abs=0.5)  # a float64 at 1e15 m counts in eighths of a metre
    np.testing.assert_allclose(nav[[V + 1, V + 2]], 0.0, atol=1e-12)


def test_a_force_across_the_spin_axis_is_good_to_the_square_of_the_angle_per_tick_and_second_order():
    rate, force, seconds = 0.5, 30.0, 4.0
    errors = []
    for T in (0.02, 0.01):
        n = round(seconds / T)
        before = spin_increments(rate, force, T, 1)[0]
        nav, _ = fly(start(), spin_increments(rate, force, T, n), T, previous=before)
        velocity, _ = spin(rate, force, seconds)
        errors.append(np.linalg.norm(nav[V : V + 3] - velocity))
        # what the rotation of a tick leaves out of C is its square over six
        assert errors[-1] < (rate * T) ** 2 / 6.0 * np.linalg.norm(velocity) * 1.01
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=1e-2)


def test_a_circular_orbit_of_a_point_mass_closes():
    radius = 6778e3
    n = math.sqrt(GM / radius**3)
    seconds, T = 600.0, 0.005
    nav, sums, previous = start(v=(0.0, n * radius, 0.0), r=(radius, 0.0, 0.0)), np.zeros(N_SUM), np.zeros(6)
    for _ in range(round(seconds / 1.0)):
        mechanise(nav, sums, previous, np.zeros((200, 6)), 200, T, full_rate(POINT), 0.0)
    angle = n * seconds
    # rounding of 120 000 additions at 7e6 m: 1e-9 m each, as a walk of 3e-7 m, and of the velocity, 1e-12 m/s each
    exact_r = radius * np.array([math.cos(angle), math.sin(angle), 0.0])
    exact_v = n * radius * np.array([-math.sin(angle), math.cos(angle), 0.0])
    np.testing.assert_allclose(nav[R : R + 3], exact_r, rtol=0, atol=1e-4)
    np.testing.assert_allclose(nav[V : V + 3], exact_v, rtol=0, atol=1e-6)


def random_window(n=40, dt=0.005):
    rng = np.random.default_rng(5)
    increments = dt * np.concatenate([0.05 + 0.05 * rng.standard_normal((n, 3)), 20.0 + rng.standard_normal((n, 3))], 1)
    return increments, dt


def test_the_sums_over_a_window_are_the_integrals_that_their_docstring_names():
    increments, dt = random_window()
    nav, sums, previous = start((0.8, 0.6, 0.0, 0.0), v=(10.0, 20.0, 30.0)), np.zeros(N_SUM), np.zeros(6)
    ticked, total_c, total_v = nav.copy(), np.zeros(9), np.zeros(3)
    before, scratch = np.zeros(6), np.zeros(N_SUM)
    for k in range(len(increments)):
        total_c += 0.5 * dt * np.array(matrix(*ticked[Q : Q + 4]))
        last = ticked[V : V + 3].copy()
        mechanise(ticked, scratch, before, increments[k : k + 1], 1, dt, full_rate(POINT), 0.0)
        total_c += 0.5 * dt * np.array(matrix(*ticked[Q : Q + 4]))
        total_v += ticked[V : V + 3] - last
    mechanise(nav, sums, previous, increments, len(increments), dt, full_rate(POINT), 0.0)
    # normalising every tick or once leaves differences of rounding
    np.testing.assert_allclose(nav, ticked, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(sums[SUM_C : SUM_C + 9], total_c, rtol=0, atol=1e-13)
    np.testing.assert_allclose(sums[SUM_V : SUM_V + 3], total_v, rtol=0, atol=1e-11)
    np.testing.assert_allclose(sums[SUM_TH : SUM_TH + 3], increments[:, :3].sum(0), rtol=1e-13)
    np.testing.assert_allclose(sums[SUM_F : SUM_F + 3], increments[:, 3:].sum(0), rtol=1e-13)
    np.testing.assert_array_equal(previous, increments[-1])


def test_the_integral_of_the_attitude_of_a_spinning_body_is_good_to_the_square_of_the_angle_per_tick():
    """Trapezoids: the relative error is (rate x tick)^2 / 12, and a quarter of it with half the tick."""
    rate, seconds, errors = 10.0 * math.pi, 0.1, []
    angle = rate * seconds
    s, c = math.sin(angle) / rate, (1.0 - math.cos(angle)) / rate
    exact = np.array([seconds, 0.0, 0.0, 0.0, s, -c, 0.0, c, s])
    for n in (20, 40):
        T, sums = seconds / n, np.zeros(N_SUM)
        mechanise(start(), sums, np.zeros(6), spin_increments(rate, 0.0, T, n), n, T, full_rate(POINT), 0.0)
        errors.append(np.abs(sums[SUM_C : SUM_C + 9] - exact).max())
        assert errors[-1] == pytest.approx((rate * T) ** 2 / 12.0 * np.abs([s, c]).max(), rel=0.01)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=1e-2)


def test_a_window_cut_in_two_is_the_same_flight():
    increments, dt = random_window()
    whole, parts = start(r=(6.6e6, 0.0, 1e5)), start(r=(6.6e6, 0.0, 1e5))
    sums, p, q = np.zeros(N_SUM), np.zeros(6), np.zeros(6)
    mechanise(whole, sums, p, increments, 40, dt, full_rate(J4), 0.0)
    mechanise(parts, sums, q, increments, 17, dt, full_rate(J4), 0.0)
    mechanise(parts, sums, q, increments[17:], 23, dt, full_rate(J4), 0.0)
    # a float64 at 7e6 m counts in 1e-9 m
    np.testing.assert_allclose(parts, whole, rtol=1e-14, atol=1e-8)
