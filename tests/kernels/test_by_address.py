"""Records go to kernels by address, and elements of arrays are read and written as numpy does."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from lvnav_trade.kernels.jit import array_jit, jit


class Inner(NamedTuple):
    """A record within a record."""

    values: Any
    gain: float


class Outer(NamedTuple):
    """What the kernels below read."""

    first: Any
    inner: Inner
    last: Any


class State(NamedTuple):
    """A record that kernels make."""

    a: float
    b: float


for _kind in (Inner, Outer, State):
    _kind.__module__ = "lvnav_trade.tests"  # numba hands records of others over as ever


@jit
def _scale(inner, at):
    inner.values[at] *= inner.gain


@jit
def _lower(first, last, at):
    if last is None:
        return
    for i in range(at):
        first[i] -= last[i]


@jit
def _change(record, at):
    _scale(record.inner, at)
    record.first[at] += record.inner.values[at]
    _lower(record.first, record.last, at)


@jit
def change(record, at):
    _change(record, at)
    _change(record, at - 1)


@pytest.mark.parametrize("last", [None, np.array([0.5, 0.25, 0.125])], ids=["without", "with"])
def test_a_record_within_a_record_reaches_whoever_reads_it(last: Any) -> None:
    def record() -> Outer:
        return Outer(np.arange(3.0), Inner(np.arange(1.0, 4.0), 3.0), last)

    compiled, interpreted = record(), record()
    change(compiled, 2)
    for at in (2, 1):
        interpreted.inner.values[at] *= 3.0
        interpreted.first[at] += interpreted.inner.values[at]
        for i in range(at):
            interpreted.first[i] -= 0.0 if last is None else last[i]
    np.testing.assert_array_equal(compiled.first, interpreted.first)
    np.testing.assert_array_equal(compiled.inner.values, interpreted.inner.values)


def test_a_part_takes_one_address_for_a_record_however_many_fields_it_has() -> None:
    change(Outer(np.zeros(3), Inner(np.ones(3), 2.0), None), 2)
    for found in _change.inner.overloads.values():
        (function,) = (one for one in found.library.get_defined_functions() if "_change" in one.name)
        assert len(list(function.arguments)) == 4  # place of the result, of an error; the record, the index


@jit
def _next(state):
    return State(state.a + 1.0, 2.0 * state.b)


@jit
def _sum(state, other):
    return state.a + 10.0 * other.a + 100.0 * state.b


@jit
def last_two(state, n):
    previous = state
    for _ in range(n):
        previous = state
        state = _next(state)
    return _sum(previous, state)


def test_a_record_made_in_a_loop_is_not_that_of_the_turn_before() -> None:
    assert last_two(State(0.0, 1.0), 3) == 2.0 + 10.0 * 3.0 + 100.0 * 4.0
    assert last_two(State(5.0, 1.0), 0) == 5.0 + 10.0 * 5.0 + 100.0


@jit
def _pair(first, second):
    return first.a - second.a


@jit
def chosen(first, second, is_first):
    record = first if is_first else second
    return _pair(record, second)


def test_a_record_chosen_by_a_condition_is_the_chosen_one() -> None:
    assert chosen(State(3.0, 0.0), State(1.0, 0.0), True) == 2.0
    assert chosen(State(3.0, 0.0), State(1.0, 0.0), False) == 0.0


@jit
def move(source, target, i, j):
    target[i, j] = source[j, i]
    target[-1, i] = source[-1, -2]


ARRAYS = {
    "rows": np.arange(12.0).reshape(3, 4),
    "columns": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    "every other": np.arange(48.0).reshape(6, 8)[::2, ::2],
    "backwards": np.arange(12.0).reshape(3, 4)[::-1, ::-1],
    "whole numbers": np.arange(12).reshape(3, 4),
    "bytes": np.arange(12, dtype=np.uint8).reshape(3, 4),
    "truth": np.arange(12).reshape(3, 4) % 3 == 0,
    "complex": np.arange(12).reshape(3, 4) * 1j,
}


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("at", [(1, 2), (-1, -2), (np.uint64(2), np.int32(1)), (np.int8(-2), np.uint8(0))], ids=str)
def test_elements_are_those_of_numpy(name: str, at: tuple[int, int]) -> None:
    source = ARRAYS[name]
    targets = [np.zeros((4, 3), source.dtype) for _ in range(2)]
    move(source, targets[0], *at)
    move.py_func(source, targets[1], *at)
    np.testing.assert_array_equal(targets[0], targets[1])


def test_a_number_is_cast_to_what_the_array_holds() -> None:
    whole = np.zeros((4, 3), np.int32)
    move(np.full((3, 4), 2.75), whole, 1, 2)
    assert whole[1, 2] == 2


@array_jit
def branches(x):
    if x > 0.0:
        found = np.full(3, x)
    else:
        found = np.zeros(2)
    again = found
    for _ in range(2):
        total = 0.0
        for i in range(again.size):
            total += again[i]
        again = np.append(found, total)
    return again


@pytest.mark.parametrize("x", [2.0, -1.0])
def test_variables_set_at_one_place_keep_their_arrays_alive(x: float) -> None:
    for _ in range(100):
        np.testing.assert_array_equal(branches(x), branches.py_func(x))


@array_jit
def _slope(y, record):
    out = np.zeros(y.size)
    for i in range(y.size):
        out[i] = record.inner.gain * y[i] + record.first[i]
    return out


@array_jit
def _step(y, record):
    slope = _slope(y, record)
    return y + 0.5 * (slope + _slope(y + slope, record))


@array_jit
def stepped(y, n, record):
    for _ in range(n):
        y = _step(y, record)
    return y


def test_arrays_that_are_replaced_in_a_loop_are_given_back_once() -> None:
    y, record = np.ones(3), Outer(np.arange(3.0), Inner(np.arange(3.0), -0.5), None)
    held = (y, record.first, record.inner.values)
    before = [sys.getrefcount(array) for array in held]
    for _ in range(20):
        stepped(y, 3, record)
    assert [sys.getrefcount(array) for array in held] == before
    np.testing.assert_array_equal(stepped(y, 2, record), stepped.py_func(y, 2, record))
