"""Kernels that read and write outside an array or a view of lanes, run with bounds checks: writes what each raises."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view


@jit
def read(out, i):
    out[0] = out[i]


@jit
def write(out, i):
    out[i] = 1.0


@jit
def read_lanes(array, i):
    lanes = view(array)
    lanes[0, 0] = lanes[0, i]


@jit
def write_lanes(array, i):
    lanes = view(array)
    lanes[0, i] = 1.0


@jit
def write_row_of_lanes(array, i):
    row = view(array)[i]
    row[0] = 1.0


def outcome(kernel: Callable[..., None], *arguments: object) -> str:
    """Return the name of what a kernel raises."""
    try:
        kernel(*arguments)
    except IndexError:
        return "IndexError"
    return "nothing"


if __name__ == "__main__":
    plain, lanes = np.zeros(6)[:3], aligned_zeros((6, 2, 8))[:3]
    cases = [(read, plain), (write, plain), (read_lanes, lanes), (write_lanes, lanes), (write_row_of_lanes, lanes)]
    for kernel, array in cases:
        inside = array.shape[0] if kernel in (read, write, write_row_of_lanes) else array.shape[1]
        found = (outcome(kernel, array, i) for i in (0, inside - 1, inside))
        sys.stdout.write(f"{kernel.__name__} {' '.join(found)}\n")
