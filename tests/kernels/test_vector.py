"""What the lane types refuse; what they do is tested with kernels.lanes."""

from __future__ import annotations

import numpy as np
import pytest
from numba import TypingError

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.vector import WIDTH, LaneView, f64x8, u64x8


@jit
def branches_on_a_lane(x):
    lanes = view(x)
    if lanes[0] > 0.0:
        return 1.0
    return 0.0


@jit
def mixes_words_and_floats(x, words):
    return view(x)[0] + view(words)[0]


@jit
def takes_a_power(x):
    lanes = view(x)
    lanes[0] = lanes[0] ** 2.5


def test_a_branch_on_a_value_that_differs_between_runs_does_not_compile():
    with pytest.raises(TypingError):
        branches_on_a_lane(np.zeros((1, WIDTH)))


def test_words_and_floats_do_not_mix():
    with pytest.raises(TypingError):
        mixes_words_and_floats(np.zeros((1, WIDTH)), np.zeros((1, WIDTH), dtype=np.uint64))


def test_an_operation_that_lanes_do_not_have_does_not_compile():
    with pytest.raises(TypingError):
        takes_a_power(np.zeros((1, WIDTH)))


def test_lane_types_are_distinguished_by_item_and_dimension():
    assert LaneView(f64x8, 2) == LaneView(f64x8, 2)
    assert LaneView(f64x8, 2) != LaneView(f64x8, 1)
    assert LaneView(f64x8, 1) != LaneView(u64x8, 1)
