"""Groups of eight error sources, one per vector lane. The first axis of an array is the group, the last the lane.

Gains and transition matrices are the same for all sources, so one kernel processes eight of them. With
`NUMBA_DISABLE_JIT=1` a group has one source.
"""

from typing import Any

import numpy as np
from numba import config
from numba.extending import overload
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.vector import WIDTH

GROUP = 1 if config.DISABLE_JIT else WIDTH
"""Number of sources in a group."""


def grouped_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return zeros of the given shape, with the lanes of a group as an additional last axis."""
    return aligned_zeros((*shape, GROUP))


def whole(array: Any) -> Any:
    """Return an array of one group, as lanes."""
    return array[..., 0]


@overload(whole)
def _whole(array):
    return lambda array: view(array)


@jit
def group(array: Any, index: Any) -> Any:
    """Return one group of sources, as lanes."""
    return whole(array[index])


@jit
def total_of(array: Any) -> Any:
    """Return the sum of an array (1, n_lane) over its lanes."""
    total = 0.0
    for lane in range(array.shape[1]):
        total += array[0, lane]
    return total
