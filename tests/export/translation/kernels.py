"""Small kernels, each of which needs something of the language that kernels are written in."""

import math

import numpy as np

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.lanes import number_like, where

WEIGHTS = (1.0, 4.0, 1.0)
TABLE = np.array([[0.5, -1.5], [2.5, 1e300]])


def loops(out, x):
    """Loops forwards, backwards, by steps, over known numbers; what is skipped and left."""
    total = number_like(x[0], 0.0)
    for i in range(x.shape[0]):
        if x[i] < 0.0:
            continue
        total += x[i]
    for i in range(x.shape[0] - 1, -1, -1):
        total = total - 0.25 * i * x[i]
    for i in range(1, x.shape[0], 2):
        if i > 3:
            break
        total = total * 1.5
    for at in (0, 2):
        out[1 + at] = x[at]
    out[0] = total
    for _ in range(2 if x[0] > x[1] else 0):
        out[4] = out[4] + 1.0
    k = 0
    while k < 3 and x[k] != 2.0:
        k += 1
    out[2] = k


def swaps(out, x):
    """Assignments whose targets stand on the right too, chains of targets, and what a function of several returns."""
    a, b = x[0], x[1]
    a, b = b, a
    c = d = a - b
    x[2], x[3] = x[3], x[2]
    out[0], out[1], out[2] = cross(a, b, c, d, x[2], x[3])
    c0, *_rest = 1.0, 2.0
    out[3] = c0


def numbers(out, x, n):
    """Integers and what becomes of them: division, remainder, of negative ones too, powers, conversions."""
    out[0], out[1] = n // 4, n % 4
    out[2], out[3] = (-n) // 4, (-n) % 4
    out[4] = n / 4
    out[5] = x[0] ** 2 + (x[0] + 1.0) ** 3
    out[6] = int(x[1])
    out[7] = min(n, 3) + max(x[0], 0.5)
    out[8] = -(-x[0] + 0.0) - (x[1] - (x[0] - x[1]))
    out[9] = x[0] / (x[1] * x[0]) / x[1]
    out[10] = 1.0 if n in (2, 7) else 0.0
    out[11] = 1.0 if n not in (2, 8) and not n > 100 else 0.0


def functions(out, x):
    """Functions of numbers, choices, what is not a number."""
    out[0] = math.sqrt(x[0]) + math.atan2(x[0], x[1]) + math.exp(-x[1]) + abs(x[1])
    out[1] = where(x[0] > x[1], x[0], -x[1])
    out[2] = where((x[0] > 0.0) & (x[1] == x[1]), np.nan, 1.0)
    out[3] = np.inf
    out[4] = TABLE[1, 0] * WEIGHTS[1]
    first, at = (0, x[1]) if x[0] > 100.0 else (1, x[0])
    out[5] = at + first
    out[6] = len(WEIGHTS) + x.shape[0]


def parts(out, x, n):
    """Rows, slices, tuples that are read by an index which is not known, tables of the module."""
    row, last = x[1], x[-1, -1]
    head = x[n, :n]
    values = (row[0], last, x[0, 1])
    for i in range(3):
        out[i] = values[i] + WEIGHTS[i]
    out[3] = _total(head) + _total(x[0, 1:])
    for i in range(2):
        out[4 + i] = TABLE[i, i] if n > 0 else row[0]
    m = matrix(1.0, 0.1, 0.2, row[0])
    for i in range(9):
        out[6 + i] = m[i]


def _total(values):
    total = number_like(values[0], 0.0)
    for i in range(values.shape[0]):
        total = total + values[i]
    return total


def returns(out, x, n):
    """Functions that return early, or one of several numbers by a setting, and change their own arguments."""
    out[0], out[1] = _sorted(x[0], x[1])
    out[2] = _counted(n)
    out[3] = _chosen(x[0], None) + _chosen(x[0], 2.0)


def _sorted(a, b):
    if a > b:
        return b, a
    return a, b


def _counted(n):
    total = 0
    while n > 0:
        total, n = total + n, n - 1
    return total


def _chosen(x, scale):
    if scale is None:
        return x
    return scale * x


def settled(out, wanted, first):
    """What is known beforehand: a branch that is never taken may name what there is not."""
    if wanted is not None:
        out[0] = wanted.field
    elif first:
        out[0] = 1.0
    else:
        out[0] = 2.0
    for i in range(0):
        out[i] = unknown_name  # noqa: F821
