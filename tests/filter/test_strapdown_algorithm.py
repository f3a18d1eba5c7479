"""Algorithms of the strapdown: published coefficients, closed forms of coning and sculling, frames of mechanisation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.strapdown_algorithm import (
    StrapdownCard,
    build_strapdown,
    optimised_weights,
    polynomial_weights,
    recursive_weights,
)
from lvnav_trade.kernels.attitude import matrix, small_rotation
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_V, Q, R, V, to_earth_fixed, to_inertial
from lvnav_trade.quantities.frames import rotation_i_e

FAR = 1e15  # m; gravitation is 4e-16 m/s^2 there
ALGORITHMS = [
    ("summed", 1), ("summed", 3), ("two_sample", 1), ("two_sample", 2), ("optimised_present", 2),
    ("optimised_present", 3), ("optimised_present", 4), ("optimised_present", 5), ("optimised", 2), ("optimised", 3),
    ("optimised", 4), ("recursive", 1), ("recursive", 2), ("recursive", 5), ("polynomial", 2), ("polynomial", 3),
    ("polynomial", 4),
]  # fmt: skip


def test_the_weights_are_the_published_ones():
    # Miller's and Ignagni's present-interval algorithms of 2 to 5 subsamples; Ignagni's first with the step before
    published = {
        2: [2 / 3], 3: [9 / 20, 27 / 20], 4: [54 / 105, 92 / 105, 214 / 105],
        5: [250 / 504, 525 / 504, 650 / 504, 1375 / 504],
    }  # fmt: skip
    for subsamples, weights in published.items():
        found, across = optimised_weights(subsamples, uses_previous_step=False)
        np.testing.assert_allclose(found, weights, rtol=1e-15)
        assert across == 0.0
    found, across = optimised_weights(2, uses_previous_step=True)
    np.testing.assert_allclose([*found, across], [32 / 45, -1 / 180], rtol=1e-14)
    assert optimised_weights(1, uses_previous_step=True)[1] == pytest.approx(1 / 12, rel=1e-15)


def test_the_polynomials_weights_are_the_published_ones():
    # two, three and four samples of the rotation vector: Bortz's equation on a parabola, and so on
    published = {
        2: {(0, 1): 2 / 3},
        3: {(0, 1): 57 / 80, (1, 2): 57 / 80, (0, 2): 33 / 80},
        4: {(0, 1): 736 / 945, (2, 3): 736 / 945, (0, 2): 334 / 945, (1, 3): 334 / 945, (0, 3): 526 / 945,
            (1, 2): 654 / 945},
    }  # fmt: skip
    for subsamples, weights in published.items():
        found = polynomial_weights(subsamples)
        assert np.count_nonzero(found) == len(weights)
        for at, weight in weights.items():
            assert found[at] == pytest.approx(weight, rel=1e-14)


def test_savages_recursion_is_its_sum():
    """Angle and its compensation as they are accumulated increment by increment (Savage 1998, part 1, equation 33)."""
    rng = np.random.default_rng(5)
    increments, before = rng.normal(size=(6, 3)), rng.normal(size=3)
    angle, found, last = np.zeros(3), np.zeros(3), before
    for one in increments:
        found += 0.5 * np.cross(angle + last / 6.0, one)
        angle, last = angle + one, one
    pairs = recursive_weights(6)
    ours = np.cross(before, increments[0]) / 12.0
    ours += sum(pairs[j, k] * np.cross(increments[j], increments[k]) for j in range(6) for k in range(j + 1, 6))
    np.testing.assert_allclose(ours, found, rtol=1e-13)


def residual(algorithm, ratio, b):
    """Return the coning that is left of a step, over the square of the amplitude: b of a subsample (rad)."""
    how, x = build_strapdown(StrapdownCard(algorithm=algorithm, ratio=ratio), "point"), ratio * b
    pairs = np.zeros((0, 0)) if how.extensions is None else how.extensions.pairs
    y = b if pairs.size else x  # what is multiplied across the steps: neighbouring increments, or sums
    found = 0.5 * (x - math.sin(x)) - how.previous_step_weight * 4.0 * math.sin(0.5 * y) ** 2 * math.sin(y)
    for (j, k), weight in np.ndenumerate(pairs):
        found -= weight * 4.0 * math.sin(0.5 * b) ** 2 * math.sin((k - j) * b)
    for j, weight in enumerate(how.weights):
        found -= weight * 4.0 * math.sin(0.5 * b) ** 2 * math.sin((ratio - 1 - j) * b)
    return found


def integrate_increments(nav, increments, T, algorithm, ratio):
    """Return the navigation state after all increments, of which the first step is that before the start."""
    how = build_strapdown(StrapdownCard(algorithm=algorithm, ratio=ratio), "point")
    before = increments[ratio - 1] if how.extensions is not None else increments[:ratio].sum(axis=0)
    nav, sums, previous = nav.copy(), np.zeros(N_SUM), before.copy()
    gained = np.zeros(3)
    for first in range(ratio, len(increments), ratio):
        mechanise(nav, sums, previous, increments[first : first + ratio], 1, ratio * T, how, 0.0)
        gained += sums[SUM_V : SUM_V + 3]
    return nav, gained


def coning(amplitude, w, T, n, before):
    """Exact increments of q = (cos A/2, sin A/2 cos wt, sin A/2 sin wt, 0): n ticks, `before` of them before t = 0."""
    t = T * np.arange(-before, n + 1)
    out = np.zeros((n + before, 6))
    out[:, 0], out[:, 1] = np.diff(math.sin(amplitude) * np.cos(w * t)), np.diff(math.sin(amplitude) * np.sin(w * t))
    out[:, 2] = -2.0 * w * math.sin(0.5 * amplitude) ** 2 * T
    return out


@pytest.mark.parametrize(("algorithm", "ratio"), ALGORITHMS)
def test_coning_drifts_by_what_the_algorithm_leaves(algorithm, ratio):
    a, T, cycle = math.radians(0.1), 0.0025, 20  # ticks: 20 Hz at 400 Hz, 0.31 rad a subsample
    w, n = 2.0 * math.pi / (cycle * T), 60 * cycle
    q0 = (math.cos(0.5 * a), math.sin(0.5 * a), 0.0, 0.0)
    start = np.array([*q0, 0.0, 0.0, 0.0, FAR, 0.0, 0.0])
    nav, _ = integrate_increments(start, coning(a, w, T, n, ratio), T, algorithm, ratio)
    drift = small_rotation(*q0, *nav[Q : Q + 4])[2]
    expected = residual(algorithm, ratio, w * T) * a * a * n / ratio
    # the fourth power of the amplitude is left out of the closed form, and rounding of a thousand steps
    assert abs(drift) == pytest.approx(abs(expected), rel=2e-3, abs=2e-4 * a**2)


@pytest.mark.parametrize(("algorithm", "ratio"), ALGORITHMS)
def test_the_drift_grows_with_the_published_power_of_the_frequency(algorithm, ratio):
    # 2 K + 3 of K products: Miller's 2 N + 1 of the present step alone
    how = build_strapdown(StrapdownCard(algorithm=algorithm, ratio=ratio), "point")
    # a recursion has its one product of neighbours for each increment, a polynomial two powers for two of them
    count = {"recursive": 1, "polynomial": ratio // 2}.get(
        algorithm, len(how.weights) + (how.previous_step_weight != 0.0)
    )
    x = 0.3 if count < 3 else 1.2  # rad a step: above rounding, and below the next power
    power = math.log2(residual(algorithm, ratio, x / ratio) / residual(algorithm, ratio, 0.5 * x / ratio))
    assert power == pytest.approx(2 * count + 3, abs=0.12)


@pytest.mark.parametrize(("algorithm", "ratio"), ALGORITHMS)
def test_sculling_leaves_what_coning_leaves(algorithm, ratio):
    # a body that rocks about x by angle * sin wt under a force along y of force * sin wt: the dual of a cone
    angle, force, T, cycle = math.radians(0.1), 10.0, 0.0025, 20
    w, n = 2.0 * math.pi / (cycle * T), 60 * cycle
    t, increments = T * np.arange(-ratio, n + 1), np.zeros((n + ratio, 6))
    increments[:, 0], increments[:, 4] = np.diff(angle * np.sin(w * t)), np.diff(-force / w * np.cos(w * t))
    _, gained = integrate_increments(np.array([1.0, 0, 0, 0, 0, 0, 0, FAR, 0, 0]), increments, T, algorithm, ratio)
    # the mean of force * sin wt * angle * sin wt, along z, is half their product; its cubic term is 4e-7
    left = 0.5 * angle * force * n * T - gained[2]
    expected = residual(algorithm, ratio, w * T) * angle * force / w * n / ratio
    assert abs(left) == pytest.approx(abs(expected), rel=2e-3, abs=1e-6 * angle * force * n * T)


def test_summed_increments_turn_the_velocity_gained_by_the_attitude_at_the_end():
    increments = np.array([[0.02, 0.01, -0.03, 0.4, -0.1, 0.2], [0.01, -0.02, 0.03, 0.3, 0.2, -0.1]])
    how, nav, sums = build_strapdown(StrapdownCard(algorithm="summed", ratio=2), "point"), np.zeros(10), np.zeros(N_SUM)
    nav[Q], nav[R] = 1.0, FAR
    mechanise(nav, sums, np.ones(6), increments, 1, 0.01, how, 0.0)
    expected = np.reshape(matrix(*nav[Q : Q + 4]), (3, 3)) @ increments[:, 3:].sum(axis=0)  # equation 3 of the paper
    np.testing.assert_allclose(nav[V : V + 3], expected, rtol=0, atol=1e-9)


def mixed(T, n):
    """Increments of a body that cones and rocks at 9 and 14 Hz under a force that shakes with it, and exact means by
    Gauss-Legendre of its rates.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    t = (T * np.arange(n)[:, None] + 0.5 * T * (nodes + 1.0)).T
    u, v = 2.0 * math.pi * 9.0 * t, 2.0 * math.pi * 14.0 * t
    rates = [0.9 * np.cos(u), 0.8 * np.sin(u), 0.3 * np.cos(v), 20.0 + 0.0 * t, 3.0 * np.sin(v), 4.0 * np.cos(u)]
    return np.stack([0.5 * T * np.tensordot(weights, rate, 1) for rate in rates], axis=1)


def test_a_cone_that_sculls_converges_to_its_integration_at_a_high_rate():
    T, n = 0.0025, 360
    start = np.array([1.0, 0, 0, 0, 0, 0, 0, FAR, 0, 0])
    exact, _ = integrate_increments(
        start, np.vstack([np.zeros((1, 6)), mixed(T / 32.0, 32 * n)]), T / 32.0, "two_sample", 1
    )

    def error(algorithm, ratio):
        found, _ = integrate_increments(start, np.vstack([np.zeros((ratio, 6)), mixed(T, n)]), T, algorithm, ratio)
        off = exact[V : V + 3] - found[V : V + 3]
        return np.linalg.norm(small_rotation(*exact[:4], *found[:4])), np.linalg.norm(off)

    for ratio in (2, 3, 4, 5):
        assert error("recursive", ratio)[0] < 0.05 * error("summed", ratio)[0]
        assert error("polynomial", ratio)[0] < 0.05 * error("summed", ratio)[0]
        plain, compensated = error("summed", ratio), error("optimised_present", ratio)
        assert compensated[0] < 0.03 * plain[0]
        assert compensated[1] < 0.05 * plain[1]
    assert error("optimised_present", 5)[0] > error("optimised_present", 2)[0]


def test_a_state_turns_into_earth_fixed_axes_and_back():
    rng = np.random.default_rng(2)
    place = np.array([4.0e6, 3.0e6, 3.9e6])
    how = build_strapdown(StrapdownCard(), "j4", "pad", 0.7, place)
    nav = np.concatenate([[0.5, -0.5, 0.5, 0.5], [100.0, 400.0, 50.0], place + rng.normal(size=3)])
    turned, angle = nav.copy(), 0.7
    to_earth_fixed(turned, how, angle)
    C = rotation_i_e(angle)
    np.testing.assert_allclose(turned[R : R + 3], C @ (nav[R : R + 3] - place), rtol=0, atol=1e-8)
    relative = nav[V : V + 3] - np.cross([0.0, 0.0, OMEGA], nav[R : R + 3])
    np.testing.assert_allclose(turned[V : V + 3], C @ relative, rtol=0, atol=1e-11)
    attitude = np.reshape(matrix(*nav[Q : Q + 4]), (3, 3))
    np.testing.assert_allclose(np.reshape(matrix(*turned[Q : Q + 4]), (3, 3)), C @ attitude, rtol=0, atol=1e-15)
    to_inertial(turned, how, angle)
    np.testing.assert_allclose(turned, nav, rtol=1e-15, atol=1e-9)


@pytest.mark.parametrize("ratio", [1, 3])
def test_an_ascent_is_the_same_in_every_frame(ratio):
    # 400 s of 20 to 60 m/s^2 along a body that pitches and spins, with the sums that the transition needs
    T, n, seconds = 0.005, 12, 400.0
    start = np.array([0.6, 0.0, 0.8, 0.0, 0.0, 465.0, 0.0, 6378137.0, 0.0, 1e3])
    ends, sums = {}, {}
    for mechanisation in ("inertial", "earth", "pad", "ned", "enu"):
        how = build_strapdown(StrapdownCard(ratio=ratio), "j4", mechanisation, 0.3, start[R : R + 3])
        nav, previous, kept = start.copy(), np.zeros(6), []
        for window in range(round(seconds / (n * T))):
            t = n * T * window
            rate, force = np.array([0.5, 0.004, 0.002 * math.sin(0.1 * t)]), np.array([20.0 + 0.1 * t, 0.3, -0.2])
            increments, total = np.tile(T * np.concatenate([rate, force]), (n, 1)), np.zeros(N_SUM)
            mechanise(nav, total, previous, increments, n // ratio, ratio * T, how, t)
            kept.append(total)
        ends[mechanisation], sums[mechanisation] = nav, np.array(kept)
    assert np.linalg.norm(ends["inertial"][V : V + 3]) > 5000.0
    for mechanisation in ("earth", "pad", "ned", "enu"):
        off = ends[mechanisation] - ends["inertial"]
        # row 44 of the statements: 1 mm over an ascent; axes that turn with the vehicle add a few at steps of 15 ms
        assert np.linalg.norm(off[R : R + 3]) < (1e-3 if ratio == 1 or mechanisation in {"earth", "pad"} else 4e-3)
        assert np.linalg.norm(off[V : V + 3]) < 1e-5
        np.testing.assert_allclose(sums[mechanisation][:, SUM_C : SUM_C + 9], sums["inertial"][:, :9], atol=2e-7)
        np.testing.assert_allclose(sums[mechanisation][:, SUM_V : SUM_V + 3], sums["inertial"][:, 9:12], atol=1e-4)
    assert not np.array_equal(ends["earth"], ends["inertial"])
    assert not np.array_equal(ends["ned"], ends["enu"])
    np.testing.assert_allclose(ends["ned"], ends["enu"], rtol=1e-9, atol=1e-6)


def test_local_axes_differ_from_the_inertial_frame_by_the_square_of_the_step():
    start = np.array([0.6, 0.0, 0.8, 0.0, 0.0, 465.0, 0.0, 6378137.0, 0.0, 1e3])

    def apart(step):
        ends = []
        for mechanisation in ("inertial", "ned"):
            how, nav, previous = build_strapdown(StrapdownCard(), "j4", mechanisation, 0.3), start.copy(), np.zeros(6)
            increments = np.tile(step * np.array([0.0, 0.004, 0.0, 40.0, 0.3, -0.2]), (round(0.2 / step), 1))
            previous[:] = increments[0]
            for window in range(1000):
                mechanise(nav, np.zeros(N_SUM), previous, increments, len(increments), step, how, 0.2 * window)
            ends.append(nav)
        return np.linalg.norm(ends[1][R : R + 3] - ends[0][R : R + 3])

    coarse, fine = apart(0.04), apart(0.02)
    assert 1e-3 < coarse < 2e-2
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_present_increments_alone_need_two_of_them():
    with pytest.raises(ValueError, match="optimised_present: a step of one increment"):
        StrapdownCard(algorithm="optimised_present")


def test_the_rate_of_earlier_versions_is_refused_with_what_replaces_it():
    with pytest.raises(ValueError, match=r"strapdown_rate: replaced by strapdown\.ratio"):
        FilterCard(name="x", source="x", measurements=[], strapdown_rate="100 Hz")
