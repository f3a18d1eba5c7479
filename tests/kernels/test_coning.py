"""Products of increments against sums written out, and the rotation of a velocity increment against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.coning import (
    compensate_step,
    increment_sums,
    pair_products,
    products_within_step,
    velocity_rotation,
)
from lvnav_trade.kernels.strapdown import J4, Strapdown, StrapdownExtensions

N_SAMPLE = 3


@pytest.fixture
def increments():
    return 1e-2 * np.random.default_rng(7).standard_normal((8, 6))


def algorithm(weights=(), across=0.0, at_end=False):
    return Strapdown(J4, N_SAMPLE, np.array(weights), across, at_end, False, 0.0, np.zeros(3), None, True, False)


def pairs(weights):
    return StrapdownExtensions(0, weights)


def test_the_sums_are_those_of_the_increments_of_a_step(increments):
    np.testing.assert_allclose(increment_sums(increments, 2, N_SAMPLE), increments[2:5].sum(axis=0), rtol=1e-14)


def test_the_products_within_a_step_are_those_of_the_last_increment(increments):
    w, f = increments[2:5, :3], increments[2:5, 3:]
    p, u = 0.3 * w[0] + 0.7 * w[1], 0.3 * f[0] + 0.7 * f[1]
    expected = [*np.cross(p, w[2]), *(np.cross(p, f[2]) + np.cross(u, w[2]))]
    np.testing.assert_allclose(products_within_step(increments, 2, algorithm((0.3, 0.7))), expected, rtol=1e-12)


def test_the_products_of_pairs_are_a_sum_over_earlier_and_later_increments(increments):
    weights = np.random.default_rng(8).standard_normal((N_SAMPLE, N_SAMPLE))
    w, f = increments[2:5, :3], increments[2:5, 3:]
    coning, sculling = np.zeros(3), np.zeros(3)
    for k in range(N_SAMPLE):
        for j in range(k):
            coning += weights[j, k] * np.cross(w[j], w[k])
            sculling += weights[j, k] * (np.cross(w[j], f[k]) + np.cross(f[j], w[k]))
    np.testing.assert_allclose(pair_products(increments, 2, pairs(weights)), [*coning, *sculling], rtol=1e-12)


def test_a_velocity_increment_is_rotated_as_by_a_constant_rate():
    w, f = np.array([0.06, -0.04, 0.1]), np.array([1.0, 2.0, -0.5])
    a = float(np.linalg.norm(w))
    first = (1.0 - math.cos(a)) / a**2 * np.cross(w, f)
    second = (a - math.sin(a)) / a**3 * np.cross(w, np.cross(w, f))
    np.testing.assert_allclose(velocity_rotation(*w, *f), first + second, rtol=1e-9)


def test_a_step_adds_half_of_the_rotation_and_the_product_with_the_step_before(increments):
    previous = 1e-2 * np.random.default_rng(9).standard_normal(6)
    p, u = previous[:3].copy(), previous[3:].copy()
    sums = increments[:N_SAMPLE].sum(axis=0)
    w, f = sums[:3], sums[3:]
    across = 0.1
    further = pairs(np.zeros((0, 0)))
    step = compensate_step(further, previous, increments, 0, algorithm(across=across))
    np.testing.assert_allclose(step[:3], w + across * np.cross(p, w), rtol=1e-12)
    sculling = across * (np.cross(p, f) + np.cross(u, w))
    np.testing.assert_allclose(step[3:6], f + 0.5 * np.cross(w, f) + sculling, rtol=1e-12)
    np.testing.assert_allclose(step[6:], sums, rtol=1e-14)
    np.testing.assert_allclose(previous, sums, rtol=1e-14)
