"""Sources eight to a vector: what is put into one of them is found there and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import GROUP, LINE, group, group_view, grouped_zeros, lane_total
from lvnav_trade.kernels.vector import WIDTH


@jit
def doubled(array, total):
    for g in range(array.shape[0]):
        row = group(array, g)
        row[0] = row[0] + row[0]
        total[0] += lane_total(array[g])


@jit
def scaled(array, factor):
    lanes = group_view(array)
    lanes[0] = factor * lanes[0]


def test_a_group_is_as_many_sources_as_a_vector_has_lanes():
    assert GROUP == WIDTH
    zeros = grouped_zeros((3, 4, 5))
    assert zeros.shape == (3, 4, 5, WIDTH)
    assert zeros.ctypes.data % LINE == 0


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
    sources, one = np.zeros((3, 4, 1)), np.array([[2.5]])
    group_view(sources[2])[3] = 2.5
    assert sources[2, 3, 0] == 2.5
    assert np.count_nonzero(sources) == 1
    assert lane_total.py_func(one) == 2.5
