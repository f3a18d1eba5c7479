"""Eight runs in one value: every operation does in each lane what numpy does, and one run takes the same source."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import TypingError

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import (
    WIDTH,
    bits,
    from_bits,
    magnitude,
    number_like,
    sqrt,
    to_float,
    view,
    where,
    word_like,
)

N = 50


def draws(*shape):
    """Random numbers of both signs over many magnitudes, the same in every call."""
    rng = np.random.default_rng(20260801)
    return rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 4, shape)


@jit
def arithmetic(out, a, b):
    for i in range(a.shape[0]):
        x, y = a[i], b[i]
        out[0, i], out[1, i], out[2, i], out[3, i] = x + y, x - y, x * y, x / y
        out[4, i], out[5, i], out[6, i] = -x, magnitude(x), sqrt(magnitude(y))
        total = number_like(x, 0.0)
        total += x
        total -= y
        total *= x
        out[7, i] = total


@jit
def with_numbers(out, a):
    for i in range(a.shape[0]):
        x = a[i]
        out[0, i], out[1, i], out[2, i], out[3, i] = x + 2.5, x - 2.5, x * 2.5, x / 2.5
        out[4, i], out[5, i], out[6, i], out[7, i] = 2.5 + x, 2.5 - x, 2.5 * x, 2.5 / x
        out[8, i], out[9, i], out[10, i] = x + 3, 3 - x, 3 * x
        out[11, i] = 7.0


@jit
def choices(out, a, b):
    for i in range(a.shape[0]):
        x, y = a[i], b[i]
        out[0, i], out[1, i] = where(x < y, x, y), where(x <= y, x, 0.0)
        out[2, i], out[3, i], out[4, i] = where(x > y, 1.0, y), where(x >= y, 1.0, 0.0), where(x == y, 1.0, 0.0)
        out[5, i], out[6, i] = where((x > 0.0) & (y > 0.0), x, y), where((0.0 < x) | (0.0 < y), x, y)


@jit
def words(out, floats, a, b):
    for i in range(a.shape[0]):
        x, y = a[i], b[i]
        out[0, i], out[1, i], out[2, i] = x + y, x * y, x ^ y
        out[3, i], out[4, i] = x & y, x | y
        out[5, i], out[6, i] = x << np.uint64(7), x >> np.uint64(13)
        out[7, i], out[8, i] = np.uint64(5) + x, word_like(x, np.uint64(9))
        out[9, i] = bits(floats[0, i])
        floats[1, i] = from_bits(out[9, i])
        floats[2, i] = to_float(x)


@jit
def arithmetic_of_lanes(out, a, b):
    arithmetic(view(out), view(a), view(b))


@jit
def with_numbers_of_lanes(out, a):
    with_numbers(view(out), view(a))


@jit
def choices_of_lanes(out, a, b):
    choices(view(out), view(a), view(b))


@jit
def words_of_lanes(out, floats, a, b):
    words(view(out), view(floats), view(a), view(b))


def expected_arithmetic(a, b):
    return np.stack([a + b, a - b, a * b, a / b, -a, abs(a), np.sqrt(abs(b)), (a - b) * a])


def expected_with_numbers(a):
    rows = [
        a + 2.5,
        a - 2.5,
        a * 2.5,
        a / 2.5,
        2.5 + a,
        2.5 - a,
        2.5 * a,
        2.5 / a,
        a + 3,
        3 - a,
        3 * a,
        np.full_like(a, 7.0),
    ]
    return np.stack(rows)


def expected_choices(a, b):
    both, either = (a > 0) & (b > 0), (a > 0) | (b > 0)
    return np.stack([
        np.where(a < b, a, b), np.where(a <= b, a, 0.0), np.where(a > b, 1.0, b), np.where(a >= b, 1.0, 0.0),
        np.where(a == b, 1.0, 0.0), np.where(both, a, b), np.where(either, a, b),
    ])  # fmt: skip


def inputs(lanes):
    """Two arrays with ties, zeros and numbers that are not finite among them."""
    a, b = draws(2, N, WIDTH) if lanes else draws(2, N)
    a[3], b[4], a[5] = b[3], 0.0, np.inf
    a[6] = np.nan
    return a, b


@pytest.mark.parametrize(("kernel", "lanes"), [(arithmetic, False), (arithmetic_of_lanes, True)])
def test_arithmetic_rounds_as_numpy_does_in_every_lane(kernel, lanes):
    a, b = inputs(lanes)
    out = np.zeros((8, *a.shape))
    kernel(out, a, b)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(out, expected_arithmetic(a, b))


@pytest.mark.parametrize(("kernel", "lanes"), [(with_numbers, False), (with_numbers_of_lanes, True)])
def test_a_number_on_either_side_stands_for_the_same_number_in_all_lanes(kernel, lanes):
    a, _ = inputs(lanes)
    out = np.zeros((12, *a.shape))
    kernel(out, a)
    np.testing.assert_array_equal(out, expected_with_numbers(a))


@pytest.mark.parametrize(("kernel", "lanes"), [(choices, False), (choices_of_lanes, True)])
def test_a_choice_is_made_lane_by_lane_and_a_comparison_with_nan_fails(kernel, lanes):
    a, b = inputs(lanes)
    out = np.zeros((7, *a.shape))
    kernel(out, a, b)
    np.testing.assert_array_equal(out, expected_choices(a, b))


@pytest.mark.parametrize(("kernel", "lanes"), [(words, False), (words_of_lanes, True)])
def test_words_wrap_shift_and_change_into_floats_as_numpy_words_do(kernel, lanes):
    shape = (N, WIDTH) if lanes else (N,)
    rng = np.random.default_rng(1)
    a, b = rng.integers(0, 2**64, (2, *shape), dtype=np.uint64)
    out, floats = np.zeros((10, *shape), dtype=np.uint64), np.zeros((3, *shape))
    floats[0] = draws(*shape)
    kernel(out, floats, a, b)
    five = np.uint64(5)
    expected = [
        a + b,
        a * b,
        a ^ b,
        a & b,
        a | b,
        a << np.uint64(7),
        a >> np.uint64(13),
        five + a,
        a * np.uint64(0) + 9,
    ]
    np.testing.assert_array_equal(out[:9], np.stack(expected))
    np.testing.assert_array_equal(out[9], floats[0].view(np.uint64))
    np.testing.assert_array_equal(floats[1], floats[0])
    np.testing.assert_array_equal(floats[2], a.astype(np.float64))


@jit
def total_of_plane(plane):
    total = number_like(plane[0, 0], 0.0)
    for i in range(plane.shape[0]):
        row = plane[i]
        for j in range(plane.shape[1]):
            total = total + row[j]
    return total


@jit
def sum_and_transpose(sums, turned, cube):
    """Views of one, two and three dimensions, a plane and a row of them, read and written."""
    for k in range(cube.shape[0]):
        sums[k] = total_of_plane(cube[k])
        for i in range(cube.shape[1]):
            for j in range(cube.shape[2]):
                turned[k, j, i] = cube[k, i, j]
        last = turned[k]
        row = last[0]
        row[0] = 100.0 * cube[k, 0, 0]


@jit
def sum_and_transpose_lanes(sums, turned, cube):
    sum_and_transpose(view(sums), view(turned), view(cube))


@pytest.mark.parametrize(("kernel", "end"), [(sum_and_transpose, ()), (sum_and_transpose_lanes, (WIDTH,))])
def test_views_of_one_to_three_dimensions_and_their_parts_read_and_write_the_array(kernel, end):
    cube = np.random.default_rng(2).integers(-50, 50, (4, 3, 5, *end)).astype(float)  # sums of them are exact
    sums, turned = np.zeros((4, *end)), np.zeros((4, 5, 3, *end))
    kernel(sums, turned, cube)
    expected = np.swapaxes(cube, 1, 2).copy()
    expected[:, 0, 0] *= 100.0
    np.testing.assert_array_equal(turned, expected)
    np.testing.assert_array_equal(sums, cube.sum(axis=(1, 2)))


def test_lane_views_exist_in_compiled_code_only():
    with pytest.raises(NotImplementedError, match="compiled"):
        view(np.zeros((2, WIDTH)))


class Pair(NamedTuple):
    """A record of arrays, of which one may be missing."""

    values: Any
    words: Any
    other: Any


@jit
def add_values(to, values, words):
    for i in range(to.shape[0]):
        to[i] = to[i] + values[i] + to_float(words[i])


@jit
def add_record(to, pair):
    if pair is not None:
        add_values(to, pair.values, pair.words)


@jit
def add_lanes(to, pair):
    lanes = view(pair)
    add_record(view(to), lanes)
    add_record(view(to), lanes.other)


def test_the_view_of_a_record_has_views_of_its_arrays_and_of_records_within_and_keeps_none():
    values, words = np.arange(16.0).reshape(2, WIDTH), np.full((2, WIDTH), 3, dtype=np.uint64)
    for other, times in ((None, 1.0), (Pair(values, words, None), 2.0)):
        to = np.zeros((2, WIDTH))
        add_lanes(to, Pair(values, words, other))
        np.testing.assert_array_equal(to, times * (values + 3.0))


@jit
def length_of_view(x):
    return view(x).shape[0]


@pytest.mark.parametrize("array", [np.zeros((4, WIDTH))[::2], np.zeros((3, WIDTH), dtype=np.float32)])
def test_an_array_that_lanes_cannot_view_is_refused_at_compilation(array):
    assert length_of_view(np.zeros((3, WIDTH))) == 3
    with pytest.raises(TypingError):
        length_of_view(array)


@pytest.mark.slow
def test_bounds_checks_find_an_index_outside_an_array_and_outside_a_view(root, tmp_path):
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    found = subprocess.run(
        [sys.executable, "-m", "tests.kernels.outside"], cwd=root, env=environment, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    lines = [line.split() for line in found.stdout.splitlines()]
    assert [line[0] for line in lines] == ["read", "write", "read_lanes", "write_lanes", "write_row_of_lanes"]
    assert [line[1:] for line in lines] == [["nothing", "nothing", "IndexError"]] * 5  # first, last, one beyond
