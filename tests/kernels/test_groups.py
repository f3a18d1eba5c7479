"""Sources eight to a vector: what is put into one of them is found there and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.groups import (
    GROUP,
    add_one,
    get_one,
    get_two,
    group,
    grouped_zeros,
    set_one,
    total_of,
    whole,
)
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import LINE
from lvnav_trade.kernels.vector import WIDTH


@jit
def put(sources, noise):
    add_one(sources, 1, 1, 3, 1, 2.5)
    add_one(sources, 1, 1, 3, 1, 0.5)
    set_one(noise, 1, 0, 0, 0, 4.0)
    return get_one(sources, 1, 1, 3, 1) + get_two(noise[0], 0, 0, 0)


@jit
def doubled(array, total):
    for g in range(array.shape[0]):
        row = group(array, g)
        row[0] = row[0] + row[0]
        total[0] += total_of(array[g])


@jit
def scaled(array, factor):
    lanes = whole(array)
    lanes[0] = factor * lanes[0]


def test_a_group_is_as_many_sources_as_a_vector_has_lanes():
    assert GROUP == WIDTH
    zeros = grouped_zeros((3, 4, 5))
    assert zeros.shape == (3, 4, 5, WIDTH)
    assert zeros.ctypes.data % LINE == 0


def test_a_source_is_a_lane_of_its_group():
    sources, noise = grouped_zeros((2, 4, 4)), grouped_zeros((2, 1, 1))
    assert put(sources, noise) == 3.0
    assert sources[1, 1, 3, 1] == 3.0
    assert np.count_nonzero(sources) == 1
    assert noise[1, 0, 0, 0] == 4.0
    assert np.count_nonzero(noise) == 1


def test_all_lanes_of_a_group_are_stepped_at_once_and_summed():
    array, total = grouped_zeros((2, 1)), np.zeros(1)
    array[:] = np.arange(16.0).reshape(2, 1, WIDTH)
    before = array.copy()
    doubled(array, total)
    np.testing.assert_array_equal(array, 2.0 * before)
    assert total[0] == pytest.approx(2.0 * before.sum())
    scaled(array[0], 3.0)
    np.testing.assert_array_equal(array[0], 6.0 * before[0])
    np.testing.assert_array_equal(array[1], 2.0 * before[1])


def test_interpreted_a_group_is_one_source():
    sources, one = np.zeros((3, 4, 4)), np.array([2.5])
    add_one(sources, 2, 3, 1, 0, 2.5)
    set_one(sources, 1, 0, 0, 0, 4.0)
    assert get_one(sources, 2, 3, 1, 0) == get_two(sources[2], 3, 1, 0) == 2.5
    assert np.count_nonzero(sources) == 2
    assert group(sources, 2) is not None
    assert whole(one) is one
    assert total_of(one) == 2.5
