"""Error sources eight to a vector: arrays whose first axis is groups of sources and whose last is the eight of a group.

Gains and transition are the same for every source, so one kernel steps eight of them. With `NUMBA_DISABLE_JIT=1` a
group is one source and there is no last axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import config
from numba.extending import overload
from numpy.typing import NDArray

from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.vector import WIDTH

GROUP = 1 if config.DISABLE_JIT else WIDTH
"""How many sources a group has."""


def grouped_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return zeros of the given shape (a group or n_group first), with the lanes of a group behind it."""
    return np.zeros(shape) if config.DISABLE_JIT else aligned_zeros((*shape, WIDTH))


def group(array: Any, index: Any) -> Any:
    """Return one group of sources, as lanes."""
    return array[index]


@overload(group)
def _group(array, index):
    return lambda array, index: view(array[index])


def whole(array: Any) -> Any:
    """Return an array of one group, as lanes."""
    return array


@overload(whole)
def _whole(array):
    return lambda array: view(array)


def get_one(array: Any, i: Any, j: Any, k: Any, lane: Any) -> Any:
    """Return the entry (i, j, k) of one lane."""
    return array[i, j, k]


@overload(get_one)
def _get_one(array, i, j, k, lane):
    return lambda array, i, j, k, lane: array[i, j, k, lane]


def add_one(array: Any, i: Any, j: Any, k: Any, lane: Any, value: Any) -> None:
    """Add to the entry (i, j, k) of one lane."""
    array[i, j, k] += value


@overload(add_one)
def _add_one(array, i, j, k, lane, value):
    def lanes(array, i, j, k, lane, value):
        array[i, j, k, lane] += value

    return lanes


def set_one(array: Any, i: Any, j: Any, k: Any, lane: Any, value: Any) -> None:
    """Set the entry (i, j, k) of one lane."""
    array[i, j, k] = value


@overload(set_one)
def _set_one(array, i, j, k, lane, value):
    def lanes(array, i, j, k, lane, value):
        array[i, j, k, lane] = value

    return lanes


def total_of(array: Any) -> Any:
    """Return the sum of a work array (1,) over its lanes."""
    return array[0]


@overload(total_of)
def _total_of(array):
    def lanes(array):
        total = 0.0
        for lane in range(WIDTH):
            total += array[0, lane]
        return total

    return lanes


def get_two(array: Any, i: Any, j: Any, lane: Any) -> Any:
    """Return the entry (i, j) of one lane."""
    return array[i, j]


@overload(get_two)
def _get_two(array, i, j, lane):
    return lambda array, i, j, lane: array[i, j, lane]
